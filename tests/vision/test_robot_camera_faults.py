"""Wrong pictures, readings, targets and noises of a robot with its cameras: named, refused or alarmed; clean ones none.

Faults are planted in synthetic pictures (0.1 pixel, 13 um): seeds 0 on, grids of 4 x 4 x 4. Their sizes and the seeds
were chosen before the rules were tried on them: half a pixel of a picture, a millimetre of a reading.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.results import ArgumentError
from gtmodel.results.suspicion import RUN_LEVEL, alarms
from gtmodel.vision.robot_cameras.robust import suspicions

V = gt.vision.robot_cameras
ROBOT = gt.robots.gantry_tau("l1_tape")
POSE, OTHER = 10, 40  # numbers of poses, named 11 and 41
ORDINARY, PROOF = 2, 400
CLOSE = 1e-9  # m: two fits of the same corners from other starts
CLEAN_ALARMS = 15 / 400  # of drawn clean sets, all alarms and removals of a set together: what 2 % of them allow


@cache
def made(seed: int = 0) -> V.MadePictures:
    return V.made_pictures(V.SyntheticRobotCameras(counts=[4, 4, 4], seed=seed))


def fitted(p: V.RobotPictures, **setting: Any) -> V.JointFit:
    return V.joint_fit(ROBOT, p, made().cameras, V.RobotCameras(**setting))


def moved(p: V.RobotPictures, where: np.ndarray, by: Any) -> V.RobotPictures:
    return replace(p, uv=p.uv + where[:, None] * np.asarray(by, float))


def read(p: V.RobotPictures, rows: Any, actuators: Any) -> V.RobotPictures:
    q = p.actuators.copy()
    q[rows] = actuators
    return replace(p, actuators=q)


@pytest.mark.parametrize("seeds", [range(ORDINARY), pytest.param(range(PROOF), marks=pytest.mark.proof)])
def test_clean_pictures_raise_no_alarm(seeds: range) -> None:
    loud = []
    for seed in seeds:
        joint = fitted(made(seed).pictures)
        named = [*joint.wrong_pictures, *joint.wrong_corners, *joint.wrong_poses]
        tests = V.picture_map(joint.pictures, joint.residuals).fires()
        if named or tests or alarms(suspicions(joint), RUN_LEVEL):
            loud.append(seed)
    assert len(loud) <= CLEAN_ALARMS * len(seeds), loud


@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ("shifted by half a pixel", {"wrong_pictures": ("pose 11 in left",)}),
        ("mirrored", {"wrong_pictures": ("pose 11 in left",)}),
        ("a reading off by a millimetre", {"wrong_poses": ("11",)}),
        pytest.param("readings exchanged", {"wrong_poses": ("11", "41")}, marks=pytest.mark.proof),
        ("cameras exchanged", {"wrong_poses": ("11",)}),
    ],
)
def test_what_does_not_belong_to_the_others_is_named_and_left_out(fault: str, named: dict[str, Any]) -> None:
    p = made().pictures
    picture = (p.camera == 0) & (p.pose == POSE)
    q = p.actuators
    wrong = {
        "shifted by half a pixel": lambda: moved(p, picture, [0.5, 0.0]),
        "mirrored": lambda: replace(p, uv=np.where(picture[:, None], [1599.0, 0.0] + p.uv * [-1.0, 1.0], p.uv)),
        "a reading off by a millimetre": lambda: read(p, POSE, q[POSE] + [0.0, 1e-3, 0.0]),
        "readings exchanged": lambda: read(p, [POSE, OTHER], q[[OTHER, POSE]]),
        "cameras exchanged": lambda: replace(p, camera=np.where(p.pose == POSE, 1 - p.camera, p.camera)),
    }[fault]()
    joint = fitted(wrong)
    found = {"wrong_pictures": joint.wrong_pictures, "wrong_poses": joint.wrong_poses}
    assert joint.fit.status.ok and found == {"wrong_pictures": (), "wrong_poses": ()} | named
    # what was left out has no part in the result: the same parameters without it
    left = joint.pictures.picture
    alone = fitted(p.corners(np.isin(p.picture, left)))
    for name, value in alone.parameters.items():
        assert joint.parameters[name] == pytest.approx(value, abs=CLOSE), name


def test_a_camera_that_moved_between_poses_is_an_alarm() -> None:
    p = made().pictures
    joint = fitted(moved(p, (p.camera == 0) & (p.pose >= 32), [0.5, 0.0]))
    assert "steady_left" in [s.name for s in alarms(suspicions(joint), RUN_LEVEL)]


@pytest.mark.parametrize("times", [10.0, 300.0])
def test_a_noise_that_was_stated_too_small_is_an_alarm_with_its_size(times: float) -> None:
    """The fit ends however wrong sigma is, and the sentence says how large the noise is."""
    p = made().pictures
    joint = fitted(replace(p, sigma=p.sigma / times))
    assert joint.fit.status.ok
    (loud,) = [s for s in alarms(suspicions(joint), RUN_LEVEL) if s.name == "over_noise"]
    ratio = re.search(r"([\d.e+]+) times", loud.remedy)
    assert ratio and float(ratio[1]) == pytest.approx(times, rel=0.1)


def test_rounding_is_no_pattern() -> None:
    """Pictures without any noise leave 1e-12 pixel, which is where the fit ended."""
    exact = V.made_pictures(V.SyntheticRobotCameras(counts=[4, 4, 4], pixel_noise=0.0, actuator_noise=0.0)).pictures
    joint = fitted(exact)
    assert V.picture_map(joint.pictures, joint.residuals).fires() == ()
    assert alarms(suspicions(joint), RUN_LEVEL) == []


def test_a_held_out_picture_beside_the_others_is_named() -> None:
    p = made().pictures
    q = p.actuators.copy()
    q[POSE + 1, 1] += 5e-3
    s = V.study(ROBOT, replace(p, actuators=q), made().cameras)
    assert s.status.ok and any("pose 12 in left" in note and "held-out" in note for note in s.notes)


@pytest.mark.parametrize(
    ("spoilt", "argument", "word"),
    [
        (lambda p: replace(p, target=1000 * p.target), "target", "unit"),
        (lambda p: replace(p, actuators=np.roll(p.actuators, 1, axis=0)), "corners", "do not belong"),
        (lambda p: replace(p, actuators=np.roll(p.actuators, 16, axis=0)), "actuators", "do not belong"),
        (lambda p: p.corners(p.mark < 2), "target", "on one line"),
        (lambda p: p.corners(p.mark == 0), "target", "on one line"),
        (lambda p: replace(p, target=p.target * np.nan), "target", "finite"),
        (lambda p: replace(p, sigma=p.sigma * np.inf), "corners", "sigma"),
        (lambda p: replace(p, mark=p.mark - 1), "corners", "marks"),
        (lambda p: replace(p, mark=p.mark.astype(float)), "corners", "whole numbers"),
        (lambda p: replace(p, poses=[p.poses[0], *p.poses[:-1]]), "corners", "two poses"),
    ],
    ids=[
        "target in mm",
        "rows shifted",
        "rows far shifted",
        "two marks",
        "one mark",
        "target not finite",
        "sigma",
        "mark of none",
        "floats",
        "poses of one name",
    ],
)  # fmt: skip
def test_what_no_fit_can_use_is_refused_by_what_is_wrong(
    spoilt: Callable[[V.RobotPictures], V.RobotPictures], argument: str, word: str
) -> None:
    with pytest.raises(gt.results.ArgumentError, match=word) as refusal:
        fitted(spoilt(made().pictures))
    assert refusal.value.argument == argument


def test_a_camera_with_two_entries_is_refused() -> None:
    with pytest.raises(gt.results.ArgumentError, match="two entries") as refusal:
        V.joint_fit(ROBOT, made().pictures, [*made().cameras, replace(made().cameras[0], width_pixel=400.0)])
    assert refusal.value.argument == "cameras"


@pytest.fixture(scope="module")
def measured() -> V.MadePictures:
    return V.made_pictures(V.SyntheticRobotCameras(counts=[4, 4, 4], seed=0, second_device=12))


def test_a_second_device_that_is_off_at_one_pose_is_an_alarm(measured: V.MadePictures) -> None:
    p, setting = measured.pictures, V.RobotCameras(scale="second_device")
    assert p.device is not None
    assert alarms(suspicions(V.joint_fit(ROBOT, p, measured.cameras, setting)), RUN_LEVEL) == []
    off = np.zeros_like(p.device.T)
    off[2, 0] = 5e-3
    joint = V.joint_fit(ROBOT, replace(p, device=replace(p.device, T=p.device.T + off)), measured.cameras, setting)
    (loud,) = [s for s in alarms(suspicions(joint), RUN_LEVEL) if s.name == "device_over_noise"]
    assert re.search(rf"pose {p.poses[int(p.device.pose[2])]}\b", loud.remedy)


@pytest.mark.parametrize(("factor", "word"), [([1e3, 1e3, 1e3], "unit"), ([1.0, 1.0, -1.0], "left-handed")])
def test_a_second_device_in_another_unit_or_hand_is_refused(
    measured: V.MadePictures, factor: list[float], word: str
) -> None:
    p = measured.pictures
    assert p.device is not None
    other = replace(p, device=replace(p.device, T=p.device.T * factor))
    with pytest.raises(gt.results.ArgumentError, match=word) as refusal:
        V.joint_fit(ROBOT, other, measured.cameras, V.RobotCameras(scale="second_device"))
    assert refusal.value.argument == "device"


@pytest.mark.parametrize("larger", [1.0, 1.02, 0.98])
def test_a_target_of_another_size_than_stated_is_seen_by_the_actuators(larger: float) -> None:
    p = made().pictures
    s = V.study(ROBOT, replace(p, target=larger * p.target), made().cameras)
    assert s.status.ok and any(f"moves {larger:.2f}" in note for note in s.notes) == (larger != 1.0)


@pytest.mark.parametrize(("thickness", "taken"), [(12e-3, True), (3.6e-3, False)])
def test_poses_in_a_plane_are_refused(thickness: float, taken: bool) -> None:
    flat = V.made_pictures(V.SyntheticRobotCameras(counts=[4, 4, 4], size=[thickness, 0.8, 1.0]))
    if taken:
        assert V.joint_fit(ROBOT, flat.pictures, flat.cameras).fit.status.ok
        return
    with pytest.raises(ArgumentError) as error:
        V.joint_fit(ROBOT, flat.pictures, flat.cameras)
    assert error.value.argument == "corners"
