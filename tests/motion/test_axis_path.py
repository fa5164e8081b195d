"""A motion of six axes along a path: the F1 restricted to its path coordinate, in five and six degrees of freedom."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import SolveStatus
from gtmodel.motion import Arc, AxisEnd, AxisMesh, Line, Obstacle, Polyline, ToolCourse, ToolDirection
from gtmodel.motion.axes import AxisPlan, turning
from gtmodel.results import ArgumentError
from tests.motion.axis_problems import FORCE, PLACE, SPEED, START, STROKE, TORQUE, along, free, planned, studied

STEP = 1e-3  # of s, for differences: second order
SAME_PLACE = 1e-9
BETWEEN_MIDDLES = 0.05  # limits hold in the middles of 80 intervals; forces jump at their ends, by up to 3 %
LIMITS = np.repeat([FORCE, TORQUE], 3)


@cache
def declared() -> AxisPlan:
    return planned(along())


def followed(plan: AxisPlan, s: np.ndarray, ds: float = 0.0) -> list[np.ndarray]:
    f = plan.following
    *found, status = f(s, ds + 0 * s, *[0 * s] * (len(f.inputs) - 2))
    assert np.all(status == 0)
    return found


def test_forward_kinematics_of_the_axes_is_the_declared_course():
    plan = declared()
    s = np.linspace(0.0, 1.0, 41)
    _, q, *_ = followed(plan, s)
    T, R, status = plan.robot.causal("q", ["T", "R"])(q)
    assert np.all(status == 0) and plan.course is not None
    assert T == pytest.approx(plan.course.path(s)[0], abs=SAME_PLACE)
    wanted = plan.course.turning(s)
    assert R @ [1.0, 0.0, 0.0] == pytest.approx(wanted / np.linalg.norm(wanted, axis=1)[:, None], abs=SAME_PLACE)
    assert wanted[-1] == pytest.approx(np.array([0.15, -0.15, -1.0]) / np.linalg.norm([0.15, -0.15, -1.0]))
    assert q[:, 4] == pytest.approx(-q[:, 3], abs=1e-12)
    assert q[[0, -1]] == pytest.approx(np.array([plan.start, plan.goal]), abs=SAME_PLACE)


def test_axes_forces_and_their_derivatives():
    """Differences of the axes over s, and the dynamics of known axes, against the restricted model."""
    plan = declared()
    s = np.array([0.1, 0.25, 0.8])
    tau, q, dq, ddq, *_ = followed(plan, s, 1.3)
    beside = [followed(plan, s + k * STEP)[1] for k in (-1, 1)]
    assert dq == pytest.approx(1.3 * (beside[1] - beside[0]) / (2 * STEP), rel=1e-3, abs=1e-4)
    assert ddq == pytest.approx(1.3**2 * (beside[1] - 2 * q + beside[0]) / STEP**2, rel=1e-2, abs=1e-2)
    needed, status = plan.inverse(q, dq, ddq)
    assert np.all(status == 0) and tau == pytest.approx(needed, abs=1e-6)


def test_squared_speeds_keep_forces_and_speed():
    plan = declared()
    motion = plan.by_squared_speeds(80)
    assert motion.status is SolveStatus.SOLVED
    times = np.linspace(0.05, 0.95, 121) * motion.final_time
    s, v, a = motion.at(times)
    _, q, dq, ddq, *_ = plan.following(s, v, a)
    tau, status = plan.inverse(q, dq, ddq)
    share = np.max(np.abs(tau) / LIMITS, axis=1)
    assert plan.course is not None
    speed = np.linalg.norm(plan.course.path(s)[1] * v[:, None], axis=1) / SPEED
    assert np.all(status == 0) and np.max(share) < 1 + BETWEEN_MIDDLES and np.max(speed) < 1 + BETWEEN_MIDDLES
    assert np.mean(np.maximum(share, speed) > 0.95) > 0.5  # fast, for all that the energy costs a little


def test_courses_of_directions():
    at, way = np.array([0.0, 0.3, 1.0]), np.array([[0.0, 0.0, -2.0], [0.3, 0.0, -1.0], [0.3, 0.3, -1.0]])
    curve = turning(at, way, "tool.through")
    assert curve(at) == pytest.approx(way / np.linalg.norm(way, axis=1)[:, None])
    inner = np.linspace(0.01, 0.99, 99)
    assert curve(inner, 1) == pytest.approx((curve(inner + 1e-5) - curve(inner - 1e-5)) / 2e-5, abs=1e-6)
    constant = turning(at, np.tile(way[:1], (3, 1)), "tool.through")
    assert np.all(constant(inner) == [0.0, 0.0, -1.0]) and not np.any(constant(inner, 1))
    e = np.array([[1.0, 0.0, 0.0, 0.0], [-1.0, 0.1, 0.0, 0.0]])  # the nearer sign of a quaternion
    assert turning(at[[0, 2]], e, "goal")(1.0)[0] > 0.9
    with pytest.raises(ArgumentError, match="turns by 180 degrees between 0 % and 30 % of the path"):
        turning(at, np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 1.0, -1.0]]), "tool.through")


def through(*at: float) -> ToolCourse:
    return ToolCourse(through=[ToolDirection(x, [0.0, 0.0, -1.0]) for x in at])


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"goal": replace(PLACE, carts=[0.9, 0.5, 0.35])}, "goal.carts"),
        ({"goal": AxisEnd([0.9, 0.5, 0.35])}, "goal.axes"),
        ({"degrees_of_freedom": 6}, "goal.tool"),
        ({"degrees_of_freedom": 6, "goal": replace(PLACE, tool=None), "tool": through(0.5)}, "tool.through"),
        ({"start": replace(START, tool=[0.0, 0.0, -1.0])}, "start.tool"),
        ({"goal": replace(PLACE, tool=[0.0] * 3)}, "goal.tool"),
        ({"tool": ToolCourse([0.0] * 3)}, "tool.axis"),
        ({"tool": through(0.6, 0.5)}, "tool.through"),
        ({"tool": ToolCourse(through=[ToolDirection(0.5, [0.0] * 3)])}, "tool.through[0].direction"),
        ({"goal": replace(PLACE, tool=[0.0, 0.0, 1.0])}, "goal"),
        ({"goal": replace(PLACE, tcp=[-0.32, 5.0, 0.3])}, "goal.tcp"),
        ({"path": Polyline([[-0.16, 2.32, 0.22]], blend=1.0)}, "path.blend"),
        ({"limits": replace(along()["limits"], axis_high=[STROKE, STROKE, np.radians(0.5)])}, "goal.tcp"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(changes: dict[str, Any], argument: str):
    with pytest.raises(ArgumentError) as caught:
        planned(along(**changes))
    assert caught.value.argument == argument and caught.value.message


@pytest.mark.proof
def test_declared_problem():
    """All checks pass, six free axes follow the forces, and the free motion between the same axes is faster."""
    o = studied(along())
    assert o.status is SolveStatus.SOLVED and all(check.passed for check in o.checks.values()), o.message
    assert o.path_error is not None and o.path_error < SAME_PLACE
    assert o.end_error is not None and o.end_error < 2.5e-4
    run = o.trajectory
    assert isinstance(run, gt.Trajectory)
    speed = np.linalg.norm(np.gradient(run["T"], run.time, axis=0), axis=1)
    assert 0.9 * SPEED < np.max(speed) < 1.02 * SPEED
    q = run["q"]
    start, goal = (AxisEnd(x[:3].tolist(), [x[3], -x[3], x[5]]) for x in (q[0], q[-1]))
    unbound = studied(free(start=start, goal=goal))
    assert unbound.status is SolveStatus.SOLVED and (unbound.objective or np.inf) < (o.objective or 0.0)


def within(**limits: Any) -> dict[str, Any]:
    return {"limits": replace(along()["limits"], **limits)}


@pytest.mark.proof
@pytest.mark.parametrize(
    "changes",
    [
        within(tcp_acceleration=5.0),
        within(cart_velocity=0.4),
        within(cart_acceleration=4.0),
        within(axis_velocity=np.radians(15.0)),
        within(axis_acceleration=np.radians(200.0)),
        within(obstacles=[Obstacle([0.0, 2.0, 0.0], [0.1, 0.1, 0.1])]),
        {"robot": gt.robots.catalogue.make("f1", payload=3.0)},
        {"degrees_of_freedom": 6, "goal": AxisEnd(tcp=[-0.32, 2.15, 0.32])},
        {"path": Line(), "tool": ToolCourse(through=[ToolDirection(0.5, [-0.1, 0.1, -1.0])])},
        {"path": Arc([-0.2, 2.25, 0.2]), "start": AxisEnd(tcp=[-0.18, 2.3, 0.0])},
        {"path": Line(), **within(tcp_jerk=80.0)},
    ],
)
def test_limits_and_courses(changes: dict[str, Any]):
    """Ten elements: found, on the path, and within half a tenth of the motion by squared speeds."""
    o = studied(along(mesh=AxisMesh(10), **changes))
    assert o.status is SolveStatus.SOLVED and o.path_error is not None and o.path_error < SAME_PLACE
    second = o.cross_check_time
    jerk = changes.get("limits") is not None and changes["limits"].tcp_jerk is not None
    assert (second is None) == jerk
    assert second is None or 0 <= (o.final_time or 0.0) / second - 1 < 0.05
