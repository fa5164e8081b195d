"""The study of a motion of six axes, called on objects: the F1 from rest to rest, with q4 = -q5 or all axes free."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.motion import AxisCost, AxisEnd, AxisLimits, AxisMesh
from gtmodel.motion.axes import AxisPlan, free_run
from gtmodel.results import ArgumentError, SolveStatus
from tests.motion.axis_problems import FORCE, GOAL, LIMITS, START, STROKE, TORQUE, along, free, planned, studied

LENGTHS_M = 1e-9
FIVE_DOF_M = 0.02  # the printed clusters are parallelograms but for about 15 mm
FREE_M = 1e-6  # cubic splines of 161 sampled forces; 81 leave 4e-6
SLOW_S = 0.4
SMOOTH = AxisCost(energy=10.0)


@pytest.fixture(scope="module", autouse=True)
def equations_kept() -> Iterator[None]:
    """Free motions that differ in mesh, guess and stop alone have the same equations: they are derived once."""
    known: dict[str, gt.Optimization] = {}
    derived = AxisPlan.optimization.func

    def kept(plan: AxisPlan) -> gt.Optimization:
        p = plan.problem
        key = repr((p.limits, p.cost, p.degrees_of_freedom, plan.start.tolist(), plan.goal.tolist()))
        return known.get(key) or known.setdefault(key, derived(plan))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(AxisPlan, "optimization", property(kept))
        yield


@pytest.fixture(scope="module")
def plan() -> AxisPlan:
    return planned(free())


def test_ends_and_guess(plan: AxisPlan):
    """At both ends every link has its length; the guess goes from rest to rest between them, q4 = -q5 all the way."""
    assert plan.goal[3] == -plan.goal[4] == np.radians(12.0)
    links = [f"link[{k}].{end}.r" for k in range(6) for end in "ab"]
    *joints, status = plan.robot.causal("q", links)(np.array([plan.start, plan.goal]))
    assert np.all(status == 0)
    lengths = np.stack([np.linalg.norm(a - b, axis=1) for a, b in zip(joints[::2], joints[1::2], strict=True)], axis=1)
    L = np.asarray(plan.robot.L, float)  # type: ignore[attr-defined]  # an F1's
    assert np.max(np.abs(lengths - L)) < LENGTHS_M
    guess = plan.guess()
    q = guess["s"] @ plan.coupling.T
    assert np.allclose(q[[0, -1]], [plan.start, plan.goal], rtol=0, atol=1e-12)
    assert np.all(q[:, 3] == -q[:, 4]) and not np.any(guess["der(s)"][[0, -1]])
    slope = np.gradient(guess["s"], guess.time, axis=0)
    assert np.max(np.abs(slope - guess["der(s)"])) < 0.01 < np.max(np.abs(slope))


def turned(*degrees: float) -> AxisEnd:
    return AxisEnd(GOAL.carts, np.radians(degrees).tolist())


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"robot": gt.robots.gantry_tau("l1_tape")}, "robot"),
        ({"cost": AxisCost(0.0, 0.0)}, "cost"),
        ({"degrees_of_freedom": 4}, "degrees_of_freedom"),
        ({"goal": turned(12, -11, -9)}, "goal.axes"),
        ({"goal": START}, "goal"),
        ({"goal": AxisEnd(GOAL.carts)}, "goal.axes"),
        ({"goal": AxisEnd(tcp=[-0.3, 2.2, 0.2])}, "goal.tcp"),
        ({"goal": replace(GOAL, tool=[0.0, 0.0, -1.0])}, "goal.tool"),
        ({"limits": replace(LIMITS, cart_high=[1.0, 0.4, 1.0])}, "goal.carts"),
        ({"limits": replace(LIMITS, axis_low=[-STROKE, -STROKE, -np.radians(8.0)])}, "goal.axes"),
        ({"limits": replace(LIMITS, cart_low=[0.0, 2.0, 0.0])}, "limits.cart_low"),
        ({"limits": replace(LIMITS, axis_low=[0.0, 1.0, 0.0])}, "limits.axis_low"),
        ({"limits": replace(LIMITS, force=400.0)}, "limits.force"),
        ({"limits": replace(LIMITS, torque=1.0)}, "limits.torque"),
        ({"goal": AxisEnd([0.72, 0.26, 1.19], [0.0, 0.0, 0.0])}, "goal"),
        ({"earlier": gt.Trajectory([0.0, 1.0], {"T": np.zeros((2, 3))})}, "earlier"),
    ],
)
def test_what_cannot_be_used_is_named(changes: dict[str, Any], argument: str):
    with pytest.raises(ArgumentError) as caught:
        studied(free(**changes))
    assert caught.value.argument == argument and caught.value.message


def test_strokes_may_be_arrays():
    strokes = {"cart_low": np.zeros(3), "axis_high": np.full(3, STROKE)}
    low, high = planned(free(limits=AxisLimits(FORCE, torque=TORQUE, **strokes))).strokes
    assert low.tolist() == [0.0] * 3 + [-np.inf] * 3 and high.tolist() == [np.inf] * 3 + [STROKE] * 3


@pytest.mark.proof
def test_forces_of_a_slow_motion_move_six_free_axes(plan: AxisPlan):
    """Inverse dynamics sampled, forward dynamics integrated: the goal again; with other forces not."""
    rows = np.linspace(0, SLOW_S, 161)
    r = (rows / SLOW_S)[:, None]
    way = plan.goal - plan.start
    q = plan.start + (10 * r**3 - 15 * r**4 + 6 * r**5) * way
    v = (30 * r**2 - 60 * r**3 + 30 * r**4) * way / SLOW_S
    a = (60 * r - 180 * r**2 + 120 * r**3) * way / SLOW_S**2
    tau, status = plan.inverse(q, v, a)
    assert np.all(status == 0)
    for factor, reached in ((1.0, True), (1.01, False)):
        run = gt.Trajectory(rows, {"q": q, "der(q)": v, "tau": factor * tau})
        found = free_run(plan.robot, run, 8)
        assert not found.message
        assert (np.max(np.abs(found.q - plan.goal)) < FREE_M) == reached
        assert (np.max(np.abs(found.velocity)) < 100 * FREE_M) == reached
        assert (found.uncoupled < FREE_M) == reached


@pytest.mark.proof
def test_the_optimum():
    """All checks pass, and the closed 5-DOF kinematics goes the same way."""
    o = studied(free())
    assert o.status is SolveStatus.SOLVED and all(check.passed for check in o.checks.values()), o.message
    run = o.trajectory
    assert run is not None and np.max(np.abs(run["q"][:, 3] + run["q"][:, 4])) < 1e-12
    assert np.allclose(run["der(q)"][[0, -1]], 0, atol=1e-6)
    share = np.abs(run["tau"]) / np.repeat([FORCE, TORQUE], 3)
    assert np.any(np.max(share[:, :3], axis=1) > 0.99) and np.max(share) < 1.01
    five = gt.robots.f1_five_dof().causal("q", "T")
    T, status = five(run["q"][:, [0, 1, 2, 3, 5]])
    assert np.all(status == 0) and np.max(np.linalg.norm(T - run["T"], axis=1)) < FIVE_DOF_M


@pytest.mark.proof
def test_strokes_and_six_degrees_of_freedom():
    """The optimum swings q6 the wrong way first; a stroke forbids that, and costs time. Six free axes gain."""
    costs, most = [], []
    stroke = replace(LIMITS, axis_high=[STROKE, STROKE, np.radians(1.0)])
    for changes in ({}, {"limits": stroke}, {"degrees_of_freedom": 6}):
        o = studied(free(mesh=AxisMesh(10), **changes))
        assert o.status is SolveStatus.SOLVED and o.trajectory is not None
        costs.append(o.objective)
        most.append(np.degrees(np.max(o.trajectory["q"][:, 5])))
    assert most[0] > 2 and most[1] < 1.01
    assert costs[2] < costs[0] < costs[1]


@pytest.fixture(scope="module")
def coarse():
    """On three elements whatever they leave; forces that cost much stay smooth, so that six are enough."""
    return studied(free(mesh=AxisMesh(3, 3), cost=SMOOTH))


@pytest.mark.proof
def test_a_coarse_mesh_is_refined_until_the_checks_hold(coarse):
    o = studied(free(mesh=AxisMesh(3), cost=SMOOTH, earlier=coarse.trajectory))
    assert o.status is SolveStatus.SOLVED and (o.elements or 0) > 3, o.message
    assert f"on {o.elements} elements, because on the given 3 end_error_m" in o.message
    assert coarse.status is SolveStatus.CHECK_FAILED and coarse.elements == 3
    assert o.rows[-1].value == o.elements and len(coarse.rows) == len(o.rows) - 1


def test_the_picture_draws_the_motion(coarse, monkeypatch):
    drawn = []
    monkeypatch.setattr("gtmodel.plot.motion.axis_motion_figure", lambda run, **more: drawn.append((run, more)))
    coarse.figure("motion")
    assert drawn == [(coarse.trajectory, {"force_limit": FORCE, "torque_limit": TORQUE, "path": None})]


def test_what_is_written_carries_degrees(coarse):
    assert coarse.values["turned_deg"] == pytest.approx(np.degrees(coarse.turned))
    assert coarse.values["end_error_deg"] == coarse.checks["end_error_deg"].value
    assert coarse.values["end_error_m"] == coarse.end_error and coarse.path_length is None


def test_an_earlier_motion_is_the_guess(coarse):
    again = planned(free(earlier=coarse.trajectory)).guess()
    assert again["s"] @ planned(free()).coupling.T == pytest.approx(coarse.trajectory["q"], abs=1e-12)
    with pytest.raises(ArgumentError) as caught:
        planned(along(earlier=coarse.trajectory))
    assert caught.value.argument == "earlier"


def test_stopped_it_holds_the_best_iterate(coarse):
    at_once = studied(free(mesh=AxisMesh(6), stop=lambda: True))  # before the model is made
    assert at_once.status is SolveStatus.INTERRUPTED and at_once.trajectory is None and at_once.rows == []
    iterations = [0]

    def progress(stage=None, fraction=None, numbers=None) -> None:
        iterations.append(int((numbers or {}).get("iteration", 0)))

    told: list[str | None] = []
    late = studied(
        free(mesh=AxisMesh(3), cost=SMOOTH, earlier=coarse.trajectory,
             progress=lambda stage=None, *_: told.append(stage),
             stop=lambda: "simulating all six axes" in told)
    )  # fmt: skip
    assert late.status is SolveStatus.INTERRUPTED and "stopped before it was simulated" in late.message
    assert late.final_time and late.end_error is None and "end_error_m" not in late.checks
    stopped = studied(free(mesh=AxisMesh(3), cost=SMOOTH, progress=progress, stop=lambda: iterations[-1] >= 2))
    assert stopped.status is SolveStatus.INTERRUPTED and stopped.trajectory is not None
    assert stopped.final_time is not None and [row.label for row in stopped.rows] == ["final time"]
