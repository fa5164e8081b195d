"""Poses of an L1 in a box, and one synthetic calibration from them; worker processes import it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

import gtmodel as gt
from gtmodel.calibrate import (
    CalibrationProblem,
    Measurements,
    PoseInformation,
    Positioning,
    calibrate,
    exchange,
    pose_information,
    positioning,
    prepare,
)

CENTRE, HALF = np.array([0.5, -0.6, 0.7]), np.array([0.8, 0.4, 0.4])  # box 1.6 x 0.8 x 0.8 m about the L1's home
NOISE = {"q": 13e-6, "T": 50e-6}


def box(shape: tuple[int, ...]) -> np.ndarray:
    """A regular grid (N, 3) of the box, its faces included [m]."""
    lines = [np.linspace(c - h, c + h, n) for c, h, n in zip(CENTRE, HALF, shape, strict=True)]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)


@cache
def l1():
    return gt.robots.gantry_tau("l1_tape")


def problem(T: np.ndarray, noise: Mapping[str, ArrayLike]) -> CalibrationProblem:
    q, status = l1().causal(known="T", targets="q")(T)
    assert np.all(status == 0)
    return prepare(l1(), Measurements({"q": q, "T": T}, noise))


@cache
def grid_information(shape: tuple[int, ...], tracker: bool = True) -> PoseInformation:
    """Of a grid, with the noise of the tracker alone or of the drives too."""
    return pose_information(problem(box(shape), {"T": NOISE["T"]} if tracker else NOISE))


@cache
def workspace() -> Positioning:
    return positioning(problem(box((9, 5, 5)), {}))


@cache
def thirty() -> CalibrationProblem:
    """Thirty selected poses."""
    info = grid_information((7, 5, 5), tracker=False)
    chosen = exchange(info, 30, "I", workspace().moment(info)).indices
    return problem(box((7, 5, 5))[chosen], NOISE)


def one(rng: np.random.Generator, k: int) -> np.ndarray:
    """Synthetic: errors (21,) of the parameters from thirty poses with normal noise on carts and positions."""
    p = thirty()
    values = {n: np.asarray(a) + NOISE[n] * rng.standard_normal(np.shape(a)) for n, a in p.measurements.values.items()}
    c = calibrate(p.on(Measurements(values, NOISE)), cost="orthogonal")
    assert c.status.ok
    return c.x - p.unknowns.start
