"""Motions of the six-link D1 along a path: the plate turns as its links make it, Newton at every node."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import SolveStatus
from gtmodel.motion import Arc, JointCone, Line, MotionProblem, Polyline
from gtmodel.motion.motion_study import solved
from gtmodel.motion.planning import MotionPlan, plan_of
from gtmodel.results import Trajectory, Work
from gtmodel.robots import make
from tests.support.motions import d1, six_link

LINE = Line(intervals=100)
FORCE_N, SPEED_M_S, CART_M_S2 = 700.0, 0.7, 4.0  # of the declared problem
BETWEEN_NODES = 0.01  # limits hold on both sides of each of 80 nodes; between them they bend by some 0.1 %
STEP_S = 1e-4  # of finite differences: round-off of Newton leaves 1e-4 m/s2, curvature less
DIFFERENCES_N = 0.5
ORACLE = 1e-3  # both are of second order or better in 150 intervals


AXIS, HALF_DEG = [1.0, 0.0, 0.0], 60.0


def on_the_line(**changes: Any) -> MotionProblem:
    """The motion of problems/d1_six_link_line.toml."""
    return six_link(path=Line(), limits__tcp_velocity=SPEED_M_S, limits__cart_acceleration=CART_M_S2, **changes)


@cache
def declared() -> tuple[MotionPlan, Trajectory]:
    """The declared problem, with a cone that it keeps, by squared speeds; sampled finely but for its ends."""
    plan = plan_of(on_the_line(limits__joint_cones=[JointCone(3, "plate", AXIS, np.radians(HALF_DEG))]))
    motion = plan.follower.fastest(80)
    assert motion.status is SolveStatus.SOLVED, motion.message
    return plan, plan.follower.sample(motion, np.linspace(0.02, motion.final_time - 0.02, 301))


def test_the_plate_turns_on_the_way():
    plan, run = declared()
    R, status = plan.robot.causal("T", "R")(run["T"])
    assert np.all(status == 0)
    turned = np.degrees(np.arccos(np.clip((np.trace(R[-1] @ R[0].T) - 1) / 2, -1, 1)))
    assert turned > 0.05
    step = plan.goal - plan.start
    s = (run["T"] - plan.start) @ step / (step @ step)
    assert run["T"] == pytest.approx(plan.start + np.outer(s, step), abs=1e-12)


def test_limits_hold_and_the_carts_need_these_forces():
    """Another road: cart positions beside each instant by inverse kinematics, differences, dynamics of known carts."""
    plan, run = declared()
    inverse, forces = plan.robot.causal("T", "q"), plan.robot.causal("q", "tau")
    v, a = run["der(T)"], run["der(T,2)"]
    q = [inverse(run["T"] + h * v + h**2 / 2 * a)[0] for h in (-STEP_S, 0.0, STEP_S)]
    dq, ddq = (q[2] - q[0]) / (2 * STEP_S), (q[2] - 2 * q[1] + q[0]) / STEP_S**2
    tau, status = forces(q[1], dq, ddq)
    assert np.all(status == 0) and np.max(np.abs(tau - run["tau"])) < DIFFERENCES_N
    most = {"force": (np.max(np.abs(tau)), FORCE_N), "speed": (np.max(np.linalg.norm(v, axis=1)), SPEED_M_S),
            "cart": (np.max(np.abs(ddq)), CART_M_S2)}  # fmt: skip
    for name, (found, limit) in most.items():
        assert found < limit * (1 + BETWEEN_NODES), name
    shares = np.stack([np.max(np.abs(tau), axis=1) / FORCE_N, np.linalg.norm(v, axis=1) / SPEED_M_S,
                       np.max(np.abs(ddq), axis=1) / CART_M_S2])  # fmt: skip
    assert np.mean(np.max(shares, axis=0) > 0.98) > 0.9  # the fastest motion touches one of its limits nearly always


@pytest.mark.proof
def test_against_toppra():
    """Without friction the rows are linear in s'' and s'^2, which is what toppra takes; forces from the carts' side."""
    pytest.importorskip("toppra", reason="toppra is not installed")
    from toppra import SplineInterpolator
    from toppra.algorithm import TOPPRA
    from toppra.constraint import LinearConstraint

    still = make("d1_six_link", coulomb=np.zeros(3), viscous=np.zeros(3))
    plan = plan_of(six_link(robot=still, path=LINE, cost__energy=0.0, limits__cart_acceleration=CART_M_S2))
    own = plan.follower.fastest(150, bounded="middle")
    assert own.status is SolveStatus.SOLVED
    grid = np.linspace(0.0, 1.0, 301)
    q, _ = plan.robot.causal("T", "q")(plan.path(grid)[0])  # type: ignore[misc]  # there is one
    forces = plan.robot.causal("q", "tau")

    class Rows(LinearConstraint):
        def __init__(self):
            super().__init__()
            self.identical, self.dof = True, 3

        def compute_constraint_params(self, path, gridpoints):
            at, slope, bend = (path(gridpoints, k) for k in range(3))
            rest, _ = forces(at, 0 * at, 0 * at)
            mass, centre = forces(at, 0 * at, slope)[0] - rest, forces(at, slope, bend)[0] - rest
            limit = np.tile(np.repeat([FORCE_N, CART_M_S2], 3), 2)
            both = np.vstack([np.eye(6), -np.eye(6)])
            return (
                np.hstack([mass, slope]),
                np.hstack([centre, bend]),
                np.hstack([rest, 0 * at]),
                both,
                limit,
                None,
                None,
            )

    found = TOPPRA([Rows()], SplineInterpolator(grid, q), grid, "seidel").compute_parameterization(0, 0)
    speed = np.asarray(found[1])
    time = np.sum(2 * np.diff(grid) / (speed[1:] + speed[:-1]))
    assert own.final_time == pytest.approx(time, rel=ORACLE)


def test_cone_of_a_joint_that_turns_with_the_plate():
    """The axis is declared where the motion starts, and turns with the plate from there."""
    plan, run = declared()
    T = np.vstack([plan.start, run["T"]])
    a, b, R, _ = plan.robot.causal("T", ["link[3].rod.a.r", "link[3].rod.b.r", "R"])(T)
    way = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
    expected = np.einsum("ni,nij,j->n", way, R, R[0].T @ AXIS) - np.cos(np.radians(HALF_DEG))
    (k,) = (k for k, margin in enumerate(plan.guard.margins) if margin.key == "joint_cones[0]")
    assert run["margin"][:, k] == pytest.approx(expected[1:], abs=1e-9)
    unturned = way @ AXIS - np.cos(np.radians(HALF_DEG))
    assert np.max(np.abs(unturned[1:] - expected[1:])) > 1e-6


@pytest.mark.proof
def test_declared_problem_is_never_better_than_the_free_motion():
    found = [solved(problem, Work()) for problem in (on_the_line(), six_link(), six_link(path=Line()))]
    for o in found:
        assert o.status is SolveStatus.SOLVED and all(check.passed for check in o.checks.values()), o.message
    limited, free, line = (o.objective for o in found)
    assert free < line < limited


@pytest.mark.proof
@pytest.mark.parametrize(
    "changes",
    [
        {"limits__tcp_velocity": 0.5},
        {"limits__tcp_acceleration": 2.5},
        {"limits__tcp_jerk": 40.0},
        {"limits__cart_velocity": 0.5},
        {"robot": d1(payload=5.0)},
        {"path": Polyline([[-1.4, -4.4, -0.1]], intervals=100)},
        {"path": Arc([-1.35, -4.4, -0.05], intervals=100)},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_limits_and_shapes(changes: dict[str, Any]):
    """Solved within every limit, and each of them costs: 1.0917538 on the bare line."""
    o = solved(six_link(**{"path": LINE, **changes}), Work())
    assert o.status is SolveStatus.SOLVED and all(check.passed for check in o.checks.values()), o.message
    assert (o.objective or 0.0) > 1.0917 and (o.exported_peak_force or 0.0) <= FORCE_N
    assert min((o.exported_margins or {}).values(), default=0.0) > -1e-4
    assert isinstance(o.trajectory, gt.Trajectory)
