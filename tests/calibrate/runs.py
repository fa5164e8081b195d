"""One calibration of synthetic data by seed; worker processes import it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gtmodel.calibrate import CalibrationProblem, Choice, Cost, calibrate, prepare
from gtmodel.results import Estimate
from tests.calibrate.synthetic import GEOMETRY, geometry, measured, poses, true_robot

NOISE = {"q": 13e-6, "T": 50e-6, "e": 1e-4}  # m, m and rad: repeatability, tracker and its 6-D target
POSES = {"three_link": 60, "six_link": 100, "six_link_free": 100, "f1_unit": 185}
# what is told by itself: of the F1 all but the six that QR calls dependent; of D1, whose plate hardly turns, plate
# joints are left as drawn; "six_link_free" frees them too: determined, to centimetres
DEPENDENT = (
    "A[2,1]", "A[3,0]", "r3[1]", "u1_2 turned about y", "u1_3 turned about y", "u2_3 turned about x",
)  # fmt: skip
CHOICES = {
    "three_link": Choice(),
    "six_link": Choice(fixed=("B",)),
    "six_link_free": Choice(),
    "f1_unit": Choice(fixed=DEPENDENT, unit=("u1_2", "u1_3", "u2_3")),
}


def robot(kind: str) -> str:
    """Of synthetic.py."""
    return kind.removesuffix("_free")


def noise(kind: str) -> dict[str, float]:
    return {n: s for n, s in NOISE.items() if n in poses(robot(kind), POSES[kind])}


@cache
def ready(kind: str) -> CalibrationProblem:
    return prepare(true_robot(robot(kind)), measured(robot(kind), POSES[kind], noise(kind), 0), CHOICES[kind])


def truth(kind: str) -> dict[str, float]:
    """True values of the unknowns; quaternions are turned by nothing from the true ones, where they start."""
    values = geometry(true_robot(robot(kind)), GEOMETRY[robot(kind)])
    return {n: values.get(n, 0.0) for n in ready(kind).unknowns.names}


def one(rng: np.random.Generator, k: int, kind: str, cost: Cost = "length", known: bool = True) -> Estimate:
    """Synthetic: normal noise of NOISE on all signals; starts at the truth."""
    m = measured(robot(kind), POSES[kind], noise(kind), rng, known)
    fit: Any = calibrate(ready(kind).on(m), cost=cost).estimate
    return fit
