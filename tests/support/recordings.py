"""Recordings that may not be shipped: where the tests look for them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import scipy

CLONE = Path(__file__).resolve().parents[2]


def recording(name: str) -> Path:
    """The first that is there: where its problem expects it, in $GTMODEL_RECORDINGS, in ../shared/realdata beside the
    clone; the first of these places where it is nowhere."""
    own = os.environ.get("GTMODEL_RECORDINGS", "").strip()
    folders = [CLONE / "problems" / "data", *([Path(own)] if own else []), CLONE.parent / "shared" / "realdata"]
    places = [folder / name for folder in folders]
    return next((p for p in places if p.is_file()), places[0])


EMPS = recording("emps/DATA_EMPS.mat")
NO_EMPS = "the EMPS recording is not there; problems/emps.toml says where to get it"


def write_synthetic_emps(file: Path) -> None:
    """A synthetic log like DATA_EMPS.mat, of the published parameters: 4 s at 1 kHz, seed 1, noise of 2 N."""
    t = np.arange(4001) / 1000
    rates = 2 * np.pi * np.array([0.5, 1.25])
    q = 0.05 * np.sin(np.outer(t, rates)).sum(axis=1)
    v = 0.05 * (rates * np.cos(np.outer(t, rates))).sum(axis=1)
    a = -0.05 * (rates**2 * np.sin(np.outer(t, rates))).sum(axis=1)
    noise = 2.0 * np.random.default_rng(1).standard_normal(len(t))
    force = 95.1089 * a + 203.5034 * v + 20.3935 * np.sign(v) - 3.1648 + noise
    scipy.io.savemat(file, {"t": t, "qm": q, "qg": q, "vir": force / 35.15065188248547})
