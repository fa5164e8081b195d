"""Recordings that may not be shipped: where the tests look for them."""

from __future__ import annotations

import os
from pathlib import Path

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
