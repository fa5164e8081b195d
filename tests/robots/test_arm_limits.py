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


SOME = [[-np.inf, np.inf], [0.0, 2.0], [1.0, np.inf]]  # the first joint without limits, the last with one


def some(**more) -> gt.Model:
    return gt.robots.serial_arm(a=[0.4, 0.3, 0.2], alpha=0.0, limits=SOME, start=[0.0, 0.5, 1.1], **more)


def test_limits_of_some_joints_are_kept() -> None:
    arm = some()
    inverse, forward = arm.causal(["T", "R"], "q"), arm.causal("q", ["T", "R"])
    q = np.array([[0.3, 0.5, 1.5], [3.0, 0.5, 4.5], [0.3, 0.5, 0.7]])
    *pose, _ = forward(q)
    got, status = inverse(*pose)
    assert not status.any()
    np.testing.assert_allclose(got[:2], q[:2], atol=ROUND_OFF)
    np.testing.assert_allclose(got[2], q[2] + [0, 0, 2 * np.pi], atol=ROUND_OFF)  # one turn inside its only limit
    *pose, _ = forward([0.3, 2.5, 1.5])  # the other elbow is below zero
    _, status = inverse(*pose)
    assert status is gt.Status.OUT_OF_RANGE and "q[1], 0 to 2" in inverse.diagnose(*pose)


def test_a_bound_of_some_entries_is_one_of_an_optimisation() -> None:
    from gtmodel.compiler.causal import flat_of

    bounds = {v.name: (v.min, v.max) for v in flat_of(some()).variables if v.name.startswith("q[")}
    assert bounds == {"q[0]": (-np.inf, np.inf), "q[1]": (0.0, 2.0), "q[2]": (1.0, np.inf)}
    with pytest.raises(gt.ModelError, match="must be finite"):
        flat_of(some().with_(q={"min": [np.nan, -np.inf, 0.0]}))

    class Fall(gt.Optimization):
        final_time = 1.0
        x = gt.variable(2, start=[1.0, 1.0], fixed=True, min=[-np.inf, 0.2])
        u = gt.input(2)

        def equations(self):
            yield gt.der(self.x) == self.u

        def objective(self):
            return (
                self.x.at(self.final_time)[0] + self.x.at(self.final_time)[1] + gt.integral(gt.dot(self.u, self.u)) / 4
            )

    # without bounds u = -2 on the whole way, to -1; the second entry stops at 0.2 on a straight line
    end = gt.solve(Fall(), gt.Mesh(elements=4)).trajectory["x"][-1]
    np.testing.assert_allclose(end, [-1.0, 0.2], atol=1e-6)


def test_elimination_and_iteration_respect_the_only_limit_of_a_joint() -> None:
    slide = gt.robots.serial_arm(
        a=[0.4, 0.3, 0.2, 0.1], alpha=[1.0, 0.5, 0.3, 0.2], d=0.1, joints="rrpr",
        limits=[[-np.inf, np.inf], [0.0, 2.0], [1.0, np.inf], [-1.0, 1.0]],
    )  # fmt: skip
    q = np.array([0.1, 0.6, 1.3, 0.3])
    chain = gt.kinematics.chain_of(slide)
    T, R = chain.pose(q)
    known = gt.kinematics.postures(chain, T, R, limits=slide.joint_limits)
    assert not known.complete
    np.testing.assert_allclose(known.q[0, 0], q, atol=ROUND_OFF)


def test_explain_says_which_home_pose_selects_the_branches(arm) -> None:
    singular = arm.causal(["T", "R"], "q").explain(full=False)
    assert "home pose: q = [0, 0, 0, 0, 0, 0], singular for shoulder, elbow, wrist" in singular
    started = gt.robots.from_urdf(ARM, start=POSE).causal(["T", "R"], "q").explain(full=False)
    assert "home pose: q = [-0.6, 0.4, 1, 0.2, 0.8, 0.3]\n" in started and "singular" not in started


def test_a_robot_file_has_a_start(tmp_path: Path) -> None:
    text = 'family = "serial"\na_m = [0.4, 0.3]\nalpha_deg = [0.0, 0.0]\nd_m = [0.0, 0.0]\n'
    for key, starts in (("start_deg = [0.0, 90.0]", ((0.0, np.pi / 2),)), ("start = [[0.0, 1.0], [0.5, -1.0]]",
                                                                      ((0.0, 1.0), (0.5, -1.0)))):  # fmt: skip
        (tmp_path / "two.toml").write_text(f"{text}{key}\n")
        assert gt.load_robot(tmp_path / "two.toml").structure.starts == starts
    for key, wrong in (("start_deg = [0.0, 90.0, 0.0]", "start takes 2 joint coordinates"),
                       ("start_deg = [0.0, 90.0]\nstart = [0.0, 1.0]", "start_deg"),
                       ("limits = [[-1, 1], [-1, 1]]\nstart = [0.0, 2.0]", "joint 'joint_2. is 114")):  # fmt: skip
        (tmp_path / "two.toml").write_text(f"{text}{key}\n")
        with pytest.raises(InputError, match=wrong):
            gt.load_robot(tmp_path / "two.toml")
