"""Devices: noise by another road, where they see; candidates by hand."""

from importlib import import_module

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.calibrate import Camera, LaserTracker, LineOfSight, candidates
from gtmodel.calibrate.devices import sampled
from gtmodel.calibrate.pose_selection import AROUND
from gtmodel.kinematics.mechanism import mechanism_of
from gtmodel.kinematics.workspace import CartesianBox, InverseKinematics, Obstacles, Poses, Reach, box_grid

AT = np.array([1.0, -4.0, 2.0])
SLOPE_STEP = 1e-6  # of central differences: leaves some 1e-9 relative


def poses_at(T: np.ndarray) -> Poses:
    none = np.zeros((len(T), 0, 3))
    return Poses(T, np.zeros((len(T), 0)), none, none, np.zeros(len(T), int))


def test_the_trackers_covariance_is_that_of_distance_and_angles():
    tracker = LaserTracker(AT, range_noise=1e-5, range_per_m=2e-6, angle_noise=8e-6, fixed_noise=3e-6)
    T = np.array([[0.3, 1.0, 1.5], [1.0, -4.0, 4.0 - 1e-3], [2.0, -3.0, 0.0]])

    def point(m):  # distance, azimuth, elevation
        r, a, e = m
        return AT + r * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])

    for k in (0, 2):
        d = T[k] - AT
        r = np.linalg.norm(d)
        m = np.array([r, np.arctan2(d[1], d[0]), np.arcsin(d[2] / r)])
        J = np.stack([(point(m + h) - point(m - h)) / (2 * SLOPE_STEP) for h in SLOPE_STEP * np.eye(3)], axis=1)
        # the azimuth's angle is seen from the device: smaller than that about the axis by cos(elevation)
        std = np.array([np.hypot(1e-5, 2e-6 * r), 8e-6 / np.cos(m[2]), 8e-6])
        expected = J @ np.diag(std**2) @ J.T + 9e-12 * np.eye(3)
        np.testing.assert_allclose(tracker.covariance(T)[k], expected, rtol=1e-6, atol=1e-18)


def test_the_tracker_sees_between_two_distances_and_below_an_elevation():
    tracker = LaserTracker(AT, nearest=1.0, farthest=5.0, elevation=np.radians(45))
    T = AT + np.array([[2.0, 0, 0], [0.5, 0, 0], [6.0, 0, 0], [1.0, 0, 1.5], [1.0, 0, -0.9]])
    np.testing.assert_array_equal(np.all(tracker.margins(poses_at(T)) >= 0, axis=1), [1, 0, 0, 0, 1])
    assert len(tracker.parts) == tracker.margins(poses_at(T)).shape[1]


@pytest.mark.parametrize("k1", [0.0, -0.2])
def test_the_cameras_covariance_is_that_of_a_fitted_pose(k1):
    camera = Camera(
        AT, np.array([0.5, -0.6, 0.7]), pixel_noise=0.2, points=4, distortion=(k1, 0.0, 1e-3 * bool(k1), 0.0, 0.0)
    )
    T = np.array([0.8, -0.5, 0.9])
    line = camera.side * np.linspace(-0.5, 0.5, 4)
    marks = np.array([[a, b, 0.0] for a in line for b in line])
    R = camera.axes

    def picture(x):
        p = (x[:3] - AT) @ R.T + Rotation.from_rotvec(x[3:]).apply(marks)
        x, y = (p[:, :2] / p[:, 2:]).T
        r2, p1 = x * x + y * y, camera.distortion[2]
        radial = 1 + k1 * r2
        return (
            camera.focal * np.stack([x * radial + 2 * p1 * x * y, y * radial + p1 * (r2 + 2 * y * y)], axis=1).ravel()
        )

    x = np.concatenate([T, np.zeros(3)])
    J = least_squares(lambda y: picture(y) - picture(x), x, jac="3-point").jac
    expected = 0.04 * np.linalg.inv(J.T @ J)[:3, :3]
    np.testing.assert_allclose(camera.covariance(T[None])[0], expected, rtol=1e-5, atol=1e-5 * expected.max())
    # far worse along the axis than across it
    along = R[2] @ expected @ R[2]
    assert along > 50 * (R[0] @ expected @ R[0])


