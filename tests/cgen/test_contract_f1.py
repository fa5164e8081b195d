"""Issue 8, point 2, for the F1: 100,000 calls in C under `proof`, some thousands of them always.

Closures are those of tests/oracle/f1_by_hand.py, which knows nothing of gtmodel.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.cgen.comparison import call
from gtmodel.cgen.interface import Interface, interfaces
from gtmodel.cgen.newton_stages import samples_of
from gtmodel.cgen.points import HELD, draw
from tests.bench.callgrind import FLAGS
from tests.cgen.conftest import Functions, c_files, succeed
from tests.oracle.f1_by_hand import F1ByHand, from_quaternion

KEYS = ("fk", "ik", "velocity")
FEW, MANY = 1_200, 33_400  # draws of each function; three times MANY is 100,000
FARTHEST = 1.5  # typical sizes: enough draws keep a solution, enough lose it
SPOILT = 0.3  # share of the draws with a NaN or an infinity
RESIDUAL_M2 = 1e-9  # squared lengths of some metres, Newton's residual limit
STEP_S = 1e-4
# central difference of a closure along the velocities, over their size: its own error is STEP_S^2, times the size cubed
DRIFT = 1e-5
DENORMAL = 5e-324


@pytest.fixture(scope="module")
def faces(f1: Functions) -> dict[str, Interface]:
    return {face.key: face for face in interfaces(f1, "f")}


@pytest.fixture(scope="module")
def library(faces: dict[str, Interface], tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    place = tmp_path_factory.mktemp("contract_f1")
    folder = cgen.generate({k: f.function for k, f in faces.items()}, place / "f", name="f").folder
    sources = [folder / f for f in c_files(folder) if not f.endswith("_main.c")]
    succeed("cc", *FLAGS, "-shared", "-fPIC", *sources, "-lm", "-o", "library.so", cwd=place)
    return ctypes.CDLL(str(Path(place) / "library.so"))


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


def judge(key: str, face: Interface, library: ctypes.CDLL, by_hand: F1ByHand, rows: int) -> None:
    rng = np.random.default_rng(8)
    inputs = draw(face, rows, seed=8, farthest=FARTHEST)
    spoilt = rng.random(rows) < SPOILT
    column = rng.integers(face.input_size + face.state_size, size=rows)
    inputs[spoilt, column[spoilt]] = rng.choice([np.nan, np.inf, -np.inf], size=int(spoilt.sum()))
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
        rates = found[:, 6:12], given[:, 3:6], given[:, 10:14]
        ahead, behind = (
            closures(by_hand, found[:, :6] + s * rates[0], T + s * rates[1], e + s * rates[2])
            for s in (STEP_S, -STEP_S)
        )
        size = np.maximum(1.0, np.max(np.abs(np.column_stack(rates)), axis=1))
        assert np.max(np.abs(ahead - behind)[:, :] / (2 * STEP_S) / size[:, None] ** 3) < DRIFT


@pytest.mark.parametrize("key", KEYS)
def test_a_status_for_every_call(
    key: str, faces: dict[str, Interface], library: ctypes.CDLL, by_hand: F1ByHand
) -> None:
    judge(key, faces[key], library, by_hand, FEW)


@pytest.mark.proof
@pytest.mark.parametrize("key", KEYS)
def test_a_status_for_100_000_calls(
    key: str, faces: dict[str, Interface], library: ctypes.CDLL, by_hand: F1ByHand
) -> None:
    judge(key, faces[key], library, by_hand, MANY)


@pytest.mark.parametrize("key", KEYS)
def test_a_denormal_is_a_zero(key: str, faces: dict[str, Interface], library: ctypes.CDLL) -> None:
    face = faces[key]
    home = [x for stage in face.newton for x in stage.home]
    point = np.concatenate([samples_of(face.function, [p for s in face.function.inputs for p in s.pairs])[0], home])
    zero = np.tile(point, (len(point), 1))
    np.fill_diagonal(zero, 0.0)
    tiny = zero.copy()
    for sign in (1.0, -1.0):
        np.fill_diagonal(tiny, sign * DENORMAL)
        (a, first), (b, second) = call(library, face, zero), call(library, face, tiny)
        np.testing.assert_array_equal(first, second)
        assert np.any(first == Status.OK) and np.max(np.abs(a - b)) < np.finfo(float).tiny
