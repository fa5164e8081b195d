"""Issue 8, point 2, for the F1: 100,000 calls in C under `proof`, some thousands of them always.

Closures are those of tests/oracle/f1_by_hand.py, which knows nothing of gtmodel.
"""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.cgen.interface import Interface, interfaces
from gtmodel.cgen.points import HELD, evaluate
from gtmodel.cgen.verification.comparison import box_points, call
from tests.cgen.calls import denormals, shared_library, spoilt_draws
from tests.cgen.conftest import Functions
from tests.oracle.f1_by_hand import F1ByHand, from_quaternion

KEYS = ("fk", "ik", "velocity")
FEW, MANY = 1_200, 33_400  # draws of each function; three times MANY is 100,000
FARTHEST = 1.5  # typical sizes: enough draws keep a solution, enough lose it
RESIDUAL_M2 = 1e-9  # squared lengths of some metres, Newton's residual limit
STEP_S = 1e-4
# central difference of a closure along the velocities, over their size: its own error is STEP_S^2, times the size cubed
DRIFT = 1e-5


@pytest.fixture(scope="module")
def faces(f1: Functions) -> dict[str, Interface]:
    return {face.key: face for face in interfaces(f1, "f")}


@pytest.fixture(scope="module")
def library(faces: dict[str, Interface], tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    place = tmp_path_factory.mktemp("contract_f1")
    return shared_library(cgen.generate({k: f.function for k, f in faces.items()}, place / "f", name="f").folder, place)


@pytest.fixture(scope="module")
def by_hand() -> F1ByHand:
    robot = gt.robots.f1_gantry_tau()
    A0, v, L, A, B, u1_2, u1_3, u2_3, r3 = (
        np.array(getattr(robot, name)) for name in ("A0", "v", "L", "A", "B", "u1_2", "u1_3", "u2_3", "r3")
    )
    return F1ByHand(A0, v, L, A, B, u1_2, u1_3, u2_3, r3)


def closures(by_hand: F1ByHand, q: np.ndarray, T: np.ndarray, e: np.ndarray) -> np.ndarray:
    """|link|^2 - L^2 of the six links, (rows, 6)."""
    links = np.array([by_hand.links(*row[:2], from_quaternion(row[2])) for row in zip(q, T, e, strict=True)])
    return np.sum(links * links, axis=2) - by_hand.L**2


@pytest.mark.parametrize("rows", [FEW, pytest.param(MANY, marks=pytest.mark.proof)])
@pytest.mark.parametrize("key", KEYS)
def test_a_status_for_every_call(
    key: str, rows: int, faces: dict[str, Interface], library: ctypes.CDLL, by_hand: F1ByHand
) -> None:
    face = faces[key]
    inputs, spoilt = spoilt_draws(face, rows, farthest=FARTHEST)
    outputs, status = call(library, face, inputs)
    ok = status == Status.OK
    assert np.all(status[spoilt] == Status.NOT_FINITE)
    assert np.all(outputs[~ok] == HELD) and np.all(np.isfinite(outputs[ok]))
    assert 0.08 * rows < ok.sum() < 0.7 * rows and np.any(status == Status.NOT_CONVERGED)
    given, found = inputs[ok], outputs[ok]
    if key == "fk":
        assert np.max(np.abs(closures(by_hand, given[:, :6], found[:, :3], found[:, 3:7]))) < RESIDUAL_M2
        return
    # a quaternion that is none, and a plate that link 1 cannot reach from its guideway along z
    T, e = (given[:, :3], given[:, 3:7]) if key == "ik" else (given[:, :3], given[:, 6:10])
    assert np.max(np.abs(closures(by_hand, found[:, :6], T, e))) < RESIDUAL_M2
    every = inputs[:, 3:7] if key == "ik" else inputs[:, 6:10]
    with np.errstate(invalid="ignore", over="ignore"):
        stretched = np.abs(np.sum(every * every, axis=1) - 1.0) > 1e-5
        turned = np.array([from_quaternion(u) @ by_hand.B[0] for u in every])
        across = (inputs[:, :3] + turned - by_hand.A0[0])[:, :2]
        beyond = np.sum(across * across, axis=1) > by_hand.L[0] ** 2 * (1 + 1e-9)
    for impossible in (stretched, beyond):
        assert np.sum(impossible & ~spoilt) > 0.05 * rows and not np.any(ok & impossible)
    if key == "velocity":
        rate = inputs[:, 10:14]
        with np.errstate(invalid="ignore", over="ignore"):  # a quaternion's rate that no rotation has
            radial = np.abs(np.sum(every * rate, axis=1)) > 1e-5 * (1 + np.linalg.norm(rate, axis=1))
        assert np.sum(radial & ~spoilt) > 0.3 * rows and not np.any(ok & radial)
        rates = found[:, 6:12], given[:, 3:6], given[:, 10:14]
        ahead, behind = (
            closures(by_hand, found[:, :6] + s * rates[0], T + s * rates[1], e + s * rates[2])
            for s in (STEP_S, -STEP_S)
        )
        size = np.maximum(1.0, np.max(np.abs(np.column_stack(rates)), axis=1))
        assert np.max(np.abs(ahead - behind)[:, :] / (2 * STEP_S) / size[:, None] ** 3) < DRIFT


def test_points_of_a_box_keep_the_conditions_and_their_rates(f1: Functions) -> None:
    box = {
        "T": [[-0.39, 0.01], [2.1, 2.5], [-0.2, 0.2]],
        "e": [[0.45, 0.55], [0.45, 0.55], [0.44, 0.54], [-0.55, -0.45]],
        "der(T)": [[-1.5, 1.5]],
        "der(e)": [[-0.5, 0.5]],
    }
    (face,) = interfaces({"velocity": f1["velocity"]}, "f", box=box)
    inputs = box_points(face, 300, seed=3)[:, :14]
    e, rate = inputs[:, 6:10], inputs[:, 10:14]
    assert np.max(np.abs(np.sum(e * e, axis=1) - 1)) < 1e-12 and np.max(np.abs(np.sum(e * rate, axis=1))) < 1e-12
    low, high = np.array(face.box).T
    assert np.all(inputs > low - 1e-3) and np.all(inputs < high + 1e-3)
    assert np.ptp(rate, axis=0).min() > 0.9  # and still fill it
    outputs, status = evaluate(face, box_points(face, 300, seed=3))
    assert np.all(status == Status.OK) and np.all(np.isfinite(outputs))


@pytest.mark.parametrize("key", KEYS)
def test_a_denormal_is_a_zero(key: str, faces: dict[str, Interface], library: ctypes.CDLL) -> None:
    face = faces[key]
    for zero, tiny in denormals(face):
        (a, first), (b, second) = call(library, face, zero), call(library, face, tiny)
        np.testing.assert_array_equal(first, second)
        assert np.any(first == Status.OK) and np.max(np.abs(a - b)) < np.finfo(float).tiny
