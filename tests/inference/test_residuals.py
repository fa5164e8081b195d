"""Tests on residuals, against formulas by hand and noise whose law is known."""

import numpy as np
import pytest
from scipy import stats

from gtmodel.inference import (
    alternate,
    autocorrelation,
    contiguous,
    cross_validation,
    linear_fit,
    noise_size,
    normality,
    whiteness,
)  # fmt: skip
from gtmodel.results import ArgumentError


def test_autocorrelation_by_hand():
    r = np.array([1.0, -1.0, 2.0, 0.0, -2.0])
    c = autocorrelation(r, 2)
    assert c == pytest.approx([1.0, -3 / 10, (2 - 4) / 10], abs=1e-12)


def test_ljung_box_by_hand_and_on_both_kinds_of_noise():
    r = np.array([1.0, -1.0, 2.0, 0.0, -2.0])
    found = whiteness(r, lags=2)
    assert found.statistic == pytest.approx(5 * 7 * (0.09 / 4 + 0.04 / 3), rel=1e-12)
    assert found.p == pytest.approx(np.exp(-found.statistic / 2), rel=1e-12)  # chi-squared of two
    rng = np.random.default_rng(0)
    p = [whiteness(rng.standard_normal(400)).p for _ in range(200)]
    assert stats.kstest(p, "uniform").pvalue > 0.001
    coloured = whiteness(np.convolve(rng.standard_normal(500), [1, 1, 1], "valid"))
    assert not coloured.passed and "coloured (correlation 0." in coloured.message and "lag 1" in coloured.message
    with pytest.raises(ValueError, match="too few to test whiteness"):
        whiteness(r, lags=1, parameters=1)
    with pytest.raises(ValueError, match="5 residuals are too few to test whiteness at 5 lags"):
        whiteness(r, lags=5)


def test_normality_is_scipys_jarque_bera():
    rng = np.random.default_rng(1)
    good, bad = rng.standard_normal(500), rng.standard_t(2, 500)
    assert normality(good).passed and not normality(bad).passed
    assert normality(bad).statistic == pytest.approx(float(stats.jarque_bera(bad)[0]), rel=1e-9)
    assert "outliers" in normality(bad).message


@pytest.mark.parametrize(("stated", "said"), [(1.0, "as large as"), (0.5, "lacks an effect"), (2.0, "too large")])
def test_the_size_of_the_noise_is_judged(stated, said):
    b = np.random.default_rng(2).standard_normal(300)
    found = noise_size(linear_fit(np.ones((300, 1)), b, "m", sigma=stated))
    assert said in found.message and found.passed == (stated == 1.0)


def test_an_unknown_noise_cannot_be_judged():
    with pytest.raises(ValueError, match="give sigma"):
        noise_size(linear_fit(np.ones((5, 1)), np.arange(5.0), "m"))


def test_leave_one_out_is_the_hat_matrix_formula():
    rng = np.random.default_rng(3)
    A, b = rng.standard_normal((25, 3)), rng.standard_normal(25)

    def fit(rows):
        return np.linalg.lstsq(A[rows], b[rows])[0]

    found = cross_validation(fit, lambda x, rows: b[rows] - A[rows] @ x, contiguous(25, 25))
    H = A @ np.linalg.solve(A.T @ A, A.T)
    expected = (b - H @ b) / (1 - np.diag(H))
    np.testing.assert_allclose(found.errors, expected, rtol=1e-10)
    assert found.rms > found.inside and "held-out error" in found.message
    with pytest.raises(ValueError, match="at least two parts"):
        cross_validation(fit, lambda x, rows: b[rows], [np.arange(25)])


def test_parts_hold_every_row_once():
    for parts in (contiguous(11, 3), alternate(11)):
        assert sorted(np.concatenate(parts)) == list(range(11))
    assert list(alternate(5)[1]) == [1, 3]


def test_an_offset_is_not_white() -> None:
    assert whiteness(np.zeros(50)).passed
    verdict = whiteness(np.full(50, 0.3))
    assert not verdict.passed and "lacks an offset" in verdict.message


def test_a_fit_without_degrees_of_freedom_says_nothing_of_the_noise():
    found = noise_size(linear_fit(np.eye(2), [1.0, 2.0], ["a", "b"], sigma=0.1))
    assert not found.passed and found.message.endswith("residuals do not show the noise")


@pytest.mark.parametrize("value", [0.0, 0.3, -1e6])
def test_residuals_that_are_all_the_same_say_nothing_of_normality(value: float) -> None:
    verdict = normality(np.full(50, value))
    assert not verdict.passed and np.isnan(verdict.p)
    assert verdict.message.startswith(f"all residuals are {value:.3g}: ")


def test_normality_needs_residuals() -> None:
    with pytest.raises(ArgumentError, match="0 residuals"):
        normality(np.zeros(0))
