"""Kind "axis_trajectory": the F1 from rest to rest, with q4 = -q5 or all axes free."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import SolveStatus
from gtmodel.kinds.axis_free_run import free_run
from gtmodel.kinds.axis_motion import AxisPlan
from gtmodel.kinds.axis_planning import plan_of
from gtmodel.problem_files import InputError, get
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import context_of, solve

PROBLEM = "problems/f1_motion.toml"
LENGTHS_M = 1e-9
FIVE_DOF_M = 0.02  # the printed clusters are parallelograms but for about 15 mm
FREE_M = 1e-6  # cubic splines of 161 sampled forces; 81 leave 4e-6
SLOW_S = 0.4


def planned(*settings: str) -> AxisPlan:
    loaded = load(PROBLEM, list(settings))
    return plan_of(loaded.problem, context_of(loaded))  # type: ignore[arg-type]  # of that kind


@pytest.fixture(scope="module")
def plan() -> AxisPlan:
    return planned()


def test_ends_and_guess_of_the_declared_problem(plan: AxisPlan):
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


def test_explained_problem():
    loaded = load(PROBLEM)
    told = get("axis_trajectory").explain(loaded.problem, context_of(loaded))  # type: ignore[attr-defined]
    assert "torn form, 20 elements x 3 Radau points, 5 degrees of freedom" in told
    assert "forces within 1000 N, torques within 40 N.m" in told
    assert "robot.T[0]" in told and "robot.e[3]" in told and "q4 -45 deg to 45 deg" in told


@pytest.mark.parametrize(
    ("settings", "key", "words"),
    [
        (["robot=l1_tape"], "robot", "'l1_tape' is a GantryTau; kind trajectory"),
        (["cost.time=0", "cost.energy=0"], "cost", "both weights are zero"),
        (["goal.q_deg=[12, -11, -9]"], "goal.q_deg", "q5 = -11 is not -q4 = -12"),
        (["goal.q_m=[0.72, 0.26, 0.21]", "goal.q_deg=[0, 0, 0]"], "goal", "equals the start"),
        (["limits.cart_high_m=[1, 0.4, 1]"], "goal.q_m", "q2 = 0.5 is above limits.cart_high_m, 0.4"),
        (["limits.axis_low_deg=[-45, -45, -8]"], "goal.q_deg", "q6 = -9 is below limits.axis_low_deg, -8"),
        (["limits.cart_low_m=[0, 2, 0]"], "limits.cart_low_m", "number 2, 2, is not below 1.2 of cart_high_m"),
        (["limits.force_N=400"], "limits.force_N", "the weight alone needs 486 N of motor 3 to stand at start"),
        (
            ["goal.q_m=[0.72, 0.26, 1.19]", "goal.q_deg=[0, 0, 0]"],
            "goal",
            "links cannot close there: the iteration did",
        ),
    ],
)
def test_wrong_inputs_are_one_sentence(settings: list[str], key: str, words: str):
    with pytest.raises(InputError) as caught:
        planned(*settings)
    assert caught.value.key == key and words in caught.value.sentence


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
        free = free_run(plan.robot, run, 8)
        assert not free.message
        assert (np.max(np.abs(free.q - plan.goal)) < FREE_M) == reached
        assert (np.max(np.abs(free.velocity)) < 100 * FREE_M) == reached
        assert (free.uncoupled < FREE_M) == reached


@pytest.mark.proof
def test_declared_problem():
    """All checks pass, values are as announced, and the closed 5-DOF kinematics goes the same way."""
    loaded = load(PROBLEM)
    o = solve(loaded, context_of(loaded)).outcome
    assert o.status is SolveStatus.SOLVED and all(check.passed for check in o.checks.values()), o.message
    assert set(o.values) == set(get("axis_trajectory").VALUES)
    run = o.trajectory
    assert run is not None and np.max(np.abs(run["q"][:, 3] + run["q"][:, 4])) < 1e-12
    assert np.allclose(run["der(q)"][[0, -1]], 0, atol=1e-6)
    share = np.abs(run["tau"]) / np.repeat([1000.0, 40.0], 3)
    assert np.any(np.max(share[:, :3], axis=1) > 0.99) and np.max(share) < 1.01
    five = gt.robots.f1_five_dof().causal("q", "T")
    T, status = five(run["q"][:, [0, 1, 2, 3, 5]])
    assert np.all(status == 0) and np.max(np.linalg.norm(T - run["T"], axis=1)) < FIVE_DOF_M


@pytest.mark.proof
def test_strokes_and_six_degrees_of_freedom():
    """The declared optimum swings q6 the wrong way first; a stroke forbids that, and costs time. Six free axes gain."""
    costs, most = [], []
    for settings in ([], ["limits.axis_high_deg=[45, 45, 1]"], ["degrees_of_freedom=6"]):
        loaded = load(PROBLEM, ["mesh.elements=10", *settings])
        o = solve(loaded, context_of(loaded)).outcome
        assert o.status is SolveStatus.SOLVED and o.trajectory is not None
        costs.append(o.objective)
        most.append(np.degrees(np.max(o.trajectory["q"][:, 5])))
    assert most[0] > 2 and most[1] < 1.01
    assert costs[2] < costs[0] < costs[1]


def test_a_coarse_mesh_is_refined_until_the_checks_hold():
    loaded = load(PROBLEM, ["mesh.elements=6"])
    o = solve(loaded, context_of(loaded)).outcome
    assert o.status is SolveStatus.SOLVED and o.values["elements"] > 6, o.message
    assert f"on {o.values['elements']} elements: on the given 6 peak_share" in o.message
    left = load(PROBLEM, ["mesh.elements=6", "mesh.most_elements=6"])
    kept = solve(left, context_of(left)).outcome
    assert kept.status is SolveStatus.CHECK_FAILED and kept.values["elements"] == 6
