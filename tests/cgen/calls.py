"""Calls of generated functions from Python, and the inputs that the contract is tried with."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gtmodel.cgen.interface import Interface
from gtmodel.cgen.newton_stages import samples_of
from gtmodel.cgen.points import draw
from tests.bench.callgrind import FLAGS
from tests.cgen.conftest import c_files, succeed

SPOILT = 0.3  # share of the draws with a NaN or an infinity
DENORMAL = 5e-324


def shared_library(folder: Path, place: Path) -> ctypes.CDLL:
    """A generated folder, compiled into the folder `place`."""
    sources = [folder / f for f in c_files(folder) if not f.endswith("_main.c")]
    succeed("cc", *FLAGS, "-shared", "-fPIC", *sources, "-lm", "-o", "library.so", cwd=place)
    return ctypes.CDLL(str(place / "library.so"))


def spoilt_draws(face: Interface, rows: int, **options: float) -> tuple[np.ndarray, np.ndarray]:
    """Random inputs, and which of them hold a number that is not finite."""
    rng = np.random.default_rng(8)
    inputs = draw(face, rows, seed=8, **options)
    spoilt = rng.random(rows) < SPOILT
    column = rng.integers(face.input_size + face.state_size, size=rows)
    inputs[spoilt, column[spoilt]] = rng.choice([np.nan, np.inf, -np.inf], size=int(spoilt.sum()))
    return inputs, spoilt


def denormals(face: Interface) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Home with each input in turn zero, and the same with a denormal of either sign in its place."""
    home = [x for stage in face.newton for x in stage.home]
    point = np.concatenate([samples_of(face.function, [p for s in face.function.inputs for p in s.pairs])[0], home])
    for sign in (1.0, -1.0):
        zero, tiny = np.tile(point, (len(point), 1)), np.tile(point, (len(point), 1))
        np.fill_diagonal(zero, 0.0)
        np.fill_diagonal(tiny, sign * DENORMAL)
        yield zero, tiny
