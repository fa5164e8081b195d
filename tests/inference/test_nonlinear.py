"""Gauss-Newton and Levenberg-Marquardt against scipy.optimize: the same optimum from the same start."""

import numpy as np
import pytest
from scipy.optimize import curve_fit, least_squares

from gtmodel.inference import Prior, linear_fit, nonlinear_fit
from gtmodel.results import SolveStatus

T = np.linspace(0, 3, 60)


def decay(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    e = np.exp(-p[1] * T)
    return p[0] * e + p[2] - DATA, np.column_stack([e, -p[0] * T * e, np.ones_like(T)])


def data(seed: int = 4) -> np.ndarray:
    return 2 * np.exp(-1.3 * T) + 0.4 + 0.05 * np.random.default_rng(seed).standard_normal(len(T))


DATA = data()


def rosenbrock(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return (
        np.array([10 * (p[1] - p[0] ** 2), 1 - p[0]]),
        np.array([[-20 * p[0], 10.0], [-1.0, 0.0]]),
    )


def test_the_optimum_and_the_covariance_are_scipys():
    fit = nonlinear_fit(decay, [1.0, 1.0, 0.0], "abc")
    popt, pcov = curve_fit(lambda t, a, b, c: a * np.exp(-b * t) + c, T, DATA, [1.0, 1.0, 0.0], xtol=1e-15, ftol=1e-15)
    assert fit.status.ok and fit.estimate is not None
    np.testing.assert_allclose(fit.x, popt, rtol=1e-7)
    np.testing.assert_allclose(fit.estimate.covariance, pcov, rtol=1e-5)  # curve_fit's slopes are differences
    assert fit.estimate.degrees_of_freedom == 57


def test_a_linear_problem_is_that_of_linear_fit():
    A = np.column_stack([np.ones_like(T), T])
    fit = nonlinear_fit(lambda x: (A @ x - DATA, A), [5.0, 5.0], "ab", sigma=0.05, priors=[Prior("b", 0.0, 0.1)])
    linear = linear_fit(A, DATA, "ab", sigma=0.05, priors=[Prior("b", 0.0, 0.1)])
    assert fit.estimate is not None
    np.testing.assert_allclose(fit.x, linear.values, rtol=1e-12)
    np.testing.assert_allclose(fit.estimate.covariance, linear.covariance, rtol=1e-12)
    assert fit.iterations <= 3


def test_a_curved_valley_needs_damping_and_is_followed():
    fit = nonlinear_fit(rosenbrock, [-1.9, 2.0], "xy", sigma=1.0)
    np.testing.assert_allclose(fit.x, [1, 1], rtol=1e-12)
    assert fit.status.ok and fit.iterations < 60


@pytest.mark.parametrize("loss", ["huber", "soft_l1", "cauchy"])
def test_robust_losses_are_scipys(loss):
    spoilt = DATA.copy()
    spoilt[[7, 23, 41]] += [3.0, -2.0, 4.0]

    def residuals(p):
        r, J = decay(p)
        return r + DATA - spoilt, J

    fit = nonlinear_fit(residuals, [2.0, 1.0, 0.0], "abc", sigma=0.05, loss=loss, width=1.5)
    other = least_squares(
        lambda p: residuals(p)[0] / 0.05, [2.0, 1.0, 0.0], lambda p: residuals(p)[1] / 0.05,
        loss=loss, f_scale=1.5, xtol=1e-15, ftol=1e-15, gtol=1e-15,
    )  # fmt: skip
    assert fit.status.ok and fit.estimate is not None
    assert fit.cost == pytest.approx(other.cost, rel=1e-10)
    np.testing.assert_allclose(fit.x, other.x, rtol=1e-5)
    assert np.all(np.abs(fit.x - [2, 1.3, 0.4]) < 4 * fit.estimate.std)


def test_a_gauge_stays_where_it_started_and_the_rest_is_told():
    def residuals(p):  # only the sum of the last two is seen
        r, J = decay(np.array([p[0], p[1], p[2] + p[3]]))
        return r, np.column_stack([J, J[:, 2]])

    fit = nonlinear_fit(residuals, [1.0, 1.0, 0.3, 0.3], "abcd", scale=np.ones(4), hold_undetermined=True)
    assert fit.estimate is not None and fit.estimate.undetermined == ("c", "d")
    assert fit.x[2] == pytest.approx(fit.x[3], abs=1e-9)  # both moved alike from the same start
    single = nonlinear_fit(decay, [1.0, 1.0, 0.0], "abc").estimate
    assert single is not None
    value, low, high = fit.estimate.combination({"c": 1.0, "d": 1.0})
    assert (value, low, high) == pytest.approx((single.value("c"), *single.interval("c")), rel=1e-7)
    with pytest.raises(ValueError, match="do not determine c and d apart"):
        nonlinear_fit(residuals, [1.0, 1.0, 0.3, 0.3], "abcd")


def test_ends_that_are_no_solution_are_a_status():
    assert nonlinear_fit(decay, [1.0, np.nan, 0.0], "abc").status is SolveStatus.NOT_FINITE
    stopped = nonlinear_fit(rosenbrock, [-1.9, 2.0], "xy", sigma=1.0, limit=3)
    assert stopped.status is SolveStatus.ITERATION_LIMIT and stopped.estimate is None
    wrong = nonlinear_fit(lambda p: (decay(p)[0], -decay(p)[1]), [1.0, 1.0, 0.0], "abc")
    assert wrong.status is SolveStatus.FAILED and "derivatives right" in wrong.message


def test_wrong_arguments_get_a_sentence():
    with pytest.raises(ValueError, match="expected as many names as starting values, 3; found 2"):
        nonlinear_fit(decay, [1.0, 1.0, 0.0], "ab")
    with pytest.raises(ValueError, match=r"there is no loss 'l1'; .* linear, huber"):
        nonlinear_fit(decay, [1.0, 1.0, 0.0], "abc", loss="l1")
    with pytest.raises(ValueError, match="priors need a known noise"):
        nonlinear_fit(decay, [1.0, 1.0, 0.0], "abc", priors=[Prior("a", 0.0, 1.0)])


def test_residuals_that_all_lie_beyond_the_width_hold_nothing():
    A, b = np.ones((4, 1)), np.array([-100.0, -90.0, 110.0, 130.0])
    fit = nonlinear_fit(lambda x: (A @ x - b, A), [0.0], ["a"], sigma=1.0, loss="huber", width=1.0)
    assert fit.status is SolveStatus.FAILED and fit.estimate is None
    wide = nonlinear_fit(lambda x: (A @ x - b, A), [0.0], ["a"], sigma=1.0, loss="huber", width=100.0)
    assert wide.status.ok and wide.estimate is not None


def test_bounds_hold_what_would_leave_them_and_the_rest_is_fitted_there():
    """Of a linear problem both fits end at the same place; bvls of scipy is the other road."""
    A = np.random.default_rng(2).normal(size=(30, 3))
    b = A @ [1.0, -2.0, 0.5]
    bounds = {"a": (-1.0, 0.4), "c": (0.0, 9.0)}
    straight = linear_fit(A, b, "abc", sigma=1.0, bounds=bounds)
    fit = nonlinear_fit(lambda x: (A @ x - b, A), [0.0, 0.0, 5.0], "abc", sigma=1.0, bounds=bounds)
    assert fit.status.ok and fit.estimate.held == straight.held == ("a",) and fit.estimate.value("a") == 0.4
    assert fit.estimate.values == pytest.approx(straight.values, rel=1e-9)
    assert fit.estimate.covariance == pytest.approx(straight.covariance, rel=1e-9)
    assert rosenbrock_within([-1.9, 2.0], (-3.0, 0.5)) == pytest.approx([0.5, 0.25], rel=1e-9)
    assert rosenbrock_within([-1.9, 2.0], (-3.0, 3.0)) == pytest.approx([1.0, 1.0], rel=1e-9)


def rosenbrock_within(start, ends):
    return nonlinear_fit(rosenbrock, start, "xy", sigma=1.0, bounds={"x": ends}).x
