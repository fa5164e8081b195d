"""Values between the rows of a time grid, against those of scipy."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

import gtmodel as gt
from gtmodel.results import TrajectoryError
from gtmodel.results.interpolation import CubicHermite

ROUNDING = 1e-12  # of angles of some turns, through arc cosines of steps of some hundredths


@given(n=st.integers(2, 40), columns=st.integers(1, 4), seed=st.integers(0, 10**6))
def test_cubics_through_values_and_derivatives_are_those_of_scipy_to_the_last_bit(
    n: int, columns: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    grid = np.cumsum(rng.uniform(1e-3, 1.0, n)) - 5.0
    value, derivative = rng.standard_normal((2, n, columns))
    times = np.concatenate([grid, rng.uniform(grid[0] - 0.5, grid[-1] + 0.5, 50)])
    ours, theirs = CubicHermite(grid, value, derivative), CubicHermiteSpline(grid, value, derivative)
    np.testing.assert_array_equal(ours(times), theirs(times))
    np.testing.assert_array_equal(ours(times, 1), theirs(times, 1))


def test_an_instant_that_is_no_number_has_no_value() -> None:
    curve = CubicHermite(np.array([0.0, 1.0]), np.zeros((2, 1)), np.ones((2, 1)))
    assert np.isnan(curve(np.array([np.nan]))).all()
    assert curve(np.zeros(0)).shape == (0, 1)
    assert curve(np.array([1.0]), 1) == pytest.approx(1.0)


def turning(angle: np.ndarray) -> Rotation:
    """About an axis that itself turns; at an angle [rad] of some turns."""
    return Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]) * Rotation.from_rotvec(
        np.column_stack([0.8 * np.sin(angle), 0.5 * np.cos(0.7 * angle), 0.0 * angle])
    )


def recorded(t: np.ndarray) -> gt.Trajectory:
    """A rotation as quaternion with w >= 0, as four columns and as matrix; an angle within one turn."""
    angle = 2.5 * t + 0.3 * np.sin(t)
    R = turning(angle)
    q = R.as_quat(canonical=True)
    assert np.any(np.sum(q[1:] * q[:-1], axis=1) < 0)
    values = {"q": q, "R": R.as_matrix().reshape(-1, 9), "angle": (angle + np.pi) % (2 * np.pi) - np.pi, "x": np.sin(t)}
    single = {f"q_{c}": column for c, column in zip("xyzw", q.T, strict=True)}
    return gt.Trajectory(t, values | single, {"angle": "rad", "x": "m"})


def test_a_turning_body_is_interpolated_as_slerp_does_and_an_angle_goes_on_across_pi() -> None:
    t = np.cumsum(np.random.default_rng(3).uniform(0.03, 0.1, 120))
    log = recorded(t)
    fine = np.sort(np.concatenate([t[[0, 5, -1]], np.random.default_rng(4).uniform(t[0], t[-1], 500)]))
    even = log.resample(fine)
    expected = Slerp(t, Rotation.from_quat(log["q"]))(fine)
    singles = np.column_stack([even[f"q_{c}"] for c in "xyzw"])
    for made in (Rotation.from_quat(even["q"]), Rotation.from_quat(singles), Rotation.from_quat(log(fine, "q")),
                 Rotation.from_matrix(even["R"].reshape(-1, 3, 3))):  # fmt: skip
        assert (expected.inv() * made).magnitude().max() < ROUNDING
    for q in (even["q"], singles):
        np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, rtol=0, atol=ROUNDING)
        assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0)
    np.testing.assert_array_equal(log(fine, "q[1]"), even["q[1]"])
    np.testing.assert_array_equal(log(fine, "q_y"), even["q_y"])
    truth = 2.5 * fine + 0.3 * np.sin(fine)
    apart = even["angle"] - truth
    whole = 2 * np.pi * np.round(apart[0] / (2 * np.pi))
    assert np.abs(apart - whole).max() < 0.1**2 * 0.3 / 8 + ROUNDING  # the curvature between two rows
    np.testing.assert_allclose(even["x"], np.interp(fine, t, log["x"]), rtol=0, atol=ROUNDING)
    pchip = log.resample(fine, kind="pchip")
    np.testing.assert_allclose(np.linalg.norm(pchip["q"], axis=1), 1.0, rtol=0, atol=ROUNDING)
    assert np.abs(pchip["angle"] - truth - whole).max() < 1e-3  # third order, of steps up to 0.1 s
    held = log.resample(t[3:9:2], kind="previous")
    np.testing.assert_array_equal(held["angle"], log["angle"][3:9:2])


def test_a_turn_whose_sense_the_rows_leave_open_is_refused_and_other_signals_are_not() -> None:
    t = 0.1 * np.arange(40)
    angle = np.radians((110.0 * np.arange(40) + 180) % 360 - 180)
    log = gt.Trajectory(t, {"a": angle, "x": t}, {"a": "rad", "x": "m"})
    with pytest.raises(TrajectoryError, match=r"'a' turns by 110 deg from .* s to .* s"):
        log.resample(dt=0.05)
    assert log(0.25, "x") == pytest.approx(0.25)


def test_switches_and_a_start_of_two_rows_stay_plain_numbers() -> None:
    t = np.array([0.0, 1.0])
    plain = gt.Trajectory(t, {"theta": [0.0, 6.0], "on": [[1.0, 0.0], [0.0, 1.0]]}, {"theta": "rad"})
    half = plain.resample([0.5])
    assert half["theta"].tolist() == [3.0]
    assert half["on"].tolist() == [[0.5, 0.5]]


def test_the_low_pass_the_complementary_filter_the_shaper_and_inputs_take_them_for_what_they_are() -> None:
    step = 0.01
    t = step * np.arange(600)
    angle, R = 2.0 * t, turning(2.0 * t)
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    low_pass = gt.measurements.ZeroPhase(10.0)
    inner = slice(low_pass.end_rows(step), -low_pass.end_rows(step))
    q = low_pass(R.as_quat(canonical=True), step)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, rtol=0, atol=ROUNDING)
    # of components up to 0.6 Hz the filter takes (0.6 / 10)^8; the ends leave more where they are cut
    assert (R.inv() * Rotation.from_quat(q)).magnitude()[inner].max() < 1e-4
    passed = low_pass(np.asarray(wrapped, float), step, unit="rad")
    np.testing.assert_allclose(passed[inner], angle[inner], rtol=0, atol=1e-4)
    slow = gt.Trajectory(t, {"a": wrapped}, {"a": "rad"})
    still = gt.Trajectory(t, {"acc": 0 * t}, {"acc": "rad/s2"})
    np.testing.assert_allclose(gt.filtering.complementary(slow, still, 1.0)["a"], angle, rtol=0, atol=1e-9)
    shaped = gt.control.zero_vibration(5.0)(slow, ["a"])["a"]
    assert np.abs(np.diff(shaped)).max() < 2.0 * step + ROUNDING
