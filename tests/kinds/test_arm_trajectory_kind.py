"""Kind "arm_trajectory": keys of the file, and where refusals stand in it."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.problem_files import InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.registry import results_of
from gtmodel.problem_files.run import answer, context_of
from gtmodel.results import SolveStatus
from gtmodel.results.quantity import described

PROBLEM = "problems/ur_like_motion.toml"


def solved(*settings: str):
    loaded = load(PROBLEM, list(settings))
    return answer(loaded, context_of(loaded))


def test_the_file_becomes_the_call() -> None:
    loaded = load(PROBLEM, ["goal={tcp_m=[0.3, 0.2, 0.4]}", "waypoints=[{q_deg=[0, 60, -60, -90, -90, 0], stop=true}]"])
    call = loaded.kind.call(loaded.problem, context_of(loaded))  # type: ignore[attr-defined]
    asked = call.options
    assert asked["goal"].tcp == [0.3, 0.2, 0.4] and asked["goal"].q is None
    assert asked["waypoints"][0].stop and asked["waypoints"][0].q == np.radians([0, 60, -60, -90, -90, 0]).tolist()
    assert asked["clearance"].distance == 0.02 and asked["clearance"].boxes[0].size == [0.3, 0.2, 0.3]
    assert asked["mesh"].elements == 12 and asked.get("cost") is None


@pytest.mark.proof
def test_the_shipped_problem_is_solved() -> None:
    s = solved()
    assert s.status is SolveStatus.SOLVED, s.message
    assert list(s.values) == list(described(*results_of("arm_trajectory")))  # type: ignore[attr-defined]
    assert 0.02 <= s.clearance < 0.0211 and max(s.peak_effort) <= 1.01
    assert s.final_time == pytest.approx(0.882, abs=0.02)


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (['robot="l1_tape"', "parameters={}"], "robot"),
        (["start.q_deg=[0, 0]"], "start.q_deg"),
        (["start.q_deg=[0, 400, 0, 0, 0, 0]"], "start.q_deg"),
        (["start={tcp_m=[0.3, 0.2, 2.0], rpy_deg=[180.0, 0.0, 90.0]}"], "start.tcp_m"),
        (["goal={tcp_m=[0.5, 0.0, 0.2], rpy_deg=[180.0, 0.0, 90.0]}"], "goal.tcp_m"),
        (["waypoints=[{q_deg=[0, 60, -100, -50, -90, 0]}]"], "waypoints[0].q_deg"),
        (["goal.rpy_deg=[0, 0, 0]"], "goal.rpy_deg"),
        (["limits.joint_acceleration_rad_s2=[1.0]"], "limits.joint_acceleration_rad_s2"),
        (["limits.speed=1.5"], "limits.speed"),
        (['clearance.ignored=[["wrist_1", "hand"]]'], "clearance.ignored[0]"),
        (["clearance.planes=[{point_m=[0,0,0],normal=[0,0,0]}]"], "clearance.planes[0].normal"),
        (
            ['clearance.capsules=[{link="hand",begin_m=[0,0,0],end_m=[0,0,0],radius_m=0.1}]'],
            "clearance.capsules[0].link",
        ),
    ],
)
def test_wrong_inputs_name_their_key(settings, key) -> None:
    with pytest.raises(InputError) as caught:
        solved(*settings)
    assert caught.value.key == key and caught.value.message
