"""Kind "trajectory" with the six-link D1 along a path: the plate turns as its links make it, Newton at every node."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import SolveStatus
from gtmodel.motion.planning import Plan, plan_of
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import context_of, solve
from gtmodel.results import Trajectory

PROBLEM, FREE = "problems/d1_six_link_line.toml", "problems/d1_six_link_motion.toml"
LINE = 'path.shape="line"'
FORCE_N, SPEED_M_S, CART_M_S2 = 700.0, 0.7, 4.0  # of the declared problem
BETWEEN_NODES = 0.01  # limits hold on both sides of each of 80 nodes; between them they bend by some 0.1 %
STEP_S = 1e-4  # of finite differences: round-off of Newton leaves 1e-4 m/s2, curvature less
DIFFERENCES_N = 0.5
ORACLE = 1e-3  # both are of second order or better in 150 intervals


AXIS, HALF_DEG = [1.0, 0.0, 0.0], 60.0


def planned(problem: str, *settings: str) -> Plan:
    loaded = load(problem, list(settings))
    return plan_of(loaded.problem.motion(context_of(loaded)))  # type: ignore[arg-type]  # of that kind


@cache
def declared() -> tuple[Plan, Trajectory]:
    """The declared problem, with a cone that it keeps, by squared speeds; sampled finely but for its ends."""
    plan = planned(PROBLEM, f"limits.joint_cones=[{{arm=3, end='plate', axis={AXIS}, half_angle_deg={HALF_DEG}}}]")
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

    still = "parameters={coulomb=[0.0,0.0,0.0],viscous=[0.0,0.0,0.0]}"
    plan = planned(FREE, LINE, "cost.energy=0", f"limits.cart_acceleration_m_s2={CART_M_S2}", still)
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
    outcomes = {}
    for name, settings in ((PROBLEM, ()), (FREE, ()), (FREE, (LINE,))):
        loaded = load(name, list(settings))
        o = outcomes[name, settings] = solve(loaded, context_of(loaded)).outcome
        assert o.status is SolveStatus.SOLVED and all(check.passed for check in o.checks.values()), o.message
    limited, free, line = (o.objective for o in outcomes.values())
    assert free < line < limited


@pytest.mark.proof
@pytest.mark.parametrize(
    "settings",
    [
        ("limits.tcp_velocity_m_s=0.5",),
        ("limits.tcp_acceleration_m_s2=2.5",),
        ("limits.tcp_jerk_m_s3=40",),
        ("limits.cart_velocity_m_s=0.5",),
        ("payload_kg=5",),
        ('path.shape="polyline"', "path.via_m=[[-1.4,-4.4,-0.1]]"),
        ('path.shape="arc"', "path.through_m=[-1.35,-4.4,-0.05]"),
    ],
    ids=lambda s: s[0],
)
def test_limits_and_shapes(settings: tuple[str, ...]):
    """Solved within every limit, and each of them costs: 1.0917538 on the bare line."""
    loaded = load(FREE, [LINE, "path.intervals=100", *settings])
    o = solve(loaded, context_of(loaded)).outcome
    assert o.status is SolveStatus.SOLVED and all(check.passed for check in o.checks.values()), o.message
    assert (o.objective or 0.0) > 1.0917 and o.values["exported_peak_force_N"] <= FORCE_N
    assert min(o.values["exported_margins"].values(), default=0.0) > -1e-4
    assert isinstance(o.trajectory, gt.Trajectory)
