"""Limits of a URDF, and sentences for those who ask an arm for something that gtmodel does not have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files import InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import context_of, solve

ARM = Path(__file__).parents[2] / "problems" / "models" / "arm.urdf"
KNOWN = ["T", "R[2,0]", "R[2,1]", "R[1,0]"]
POSE = np.array([-0.6, 0.4, 1.0, 0.2, 0.8, 0.3])
ROUND_OFF = 1e-9


@pytest.fixture(scope="module")
def arm() -> gt.Model:
    return gt.robots.from_urdf(ARM)


def test_limits_of_speed_and_effort_are_those_of_the_file(arm) -> None:
    np.testing.assert_array_equal(arm.speed_limits, [3, 3, 3, 4, 4, 6])
    np.testing.assert_array_equal(arm.effort_limits, [120, 120, 80, 25, 25, 15])
    text = gt.robots.description(arm).splitlines()
    assert "171.9 deg/s" in text[1] and "120 N.m" in text[1]


def test_a_joint_without_limits_has_none_and_a_follower_limits_its_leader() -> None:
    text = ARM.read_text(encoding="utf-8")
    free = gt.robots.from_urdf(text.replace('velocity="6" effort="15"', 'velocity="0" effort="0"'))
    assert free.speed_limits[5] == free.effort_limits[5] == np.inf
    follower = '<limit lower="-6" upper="6" velocity="6" effort="15"/><mimic joint="wrist" multiplier="-2"/>'
    led = gt.robots.from_urdf(text.replace('<limit lower="-6" upper="6" velocity="6" effort="15"/>', follower))
    np.testing.assert_array_equal(led.speed_limits, [3, 3, 3, 4, 3])  # 6 rad/s over 2
    np.testing.assert_array_equal(led.effort_limits, [120, 120, 80, 25, 25])


def test_a_position_is_too_little(arm) -> None:
    with pytest.raises(gt.ModelError, match=r"known \(T\) has 3 numbers, and 6 are needed: name 3 more") as caught:
        arm.causal("T", "q")
    assert "tau" not in str(caught.value)


def test_six_numbers_of_a_pose_give_the_joints_from_a_start_nearby(arm) -> None:
    T, R, _ = arm.causal("q", ["T", "R"])(POSE)
    near = arm.with_(q={"start": POSE + 0.2}).causal(KNOWN, "q")
    q, status = near(T, R[2, 0], R[2, 1], R[1, 0])
    assert status is gt.Status.OK
    np.testing.assert_allclose(q, POSE, atol=ROUND_OFF)
    home = arm.causal(KNOWN, "q")  # the arm is stretched at q = 0
    said = home.diagnose(T, R[2, 0], R[2, 1], R[1, 0])
    assert "home pose q = [" in said and "model.with_(q={'start': ...})" in said and "link_" not in said
    for away, found in ((0.001, gt.Status.OK), (0.1, gt.Status.NOT_CONVERGED)):
        *_, status = home(T, R[2, 0], R[2, 1], R[1, 0], guess={"q": POSE + away})
        assert status is found


@pytest.mark.parametrize("problem", ["d1_six_link_line", "f1_motion"])
def test_motions_of_gantry_tau_robots_name_the_way_for_an_arm(problem: str) -> None:
    loaded = load(f"problems/{problem}.toml", [f'robot="{ARM}"'])
    with pytest.raises(InputError, match=r"gt\.Optimization.*docs/howto/urdf\.md"):
        solve(loaded, context_of(loaded))


def test_the_wrist_of_a_urdf_is_found_whatever_its_axes_are_called(arm) -> None:
    assert gt.kinematics.closed_form(gt.kinematics.chain_of(arm)).names[0] == "front, up, no flip"
