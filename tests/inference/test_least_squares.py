"""Linear fits against formulas written out by hand, scipy's solvers, and exact small cases."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy import stats
from scipy.optimize import nnls

from gtmodel.inference import Prior, linear_fit, linear_fits, weighting
from gtmodel.results import ArgumentError

ROUNDING = 1e-11  # of well-conditioned problems of order one


def line(seed: int = 3, rows: int = 40) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2, rows)
    return np.column_stack([np.ones(rows), t]), 0.5 + 2 * t + 0.1 * rng.standard_normal(rows)


def test_a_straight_line_is_that_of_linregress():
    A, b = line()
    e = linear_fit(A, b, ("level", "slope"), units=("N", "N.s/m"))
    known = stats.linregress(A[:, 1], b)
    assert e.value("slope") == pytest.approx(known.slope, rel=ROUNDING)
    assert e.std[1] == pytest.approx(known.stderr, rel=ROUNDING)
    assert e.std[0] == pytest.approx(known.intercept_stderr, rel=ROUNDING)
    assert e.degrees_of_freedom == 38 and not e.known_noise
    low, high = e.interval("slope")
    assert (high - low) / 2 == pytest.approx(stats.t.ppf(0.975, 38) * known.stderr, rel=ROUNDING)
    assert "N.s/m" in str(e)


@pytest.mark.parametrize("level", [0, 1, 2, -0.5, np.nan, np.inf, True, None, "high"])
def test_a_level_that_is_none_is_refused(level):
    with pytest.raises(ArgumentError, match="expected a confidence level between 0 and 1; found"):
        linear_fit(*line(), ("level", "slope")).interval("slope", level)


def test_intervals_of_higher_levels_hold_those_of_lower_ones():
    e = linear_fit(*line(), ("level", "slope"))
    ends = [e.interval("slope", level) for level in (np.float32(0.5), 0.95, 0.99)]
    lows, highs = zip(*ends, strict=True)
    assert sorted(lows, reverse=True) == list(lows) and sorted(highs) == list(highs) and lows[0] < highs[0]


def test_a_mean_of_unequal_sigmas_is_the_weighted_mean():
    b, sigma = np.array([1.0, 2.0, 4.0]), np.array([1.0, 0.5, 2.0])
    e = linear_fit(np.ones((3, 1)), b, ["m"], sigma=sigma)
    w = 1 / sigma**2
    assert e.values[0] == pytest.approx(w @ b / w.sum(), rel=ROUNDING)
    assert e.std[0] == pytest.approx(w.sum() ** -0.5, rel=ROUNDING)
    assert e.interval("m")[1] == pytest.approx(e.values[0] + stats.norm.ppf(0.975) * e.std[0], rel=ROUNDING)


def test_weights_tell_ratios_only():
    A, b = line()
    w = np.linspace(1, 3, len(b))
    once, thousandfold = (linear_fit(A, b, "ab", weights=f * w) for f in (1, 1000))
    np.testing.assert_allclose(once.values, thousandfold.values, rtol=ROUNDING)
    np.testing.assert_allclose(once.covariance, thousandfold.covariance, rtol=ROUNDING)


def test_correlated_rows_are_generalised_least_squares():
    A, b = line()
    rng = np.random.default_rng(0)
    half = rng.standard_normal((40, 40))
    S = half @ half.T / 40 + np.eye(40)
    e = linear_fit(A, b, "ab", covariance=S)
    information = A.T @ np.linalg.solve(S, A)
    np.testing.assert_allclose(e.values, np.linalg.solve(information, A.T @ np.linalg.solve(S, b)), rtol=1e-10)
    np.testing.assert_allclose(e.covariance, np.linalg.inv(information), rtol=1e-10)
    blocks = np.array([[[2.0, 0.5], [0.5, 1.0]]] * 20)
    whole = np.kron(np.eye(20), blocks[0])
    np.testing.assert_allclose(
        linear_fit(A, b, "ab", covariance=blocks).covariance, linear_fit(A, b, "ab", covariance=whole).covariance
    )


def test_a_prior_is_a_further_row():
    A, b = line()
    e = linear_fit(A, b, "ab", sigma=0.1, priors=[Prior("b", 1.9, 0.02)])
    more = linear_fit(np.vstack([A, [0, 1]]), np.append(b, 1.9), "ab", sigma=np.append(np.full(40, 0.1), 0.02))
    np.testing.assert_allclose(e.values, more.values, rtol=ROUNDING)
    np.testing.assert_allclose(e.covariance, more.covariance, rtol=1e-9)
    assert len(e.residuals) == 40 and 38 < e.degrees_of_freedom < 39  # the prior tells part of one parameter


def test_with_a_prior_and_no_sigma_the_residuals_weigh_it():
    A, b = line()
    e = linear_fit(A, b, "ab", priors=[Prior("b", 1.9, 0.02)])
    again = linear_fit(A, b, "ab", sigma=e.noise, priors=[Prior("b", 1.9, 0.02)])
    np.testing.assert_allclose(e.values, again.values, rtol=1e-8)
    np.testing.assert_allclose(e.covariance, again.covariance, rtol=1e-6)


def test_nonnegative_masses_are_those_of_nnls_and_the_held_one_leaves_the_covariance():
    rng = np.random.default_rng(5)
    A = rng.standard_normal((60, 4))
    b = A @ [1.0, 0.3, -0.4, 2.0] + 0.05 * rng.standard_normal(60)
    names = ("m1", "m2", "m3", "m4")
    e = linear_fit(A, b, names, bounds=dict.fromkeys(names, (0.0, np.inf)))
    expected, _ = nnls(A, b)
    assert e.held == ("m3",) and e.held_values == (0.0,) and e.value("m3") == 0.0
    assert e.names == ("m1", "m2", "m4") and e.degrees_of_freedom == 57
    np.testing.assert_allclose(e.values, expected[[0, 1, 3]], rtol=1e-10)
    rest = linear_fit(A[:, [0, 1, 3]], b, e.names)
    np.testing.assert_allclose(e.covariance, rest.covariance, rtol=1e-9)
    assert "m3 is held at its bound" in str(e)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(0.01, 100), min_size=3, max_size=3))
def test_units_of_the_parameters_change_nothing(factors):
    """Property: with columns in other units the estimate is the same in these."""
    rng = np.random.default_rng(1)
    A, b, f = rng.standard_normal((30, 3)), rng.standard_normal(30), np.array(factors)
    e, scaled = linear_fit(A, b, "abc"), linear_fit(A * f, b, "abc")
    np.testing.assert_allclose(scaled.values * f, e.values, rtol=1e-9)
    np.testing.assert_allclose(scaled.std * f, e.std, rtol=1e-9)


def test_what_is_not_told_is_refused_or_stays_and_says_so():
    A, b = line()
    A = np.column_stack([A, A[:, 1] * 3])
    with pytest.raises(ValueError, match="do not determine b and c apart from each other"):
        linear_fit(A, b, "abc")
    e = linear_fit(A, b, "abc", hold_undetermined=True)
    assert e.undetermined == ("b", "c") and e.interval("b") == (-np.inf, np.inf)
    rest = linear_fit(A[:, :2], b, "ab")
    value, low, high = e.combination({"b": 1.0, "c": 3.0})  # what the data do tell
    assert (value, low, high) == pytest.approx((rest.value("b"), *rest.interval("b")), rel=1e-9)
    assert e.combination({"b": 1.0, "c": 1.0})[1:] == (-np.inf, np.inf)
    assert e.degrees_of_freedom == 38 and "apart from each other" in e.notes[0]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"sigma": 0.0}, "sigma must be finite and positive; found 0"),
        ({"sigma": [1.0, 2.0]}, r"sigma has the shape \(2,\); expected one number or 40"),
        ({"sigma": 1.0, "weights": 1.0}, "give one of sigma, weights and covariance; found sigma and weights"),
        ({"bounds": {"z": (0, 1)}}, "bounds name 'z', which is not free; .* a, b"),
        ({"bounds": {"a": (1, 0)}}, "the bounds of 'a' are 1 and 0; expected low <= high"),
        ({"covariance": -np.eye(40)}, "covariance is not positive definite"),
    ],
)
def test_wrong_arguments_get_a_sentence(change, sentence):
    A, b = line()
    with pytest.raises(ValueError, match=sentence):
        linear_fit(A, b, "ab", **change)


def test_wrong_data_get_a_sentence():
    A, b = line()
    with pytest.raises(ValueError, match=r"A has the shape \(40, 2\); expected \(40, 3\)"):
        linear_fit(A, b, "abc")
    with pytest.raises(ValueError, match="'a' names two parameters"):
        linear_fit(A, b, "aa")
    b[7] = np.nan
    with pytest.raises(ValueError, match="b is not finite in row 7"):
        linear_fit(A, b, "ab")
    with pytest.raises(ValueError, match="1 measured values for 1 unknowns; measure more, or give sigma"):
        linear_fit(np.ones((1, 1)), [1.0], "a")
    with pytest.raises(ValueError, match="the prior of 'a' needs"):
        Prior("a", 0.0, 0.0)


def test_whitening_makes_the_covariance_one():
    rng = np.random.default_rng(2)
    half = rng.standard_normal((4, 3, 3))
    blocks = half @ half.transpose(0, 2, 1) + np.eye(3)
    w = weighting(12, covariance=blocks)
    root = np.zeros((12, 12))
    for k, block in enumerate(np.linalg.cholesky(blocks)):
        root[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = block
    white = w(root)
    np.testing.assert_allclose(white @ white.T, np.eye(12), atol=1e-12)


@pytest.mark.parametrize("fits", [1, 2, 51])
@pytest.mark.parametrize("scale", [None, [1.0, 50.0, 0.01]])
def test_many_fits_of_one_matrix_are_those_of_single_ones(fits, scale):
    rng = np.random.default_rng(fits)
    A = rng.normal(size=(30, 3)) * [1.0, 1e-2, 100.0]
    b = rng.normal(size=(fits, 30)) + A @ [1.0, 2.0, 3.0]
    several = linear_fits(A, b, "abc", scale=scale)
    assert len(several) == fits
    for e, row in zip(several, b, strict=True):
        alone = linear_fit(A, row, "abc", scale=scale)
        np.testing.assert_allclose(e.values, alone.values, rtol=ROUNDING)
        np.testing.assert_allclose(e.covariance, alone.covariance, rtol=ROUNDING)
        np.testing.assert_allclose(e.residuals, alone.residuals, atol=ROUNDING * np.abs(row).max())
        assert (e.names, e.degrees_of_freedom, e.known_noise, e.held, e.notes) == (
            alone.names, alone.degrees_of_freedom, alone.known_noise, alone.held, alone.notes
        )  # fmt: skip
        assert e.noise == pytest.approx(alone.noise, rel=ROUNDING)


def test_many_fits_refuse_what_a_single_one_refuses():
    A, b = line()
    assert linear_fits(A, np.zeros((0, 40)), "ab") == []
    with pytest.raises(ArgumentError, match=r"b has the shape \(40,\); expected \(fits, rows\)"):
        linear_fits(A, b, "ab")
    with pytest.raises(ArgumentError, match=r"A has the shape \(40, 2\); expected \(39, 2\)"):
        linear_fits(A, b[None, 1:], "ab")
    with pytest.raises(ArgumentError, match="b is not finite in row 7"):
        linear_fits(A, np.stack([b, np.where(np.arange(40) == 7, np.nan, b)]), "ab")
    with pytest.raises(ArgumentError, match="the data do not determine a and b apart"):
        linear_fits(A[:, [0, 0]], b[None], "ab")
    with pytest.raises(ArgumentError, match="1 measured values for 1 unknowns"):
        linear_fits(np.ones((1, 1)), [[1.0]], "a")


def test_intervals_of_all_names_are_those_of_each():
    A, b = line()
    e = linear_fit(A[:, [0, 0, 1]], b, "abc", hold_undetermined=True)  # a and b move together
    low, high = e.intervals(level=0.9)
    assert [(lo, hi) for lo, hi in zip(low, high, strict=True)] == [e.interval(name, 0.9) for name in "abc"]
    assert np.isinf([low[0], high[1]]).all() and np.isfinite([low[2], high[2]]).all()
    np.testing.assert_array_equal(e.intervals("c", 0.9), [[low[2]], [high[2]]])
    with pytest.raises(ArgumentError, match="'d' was not estimated"):
        e.intervals("ad")
