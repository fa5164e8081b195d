"""Robots on measured cart points: forward kinematics against the closure by hand; points that cannot be theirs."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, Status
from gtmodel.geometry.quaternions import quaternion_matrix
from gtmodel.robots.three_link import on_measured_points

AT = np.linspace(-2.0, 2.0, 21)
U = np.array([0.9, 0.1, -0.2, 0.3]) / np.linalg.norm([0.9, 0.1, -0.2, 0.3])
ARM = 1


@pytest.fixture(scope="module")
def recorded() -> tuple[gt.Model, np.ndarray]:
    """The L1 and bent points of its second cart, in a frame of their own."""
    robot = gt.robots.gantry_tau("l1_tape")
    A, v = np.array(robot.A, float)[ARM], np.array(robot.v, float)[ARM]
    bent = np.column_stack([0 * AT, 2e-3 * np.sin(AT), 3e-3 * AT**2])
    return robot, (A + AT[:, None] * v + bent - [3.0, 4.0, 5.0]) @ quaternion_matrix(U)


@pytest.mark.parametrize("sign", [1, -1])
def test_forward_kinematics_closes_on_the_points(recorded: tuple[gt.Model, np.ndarray], sign: int) -> None:
    robot, points = recorded
    on, names = on_measured_points(robot, AT, {ARM: points}, sign * U)
    A, v, L = (np.array(getattr(robot, n), float) for n in "AvL")
    placed = points @ quaternion_matrix(U).T
    placed += np.mean(A[ARM] + AT[:, None] * v[ARM] - placed, axis=0)
    f = on.causal("q", "T")
    assert names == ["arm[1].guideway"]
    for q in np.random.default_rng(8).uniform(-1.3, -0.9, (10, 3)):
        T, status = f(q)
        joints = A + q[:, None] * v
        joints[ARM] = [np.interp(q[ARM], AT, placed[:, k]) for k in range(3)]
        assert status is Status.OK and np.allclose(np.linalg.norm(T - joints, axis=1), L, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "said"), [("mm", "move 1e[+]03 m"), ("backwards", "move -1 m"), ("frame", "move .* m")]
)
def test_points_that_do_not_go_along_are_refused(recorded: tuple[gt.Model, np.ndarray], change: str, said: str) -> None:
    robot, points = recorded
    other = {"mm": 1e3 * points, "backwards": points[::-1], "frame": points[:, [1, 2, 0]]}[change]
    with pytest.raises(ModelError, match=f"cart points of arm 2 {said} along its guideway .* expected about 1"):
        on_measured_points(robot, AT, {ARM: other}, U)
