"""Common curves that need no common frame: angular speed against a gyroscope, and speed of a point."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation, Slerp

import gtmodel as gt
from gtmodel.measurements import AlignBy, EvenGrid, ResamplingStudy, resampling_study
from gtmodel.measurements.common_grid.derived_curves import curves
from gtmodel.results import ArgumentError

LATE, ORIGIN = 3.2, 500.0  # s
GRID = EvenGrid(sample_time=0.02)
MOUNTED = Rotation.from_rotvec([0.4, -1.1, 0.7])  # of the gyroscope on the body


def rates(t: np.ndarray) -> np.ndarray:
    """Return body rates (n, 3) [rad/s]."""
    return np.column_stack([np.sin(1.3 * t), 0.8 * np.cos(0.7 * t + 0.02 * t**2), 0.5 * np.sin(2.1 * t)])


def orientation(t: np.ndarray) -> Rotation:
    """Integrate the rates, q' = q (0, w) / 2, with an integrator that knows nothing of the differences."""

    def slope(at: float, q: np.ndarray) -> np.ndarray:
        w = rates(np.array([at]))[0]
        return 0.5 * np.concatenate([q[3] * w + np.cross(q[:3], w), [-q[:3] @ w]])

    fine = np.arange(0.0, t[-1] + 0.01, 0.005)
    made = solve_ivp(slope, (0.0, fine[-1]), [0.0, 0.0, 0.0, 1.0], t_eval=fine, rtol=1e-9, atol=1e-10)
    return Slerp(fine, Rotation.from_quat(made.y.T))(t)


def recordings() -> tuple[gt.Trajectory, gt.Trajectory]:
    rng = np.random.default_rng(0)  # synthetic: seed 0
    t = 0.01 * np.arange(2500) + 0.003 * rng.uniform(0, 1, 2500)
    noisy = Rotation.from_rotvec(2e-4 * rng.normal(size=(len(t), 3))) * orientation(t)
    clock = 0.005 * np.arange(4000)
    gyro = rates(clock + LATE) @ MOUNTED.as_matrix() + 0.01 * rng.normal(size=(len(clock), 3))
    signs = np.where(np.arange(len(t)) % 700 < 350, 1.0, -1.0)[:, None]
    tracker = gt.Trajectory(t, {"e": signs * noisy.as_quat()}, {"e": "1"})
    return tracker, gt.Trajectory(clock + ORIGIN, {"rate": gyro}, {"rate": "rad/s"})


def aligned(first: gt.Trajectory, other: gt.Trajectory, by: AlignBy) -> ResamplingStudy:
    return resampling_study({"tracker": first, "imu": other}, GRID, [by])


def test_a_quaternion_and_a_gyroscope_are_aligned_without_a_common_frame() -> None:
    tracker, imu = recordings()
    study = aligned(tracker, imu, AlignBy("e", "rate", reference_curve="speed", other_curve="length"))
    assert study.offset["imu"] == pytest.approx(LATE - ORIGIN, abs=1e-3)
    low, high = study.drift_interval["imu"]
    assert low < 0 < high and study.explained["imu"] > 0.99
    rows = study.trajectory
    assert rows is not None
    t = rows.time
    np.testing.assert_allclose(rows["rate"] @ MOUNTED.as_matrix().T, rates(t), atol=0.06)


def test_the_curves_of_both_sensors_are_equal_to_the_noise() -> None:
    tracker, imu = recordings()
    pair = AlignBy("e", "rate", reference_curve="speed", other_curve="length", window=0.1)
    speed, length = curves(tracker, imu, pair)
    assert speed.unit("e") == length.unit("rate") == "rad/s"
    truth = np.linalg.norm(rates(speed.time), axis=1)
    assert np.sqrt(np.mean((speed["e"] - truth) ** 2)) < 4e-3
    seen = np.interp(length.time + LATE - ORIGIN, speed.time, speed["e"])
    inside = length.time + LATE - ORIGIN < speed.time[-1]
    assert np.sqrt(np.mean((seen - length["rate"])[inside] ** 2)) < 8e-3


def test_matrices_and_points_have_speeds_too() -> None:
    t = 0.01 * np.arange(1000)
    turn = orientation(t)
    path = np.column_stack([np.sin(t), np.cos(1.5 * t), 0.1 * t])
    frame = Rotation.from_rotvec([1.0, 2.0, -0.5])
    one = gt.Trajectory(
        t, {"R": turn.as_matrix().reshape(-1, 9), "p": path, "e": turn.as_quat()}, {"R": "1", "p": "m", "e": "1"}
    )
    other = gt.Trajectory(t, {"p2": frame.apply(path) + 2.0}, {"p2": "m"})
    a, b = curves(one, one, AlignBy("R", "e", reference_curve="speed", other_curve="speed"))
    np.testing.assert_allclose(a["R"], b["e"], atol=1e-9)
    a, b = curves(one, other, AlignBy("p", "p2", reference_curve="speed", other_curve="speed"))
    np.testing.assert_allclose(a["p"], b["p2"], atol=1e-12)
    assert a.unit("p") == "m/s"


def test_a_body_that_turns_too_far_in_the_window_is_an_error() -> None:
    t = 0.01 * np.arange(3000)
    spun = gt.Trajectory(t, {"e": Rotation.from_rotvec(np.outer(t, [0.0, 0.0, 4.0])).as_quat()}, {"e": "1"})
    pair = AlignBy("e", "e", reference_curve="speed", other_curve="speed")
    assert curves(spun, spun, pair)[0]["e"] == pytest.approx(4.0)
    with pytest.raises(ArgumentError, match="turns by 229 deg in 1 s"):
        curves(spun, spun, AlignBy("e", "e", reference_curve="speed", window=1.0))


@pytest.mark.parametrize(
    ("keys", "argument", "said"),
    [
        ({}, "align_by[0]", "one unit"),
        ({"reference_curve": "speed"}, "align_by[0]", "components"),
        ({"reference_curve": "length"}, "align_by[0]", "a rotation or direction"),
        ({"reference_curve": "speed", "other_curve": "length", "window": 1.9}, "align_by[0].window", "13 rows"),
        ({"other_curve": "length", "reference_curve": "speed", "window": 60.0}, "align_by[0].window", "leaves 0 rows"),
    ],
)
def test_one_sentence_for_each_wrong_curve(keys: dict[str, str], argument: str, said: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        aligned(*recordings(), AlignBy("e", "rate", **keys))  # type: ignore[arg-type]
    assert caught.value.argument == argument and said in str(caught.value), str(caught.value)