def test_the_camera_sees_patterns_that_are_whole_in_its_picture():
    camera = Camera(np.zeros(3), np.array([0.0, 1.0, 0.0]), focal=1000, width=1000, height=800, side=0.2)
    edge = 0.5 * 2.0 - 0.1  # half a picture's width at 2 m less half a pattern
    T = np.array([[0, 2.0, 0], [edge - 1e-6, 2.0, 0], [edge + 1e-6, 2.0, 0], [0, 2.0, 0.71], [0, -2.0, 0]])
    np.testing.assert_array_equal(np.all(camera.margins(poses_at(T)) >= 0, axis=1), [1, 1, 0, 0, 0])
    fish = Camera(np.zeros(3), np.array([0.0, 1.0, 0.0]), width=4000, height=4000, distortion=(-0.2, 0, 0, 0, 0))
    folded = np.array([[0, 2.0, 0], [4.0, 2.0, 0]])  # beyond the radius at which the lens turns back
    np.testing.assert_array_equal(np.all(fish.margins(poses_at(folded)) >= 0, axis=1), [1, 0])
    with pytest.raises(gt.ModelError, match="along its own 'up'"):
        Camera(np.zeros(3), np.array([0.0, 0.0, 1.0])).covariance(T)


def test_boxes_hide_what_is_behind_them():
    sight = LineOfSight(np.zeros(3), np.array([[1.0, -1, -1]]), np.array([[1.5, 1, 1]]), ["table"])
    margins = sight.margins(poses_at(np.array([[0.9, 0, 0], [2.0, 0, 0], [2.0, 5.0, 0]])))
    np.testing.assert_array_equal(margins[:, 0] >= 0, [True, False, True])
    assert list(sight.parts) == ["behind table"]


def test_sampled_noise_has_its_covariance():
    C = np.array([[4.0, 1, 0], [1, 2, 0], [0, 0, 1e-4]])
    noise = sampled(np.broadcast_to(C, (20000, 3, 3)), np.random.default_rng(1))
    np.testing.assert_allclose(np.cov(noise.T), C, atol=0.1)  # 4 sigma of 20,000 draws


def test_candidates_pass_stage_by_stage_and_keep_off_the_edge():
    inverse: InverseKinematics = mechanism_of(gt.robots.gantry_tau("l1_tape")).inverse
    low, high = np.array([0.0, -1.0, 0.3]), np.array([1.0, -0.2, 1.1])
    table = Obstacles(np.array([[0.0, -1.0, 0.3]]), np.array([[1.0, -0.2, 0.5]]), np.zeros(0))
    first = Reach(inverse, [CartesianBox(low, high)])
    second = Reach(inverse, [CartesianBox(low, high), table])
    grid = box_grid(low - 0.1, high + 0.1, 0.1)
    passed = candidates(grid, {"workspace": first, "obstacles": second}, 0.15)
    assert list(passed.stages) == ["workspace", "obstacles", "safety distance"] and passed.complete
    inside = np.all((passed.T >= low) & (passed.T <= high), axis=1)
    np.testing.assert_array_equal(passed.stages["workspace"], inside)
    np.testing.assert_array_equal(passed.stages["obstacles"], inside & (passed.T[:, 2] > 0.5 + 1e-9))
    c = passed.chosen
    # 0.15 m to the faces, the table among them
    assert np.all((c >= low + 0.15 - 1e-9) & (c <= high - 0.15 + 1e-9)) and c[:, 2].min() > 0.65 - 1e-9
    assert passed.counts["safety distance"] == len(c) == 7 * 5 * 3
    stopped = candidates(grid, {"workspace": first, "obstacles": second}, stop=lambda stage, fraction: True)
    assert not stopped.complete and list(stopped.stages) == ["workspace"]
    with pytest.raises(gt.ModelError, match="must not be negative"):
        candidates(grid, {"workspace": first}, -0.1)


@pytest.mark.parametrize("at_once", [1, 200, 4096])
def test_neighbours_are_those_of_each_point_however_many_are_asked_at_once(
    at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(import_module("gtmodel.calibrate.pose_selection"), "AT_ONCE", at_once)
    inverse: InverseKinematics = mechanism_of(gt.robots.gantry_tau("l1_tape")).inverse
    low, high = np.array([0.0, -1.0, 0.3]), np.array([1.0, -0.2, 1.1])
    hole = Obstacles(np.array([[0.3, -0.7, 0.6]]), np.array([[0.4, -0.6, 0.7]]), np.zeros(0))
    reach = Reach(inverse, [CartesianBox(low, high), hole])
    passed = candidates(box_grid(low, high, 0.1), {"workspace": reach}, 0.13)
    workspace, kept = passed.stages["workspace"], passed.stages["safety distance"]
    each = [bool(np.all(reach.inside(T + 0.13 * AROUND))) for T in passed.T[workspace]]
    assert any(each) and not all(each)
    np.testing.assert_array_equal(kept[workspace], each)
    assert not kept[~workspace].any()
    # the last direction alone may forbid a point, and nothing is asked where no point is left
    nothing = candidates(box_grid(low, high, 0.4), {"workspace": reach}, 5.0)
    assert nothing.counts["safety distance"] == 0
