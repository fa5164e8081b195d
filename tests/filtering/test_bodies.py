"""What an inertial unit on a moving body feels, against differences of a motion known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt

F = gt.filtering
STEP = 2e-5  # s; second differences lose (6e-17 / STEP^2) m/s2 to round-off and 1e-4 of the fastest part to the step
ARM, MISALIGNMENT = np.array([0.18, 0.1, -0.12]), np.array([0.01, 0.02, -0.03])


def matrix(Q: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(np.concatenate([Q[..., 1:], Q[..., :1]], axis=-1)).as_matrix()


@pytest.mark.parametrize("kind", ["sine", "line", "semicircle"])
def test_the_motion_agrees_with_its_differences(kind):
    path = F.TrackedPath(kind=kind, axes=5)
    t, h = np.linspace(0.1, 4.9, 801), 1e-5
    m, after, before = path.motion(t), path.motion(t + h), path.motion(t - h)
    assert np.abs((after.p - before.p) / (2 * h) - m.v).max() < 1e-8
    assert np.abs((after.v - before.v) / (2 * h) - m.a).max() < 1e-6 * max(1e-3, np.abs(m.a).max())
    assert np.abs((after.w - before.w) / (2 * h) - m.alpha).max() < 1e-6 * max(1e-3, np.abs(m.alpha).max())
    turned = Rotation.from_matrix(np.swapaxes(matrix(before.Q), 1, 2) @ matrix(after.Q)).as_rotvec() / (2 * h)
    assert np.abs(turned - m.w).max() < 1e-6 * max(1.0, np.abs(m.w).max())
    assert np.abs(np.linalg.norm(m.v, axis=1) - path.feed).max() < 1e-15


def test_the_sine_turns_by_168_degrees_within_70_ms():
    m = F.TrackedPath(axes=5).motion(np.linspace(0.0, 5.0, 50_001))
    fast = np.abs(m.w[:, 1]) > 0.2 * np.abs(m.w[:, 1]).max()
    first = m.time[fast][m.time[fast] < 2.5]
    assert np.degrees(np.ptp(m.angle)).round(0) == 168
    assert 0.05 < np.ptp(first) < 0.09 and 1.8 < first.mean() < 1.9


def test_the_unit_feels_its_own_motion():
    mount = np.concatenate([[np.cos(1.5)], np.sin(1.5) * np.array([0.0, 1.0, 0.0])])
    body = F.TurningBody(arm=ARM, mount=mount, misalignment=MISALIGNMENT)
    states = ["p", "v", "a", "Q", "w", "alpha"]
    process = F.ProcessModel(body, {"jerk": 1.0, "angular_jerk": 1.0}, states=states, quaternions=["Q"])
    sensors = [F.Sensor("acc", "specific_force", deviation=1.0), F.Sensor("gyro", "rate", deviation=1.0)]
    system = F.System(process, sensors)
    path, t = F.TrackedPath(axes=5), np.linspace(0.1, 4.9, 400)
    m = path.motion(t)
    x = np.concatenate([m.p, m.v, m.a, m.Q, m.w, m.alpha], axis=1)
    felt = system.read(("acc", "gyro"), 0.0, x, np.zeros(0))

    def unit(at: np.ndarray) -> np.ndarray:
        there = path.motion(at)
        return there.p + np.einsum("kij,j->ki", matrix(there.Q), ARM)

    a = (unit(t + STEP) - 2 * unit(t) + unit(t - STEP)) / STEP**2
    own = matrix(mount) @ matrix(np.concatenate([[1.0], MISALIGNMENT / 2]))
    expected = np.einsum("ji,kj->ki", own, np.einsum("kji,kj->ki", matrix(m.Q), a - [0.0, 0.0, -9.81]))
    assert np.abs(felt[:, :3] - expected).max() < 1e-5 * np.abs(expected).max()
    assert np.abs(felt[:, 3:] - m.w @ own).max() < 1e-12


def test_a_body_that_does_not_turn_is_the_other_at_rest_of_its_turning():
    mount = [np.cos(0.4), 0.0, np.sin(0.4), 0.0]
    still = F.TranslatingBody(mount=mount, misalignment=MISALIGNMENT)
    turning = F.TurningBody(mount=mount, misalignment=MISALIGNMENT, arm=ARM)
    sensor = [F.Sensor("acc", "specific_force", deviation=1.0)]
    a = F.System(F.ProcessModel(still, {"jerk": 1.0}, states=["p", "v", "a"]), sensor)
    states = ["p", "v", "a", "Q", "w", "alpha"]
    process = F.ProcessModel(turning, {"jerk": 1.0, "angular_jerk": 1.0}, states=states, quaternions=["Q"])
    b = F.System(process, sensor)
    x = np.random.default_rng(4).normal(size=(5, 9))
    rest = np.tile([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], (5, 1))
    one = a.read(("acc",), 0.0, x, np.zeros(0))
    other = b.read(("acc",), 0.0, np.concatenate([x, rest], axis=1), np.zeros(0))
    assert np.abs(one - other).max() < 1e-13


def test_a_semicircle_ends():
    with pytest.raises(gt.results.ArgumentError) as refused:
        F.TrackedPath(kind="semicircle", duration=100.0).motion(np.linspace(0, 100.0, 11))
    assert refused.value.argument == "duration"
