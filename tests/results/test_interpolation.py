"""Values between the rows of a time grid, against those of scipy."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.interpolate import CubicHermiteSpline

from gtmodel.results.interpolation import CubicHermite


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
