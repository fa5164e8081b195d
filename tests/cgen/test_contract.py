"""Issue 8, point 2: 100,000 calls in C. What has no answer gets a status, and what is ok solves the closures.

The closures are written here again from the parameters (Dressler 2012, sections 3.2 and 4.4), not taken from the code.
"""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.cgen.interface import Interface, interfaces
from gtmodel.cgen.points import HELD
from gtmodel.cgen.verification.comparison import call
from tests.cgen.calls import denormals, shared_library, spoilt_draws

# draws of each function, 100,000 in all
DRAWS = {"fk": 20_000, "ik": 20_000, "velocity": 20_000, "inverse_dynamics": 20_000, "six_link_fk": 20_000}
# squared lengths of some metres, closed forms and Newton's residual limit alike
RESIDUAL_M2 = 1e-9


@pytest.fixture(scope="module")
def robots() -> tuple[gt.Model, gt.Model]:
    return gt.robots.gantry_tau("l1_tape"), gt.robots.six_link_gantry_tau()


@pytest.fixture(scope="module")
def faces(robots: tuple[gt.Model, gt.Model]) -> dict[str, Interface]:
    three, six = robots
    functions = {
        "fk": three.causal("q", "T"),
        "ik": three.causal("T", "q"),
        "velocity": three.causal("T", ["q", "der(q)"]),
        "inverse_dynamics": three.causal("T", "tau"),
        "six_link_fk": six.causal("q", ["T", "e"]),
    }
    return {face.key: face for face in interfaces(functions, "p")}


@pytest.fixture(scope="module")
def library(faces: dict[str, Interface], tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    place = tmp_path_factory.mktemp("contract")
    return shared_library(cgen.generate({k: f.function for k, f in faces.items()}, place / "p", name="p").folder, place)


def closures(key: str, robots: tuple[gt.Model, gt.Model], inputs: np.ndarray, outputs: np.ndarray) -> np.ndarray:
    """|T + R B - A - q v|^2 - L^2 of every link, (rows, links)."""
    three, six = robots
    if key == "six_link_fk":
        A, v, L, B = (np.array(getattr(six, n), dtype=float) for n in ("A", "v", "L", "B"))
        q, T, e = inputs[:, [0, 1, 1, 2, 2, 2]], outputs[:, :3], outputs[:, 3:7]
        w, u = e[:, :1, None], e[:, None, 1:]
        turned = B + 2 * np.cross(u, np.cross(u, B[None]) + w * B[None])
    else:
        A, v, L = (np.array(getattr(three, n), dtype=float) for n in ("A", "v", "L"))
        q, T = (inputs, outputs) if key == "fk" else (outputs[:, :3], inputs[:, :3])
        turned = np.zeros((len(T), 3, 3))
    d = T[:, None] + turned - A - q[:, :, None] * v
    return np.sum(d * d, axis=2) - L**2


@pytest.mark.parametrize("key", list(DRAWS))
def test_a_status_for_every_call(
    key: str, faces: dict[str, Interface], library: ctypes.CDLL, robots: tuple[gt.Model, gt.Model]
) -> None:
    face = faces[key]
    inputs, spoilt = spoilt_draws(face, DRAWS[key])
    outputs, status = call(library, face, inputs)
    ok = status == Status.OK
    assert np.all(status[spoilt] == Status.NOT_FINITE)
    assert np.all(outputs[~ok] == HELD) and np.all(np.isfinite(outputs[ok]))
    assert 0.15 * len(inputs) < ok.sum() < 0.7 * len(inputs)
    if key != "inverse_dynamics":
        assert np.max(np.abs(closures(key, robots, inputs[ok], outputs[ok]))) < RESIDUAL_M2
    if key in ("ik", "velocity", "inverse_dynamics"):
        three = robots[0]
        A, L = (np.array(getattr(three, n), dtype=float) for n in ("A", "L"))
        with np.errstate(invalid="ignore"):
            across = inputs[:, None, 1:3] - A[:, 1:]
            beyond = np.any(np.sum(across * across, axis=2) > L**2 * (1 + 1e-12), axis=1)
        assert beyond[~spoilt].sum() > 1000 and np.all(status[beyond] != Status.OK)


@pytest.mark.parametrize("key", list(DRAWS))
def test_a_denormal_is_a_zero(key: str, faces: dict[str, Interface], library: ctypes.CDLL) -> None:
    face = faces[key]
    for zero, tiny in denormals(face):
        (a, first), (b, second) = call(library, face, zero), call(library, face, tiny)
        np.testing.assert_array_equal(first, second)
        assert np.any(first == Status.OK) and np.max(np.abs(a - b)) < np.finfo(float).tiny


def test_exactly_singular_poses(faces: dict[str, Interface], library: ctypes.CDLL, robots: tuple) -> None:
    """A link at right angles to its guideway: no velocity of the cart follows from that of the tool centre point."""
    A, L = np.array(robots[0].A, dtype=float), np.array(robots[0].L, dtype=float)
    face = faces["velocity"]
    rows = []
    for arm, length in zip(A, L, strict=True):
        for turn in np.linspace(0.0, 2 * np.pi, 300):
            T = arm + length * np.array([0.0, np.cos(turn), np.sin(turn)])
            rows.append([*T, 0.1, 0.2, 0.3])
    _, status = call(library, face, np.array(rows))
    assert not np.any(status == Status.OK)
    assert np.any(status == Status.SINGULAR) and np.any(status == Status.OUT_OF_RANGE)
