"""Kind "axis_trajectory": keys of the file, and where refusals stand in it."""

from __future__ import annotations

import pytest

from gtmodel.motion.axes import AxisProblem, plan_of
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.base import Call
from gtmodel.problem_files.load import load
from gtmodel.problem_files.registry import results_of
from gtmodel.problem_files.run import answer, context_of, explain, solve
from gtmodel.results import SolveStatus
from gtmodel.results.quantity import described
from tests.motion.axis_problems import along, free, planned

FREE, PATH = "problems/f1_motion.toml", "problems/f1_path.toml"


def called(problem: str, *settings: str) -> Call:
    loaded = load(problem, list(settings))
    return loaded.kind.call(loaded.problem, context_of(loaded))  # type: ignore[attr-defined]


@pytest.mark.parametrize(("problem", "given"), [(FREE, free), (PATH, along)])
def test_the_shipped_problems_ask_for_what_the_objects_do(problem, given) -> None:
    asked = called(problem).options
    by_file = plan_of(AxisProblem(**{name: value for name, value in asked.items() if value is not None}))
    by_hand = planned(given())
    assert by_file.start.tolist() == by_hand.start.tolist() and by_file.goal.tolist() == by_hand.goal.tolist()
    for name in ("start", "goal", "limits", "path", "cost", "degrees_of_freedom"):
        assert asked[name] == {"degrees_of_freedom": 5, "path": None, **given()}[name], name
    assert [m.key for m in by_file.guard.margins] == [m.key for m in by_hand.guard.margins]


@pytest.mark.proof
@pytest.mark.parametrize("problem", [FREE, PATH])
def test_the_shipped_problems_are_solved(problem) -> None:
    loaded = load(problem)
    o = solve(loaded, context_of(loaded)).outcome
    assert o.status is SolveStatus.SOLVED and o.values["elements"] == 20, o.message
    assert list(o.values) == list(described(*results_of("axis_trajectory")))  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("problem", "settings", "key"),
    [
        (FREE, ["robot=l1_tape"], "robot"),
        (FREE, ["cost.time=0", "cost.energy=0"], "cost"),
        (FREE, ["goal.q_deg=[12, -11, -9]"], "goal.q_deg"),
        (FREE, ["goal.q_m=[0.72, 0.26, 0.21]", "goal.q_deg=[0, 0, 0]"], "goal"),
        (FREE, ["goal={tcp_m=[-0.3,2.2,0.2]}"], "goal.tcp_m"),
        (FREE, ["limits.cart_high_m=[1, 0.4, 1]"], "goal.q_m"),
        (FREE, ["limits.axis_low_deg=[-45, -45, -8]"], "goal.q_deg"),
        (FREE, ["limits.cart_low_m=[0, 2, 0]"], "limits.cart_low_m"),
        (FREE, ["limits.axis_low_deg=[0, 50, 0]"], "limits.axis_low_deg"),
        (FREE, ["limits.force_N=400"], "limits.force_N"),
        (FREE, ["limits.torque_Nm=1"], "limits.torque_Nm"),
        (FREE, ["goal.q_m=[0.72, 0.26, 1.19]", "goal.q_deg=[0, 0, 0]"], "goal"),
        (FREE, ["limits.axis_velocity_deg_s=0"], "limits.axis_velocity_deg_s"),
        (FREE, ['mesh.control="cubic"'], "mesh.control"),
        (PATH, ["goal={q_m=[0.9,0.5,0.35]}"], "goal.q_deg"),
        (PATH, ["goal.q_m=[0.9,0.5,0.35]"], "goal.q_m"),
        (PATH, ["goal.tool=[0.0,0.0,0.0]"], "goal.tool"),
        (PATH, ["path.tool_axis=[0.0,0.0,0.0]"], "path.tool_axis"),
        (PATH, ["path.tool=[{at=0.6,direction=[0,0,-1.0]},{at=0.5,direction=[0,0,-1.0]}]"], "path.tool"),
        (PATH, ["path.tool=[{at=0.5,direction=[0,0,0.0]}]"], "path.tool[0].direction"),
        (PATH, ["path.through_m=[0.0,2.2,0.1]"], "path.through_m"),
        (PATH, ["goal.tcp_m=[-0.32,5.0,0.3]"], "goal.tcp_m"),
    ],
)
def test_wrong_inputs_name_their_key(problem, settings, key) -> None:
    with pytest.raises(InputError) as caught:
        answer(load(problem, settings), Context())
    assert caught.value.key == key and caught.value.message


def test_an_axis_beyond_its_stroke_is_refused_with_units() -> None:
    with pytest.raises(InputError, match=r"q6 = -9 deg is below limits\.axis_low, -8 deg"):
        answer(load(FREE, ["limits.axis_low_deg=[-45, -45, -8]"]), Context())


def test_explain_says_what_is_optimised() -> None:
    told = explain(load(FREE), Context())
    assert "torn form, 20 elements x 3 Radau points, 5 degrees of freedom" in told
    assert "forces within 1000 N, torques within 40 N.m" in told
    assert "robot.T[0]" in told and "robot.e[3]" in told and "q4 -45 deg to 45 deg" in told
