"""Hand-eye calibration on synthetic pictures: the true places, their intervals, what turns leave open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt

V = gt.vision.robot_cameras
each_mount = pytest.mark.parametrize("mounted", ["plate", "fixed"])


@each_mount
def test_pictures_without_noise_give_the_true_places(mounted):
    made = V.made_hand_eye(seed=3, mounted=mounted, pixel_noise=0.0, pose_noise=0.0)
    p = replace(made.pictures, sigma=np.full(len(made.pictures), 0.1))
    eye = V.hand_eye(p, made.cameras[0], mounted=mounted)
    assert eye.fit.status.ok
    np.testing.assert_allclose(eye.camera, made.true_cameras[0, 9:], atol=1e-8)
    np.testing.assert_allclose(np.abs(eye.target), np.abs(list(made.true_parameters.values())), atol=1e-8)


@each_mount
@pytest.mark.parametrize("seeds", [8, pytest.param(40, marks=pytest.mark.proof)])
def test_intervals_of_the_place_hold_the_truth_as_often_as_they_say(mounted, seeds):
    hits = []
    for seed in range(seeds):
        made = V.made_hand_eye(seed=100 + seed, mounted=mounted)
        e = V.hand_eye(made.pictures, made.cameras[0], mounted=mounted).estimate
        for name, true in zip(("camera.x", "camera.y", "camera.z"), made.true_cameras[0, 13:], strict=True):
            low, high = e.interval(name)
            hits.append(low < true < high)
    low, high = gt.inference.binomial_band(3 * seeds)
    assert low <= sum(hits) <= high


def test_the_lens_may_be_estimated_with_it():
    made = V.made_hand_eye(seed=5, poses=25)
    rough = replace(made.cameras[0], focal_pixel=1300.0, distortion=[0.0] * 5)
    eye = V.hand_eye(made.pictures, rough, ["focal", "principal_point", "distortion"])
    low, high = eye.estimate.interval("camera.fx", 0.999)
    assert low < 1400 < high
    assert np.abs(eye.camera[4:] - made.true_cameras[0, 13:]).max() < 2e-3


def test_turns_about_one_axis_are_refused():
    made = V.made_hand_eye(seed=6)
    p = made.pictures
    turn = Rotation.from_rotvec(np.linspace(0, 1, len(p.poses))[:, None] * [0, 0, 1.0]).as_quat()
    poses = np.column_stack([p.actuators[:, :3], np.roll(turn, 1, axis=1)])
    with pytest.raises(gt.results.ArgumentError) as error:
        V.hand_eye(replace(p, actuators=poses), made.cameras[0])
    assert error.value.argument == "pictures" and "two axes" in error.value.message


def test_what_are_no_poses_is_refused():
    made = V.made_hand_eye()
    p = made.pictures
    for wrong in (p.actuators[:, :3], 2 * p.actuators):
        with pytest.raises(gt.results.ArgumentError) as error:
            V.hand_eye(replace(p, actuators=wrong), made.cameras[0])
        assert error.value.argument == "pictures"
    with pytest.raises(gt.results.ArgumentError):
        V.hand_eye(p.part(np.arange(2)), made.cameras[0])
