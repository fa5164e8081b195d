"""Uneven rows on an even grid: orders of convergence, errors that bound, gaps."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.measurements import LogError, resample
from gtmodel.results import ArgumentError
from tests.support.recordings import recording

ORDER = {"linear": 2, "monotone": 2, "cubic": 4}


def uneven(h: float, seed: int = 0, noise: float = 0.0) -> gt.Trajectory:
    rng = np.random.default_rng(seed)
    n = round(5.0 / h)
    t = h * np.arange(n) + 0.3 * h * rng.uniform(-1, 1, n)
    return gt.Trajectory(t, {"q": np.column_stack([np.sin(4 * t), np.cos(3 * t)]) + noise * rng.normal(size=(n, 2))})


def true(t: np.ndarray) -> np.ndarray:
    return np.column_stack([np.sin(4 * t), np.cos(3 * t)])


def missed(log: gt.Trajectory, **how) -> tuple[np.ndarray, np.ndarray]:
    """Errors on the grid and those that were stated, by component; ends are left out, where splines have one side."""
    even = resample(log, **how)
    inside = slice(5, -5)
    e = (even.trajectory["q"] - true(even.trajectory.time))[inside]
    return np.sqrt(np.mean(e**2, axis=0)), even.error["q"]


@pytest.mark.parametrize("method", ORDER)
def test_errors_fall_with_the_order_of_the_method_and_stay_below_the_stated_ones(method):
    (coarse, said), (fine, said_fine) = (missed(uneven(h), sample_time=0.01, method=method) for h in (0.04, 0.01))
    assert np.all(coarse < said) and np.all(fine < said_fine)
    measured = np.log(coarse / fine) / np.log(4)
    assert np.all(np.abs(measured - ORDER[method]) < 0.6)


def test_the_stated_error_holds_the_noise():
    _, said = missed(uneven(0.01, noise=0.01), sample_time=0.01)
    # a row's own noise and that of its interpolation between rows twice as far apart
    assert np.all((said > 0.01) & (said < 0.02))


def test_a_long_gap_parts_the_recording_and_a_short_one_is_bridged():
    log = uneven(0.01)
    keep = np.ones(len(log), bool)
    keep[100:103] = keep[300:360] = False
    log = gt.Trajectory(log.time[keep], {"q": log["q"][keep]})
    even = resample(log, 0.01)
    assert len(even.sessions) == 2 and len(even.bridged) == 1 and len(even.cut) == 1
    grid = np.concatenate([s.trajectory.time for s in even.sessions])
    assert (grid - grid[0]) / 0.01 == pytest.approx(np.round((grid - grid[0]) / 0.01), abs=1e-6)
    with pytest.raises(LogError):
        _ = even.trajectory
    assert len(resample(log, 0.01, longest_gap=1.0).sessions) == 1


@pytest.mark.parametrize(
    ("how", "argument"),
    [({"method": "best"}, "method"), ({"sample_time": 0.0}, "sample_time"), ({"longest_gap": 1e-6}, "longest_gap")],
)
def test_wrong_arguments(how, argument):
    with pytest.raises(ArgumentError) as error:
        resample(uneven(0.01), **how)
    assert error.value.argument == argument


ROUNDING = 1e-12  # of the largest rate


def off_by_hand(time: np.ndarray, gyro: np.ndarray) -> float:
    """The largest distance to straight lines by numpy.interp, of the largest rate."""
    log = gt.Trajectory(time, {"w": gyro})
    even = resample(log, 0.01, method="linear", longest_gap=1e9).trajectory
    by_hand = np.column_stack([np.interp(even.time, time, column) for column in gyro.T])
    return float(np.abs(even["w"] - by_hand).max() / np.abs(gyro).max())


def test_an_imu_against_interpolation_by_hand():
    """A synthetic one with the times of such a device: 10 ms, jitter and gaps."""
    rng = np.random.default_rng(2)
    time = np.cumsum(0.01 + 0.002 * rng.uniform(-1, 1, 2000) + 0.05 * (rng.uniform(size=2000) < 0.01))
    assert off_by_hand(time, rng.normal(size=(2000, 3))) <= ROUNDING


IMU = recording("abb_imu/V1000_path3_MPU9150.mat")


@pytest.mark.skipif(not IMU.is_file(), reason="the IMU recording may not be shipped")
def test_the_measured_imu_against_interpolation_by_hand():
    column = gt.measurements.Column
    (session,) = gt.measurements.read_log(
        IMU, {"w": column("SENSgyro", "1")}, time=column("MATLABtime", "s"), uneven=True, empty_rows="drop"
    )
    assert off_by_hand(session.trajectory.time, session.trajectory["w"]) <= ROUNDING
