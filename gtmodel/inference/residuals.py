"""Tests of a model by its residuals: whiteness, normality, size against the noise, and error on held-out data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..results.estimate import Estimate
from ..results.refusal import ArgumentError
from .chance import chi_squared_chance, chi_squared_share

SMALL_P = 0.01  # a test with a smaller p-value rejects its hypothesis
LAGS = 40  # of a drawn autocorrelation
TINY_P = 1e-99  # smaller p-values are printed as "below"


def shown_p(p: float) -> str:
    """Formats a p-value for a sentence; very small ones print as "below 1e-99".

    >>> from gtmodel.inference.residuals import shown_p
    >>> shown_p(0.021), shown_p(0.0)
    ('p = 0.021', 'p below 1e-99')
    """
    return f"p below {TINY_P:g}" if p < TINY_P else f"p = {p:.2g}"


@dataclass(frozen=True)
class Verdict:
    """Result of a statistical test: its statistic, the p-value `p` of the hypothesis, and a sentence.

    passed: whether the hypothesis is not rejected: p is 1 % or more.
    """

    statistic: float
    p: float
    passed: bool
    message: str


def autocorrelation(r: np.ndarray, lags: int) -> np.ndarray:
    """Return the autocorrelation coefficients (lags + 1,) of r (T,) at lags 0..lags; lags must be less than T.

    The mean is removed. Sums at every lag are divided by T, which makes the sequence positive definite.

    >>> gt.inference.autocorrelation(np.array([1.0, -1.0, 1.0, -1.0]), 2).round(2)
    array([ 1.  , -0.75,  0.5 ])
    """
    d = np.asarray(r, float) - np.mean(r)
    size = 1 << int(np.ceil(np.log2(2 * len(d))))
    power = np.abs(np.fft.rfft(d, size)) ** 2
    c = np.fft.irfft(power, size)[: lags + 1]
    return c / c[0] if c[0] > 0 else np.concatenate([[1.0], np.zeros(lags)])


def draw_residuals(
    residuals: Sequence[np.ndarray], names: Sequence[str], units: Sequence[str], title: str = "",
    places: Sequence[np.ndarray] | None = None, place: str = "sample",
) -> Any:  # fmt: skip
    """Return the figure of the residuals of each signal: in order, histogram, normal plot, autocorrelation.

    Arguments as in `gtmodel.plot.residuals.residuals_figure`; values that are not finite are left out.

    >>> from gtmodel.inference.residuals import draw_residuals
    >>> len(draw_residuals([np.sin(np.arange(50.0))], ["force"], ["N"]).axes)
    4
    """
    from ..plot.residuals import residuals_figure

    finite = [np.isfinite(r) for r in residuals]
    each = [np.asarray(r, float)[ok] for r, ok in zip(residuals, finite, strict=True)]
    at = None if places is None else [np.asarray(x)[ok] for x, ok in zip(places, finite, strict=True)]
    lags = [autocorrelation(r, min(LAGS, len(r) // 3))[1:] if len(r) else r for r in each]
    return residuals_figure(each, names, units, lags, at, place, title)


def draw_fit(estimate: Estimate, title: str = "") -> Any:
    """Return the figure of all residuals of an estimate in the order of the data, in units of their deviation."""
    deviation = float(np.std(estimate.residuals, ddof=1)) or 1.0
    return draw_residuals([estimate.residuals / deviation], ["residual / deviation"], ["1"], f"{title}: residuals")


def insignificant(r: np.ndarray) -> int:
    """Last lag before the autocorrelation of r (T,) is first within 2 / sqrt(T) of zero."""
    c = autocorrelation(r, len(r) // 2)
    return (
        int(np.argmax(np.abs(c) < 2 / np.sqrt(len(r)))) - 1 if np.any(np.abs(c) < 2 / np.sqrt(len(r))) else len(c) - 1
    )


def portmanteau(c: np.ndarray, T: int) -> float:
    """Ljung and Box's sum of the squared autocorrelations c at lags 1, 2, ... of T residuals."""
    return T * (T + 2) * float(np.sum(c**2 / (T - np.arange(1, len(c) + 1))))


def whiteness(r: np.ndarray, *, lags: int | None = None, parameters: int = 0) -> Verdict:
    """Test whether residuals r (T,), in the order of time, are uncorrelated (Ljung-Box).

    `lags` is the number of autocorrelations in the sum, by default min(20, T / 5); `parameters` is the number of
    parameters of a noise model that was fitted to r before. Raises ArgumentError unless parameters < lags < T.

    Source: Ljung and Box 1978, Biometrika 65: Q = T (T + 2) sum c_k^2 / (T - k), chi-squared with lags - parameters
    degrees of freedom.

    >>> noise = np.random.default_rng(1).normal(size=400)
    >>> gt.inference.whiteness(noise).passed
    True
    >>> gt.inference.whiteness(np.repeat(noise, 2)).message
    'residuals are coloured (correlation 0.42 at lag 1): intervals for white noise are too narrow (Ljung-Box p = ...'
    """
    T = len(r)
    K = min(20, T // 5) if lags is None else int(lags)
    if K <= parameters:
        raise ArgumentError(
            f"{T} residuals and {K} lags are too few to test whiteness; use at least {parameters + 1} lags"
        )
    if K >= T:
        raise ArgumentError(f"{T} residuals are too few to test whiteness at {K} lags; use fewer lags")
    c = autocorrelation(r, K)[1:]
    if np.ptp(r) == 0 and np.any(np.asarray(r) != 0):
        return Verdict(
            np.inf, 0.0, False, f"all residuals are {float(np.asarray(r)[0]):.3g}: the model lacks an offset"
        )
    Q = portmanteau(c, T)
    p = float(chi_squared_chance(Q, K - parameters))
    k = int(np.argmax(np.abs(c)))
    text = (
        "residuals look white"
        if p >= SMALL_P
        else f"residuals are coloured (correlation {c[k]:.2f} at lag {k + 1}): intervals for white noise are too narrow"
    )
    return Verdict(Q, p, p >= SMALL_P, f"{text} (Ljung-Box {shown_p(p)}, {K} lags)")


def normality(r: np.ndarray) -> Verdict:
    """Test whether residuals r (T,) are normal, by their skewness and kurtosis (Jarque-Bera).

    This is only a hint: least squares does not need normal noise, but its intervals do. Constant residuals do not pass,
    with a p of NaN. Raises ArgumentError without residuals.

    >>> noise = np.random.default_rng(1).normal(size=400)
    >>> gt.inference.normality(noise).passed, gt.inference.normality(noise**3).passed
    (True, False)
    """
    if not len(r):
        raise ArgumentError("0 residuals are too few to test for normality", "r")
    if np.ptp(r) <= np.finfo(float).eps * np.abs(r).max():
        message = (
            f"all residuals are {float(np.asarray(r)[0]):.3g}: without scatter there is nothing to test for normality"
        )
        return Verdict(np.nan, np.nan, False, message)
    z = (r - np.mean(r)) / np.std(r)
    skew, tail = float(np.mean(z**3)), float(np.mean(z**4)) - 3
    J = len(r) / 6 * (skew**2 + tail**2 / 4)
    p = float(chi_squared_chance(J, 2))
    text = (
        "residuals look normal"
        if p >= SMALL_P
        else f"residuals are not normal (skewness {skew:.2g}, excess kurtosis {tail:.2g}): look for outliers, or use "
        "a robust loss"
    )
    return Verdict(J, p, p >= SMALL_P, f"{text} (Jarque-Bera {shown_p(p)})")


def noise_size(estimate: Estimate) -> Verdict:
    """Test whether the residuals of a fit are as large as the stated noise (chi-squared, two-sided).

    A fit with as many parameters as measured values does not pass, with a p of NaN. Raises ArgumentError if the noise
    of the fit (sigma or covariance) was not stated.

    >>> values = 3.0 + 0.2 * np.random.default_rng(1).normal(size=50)
    >>> e = gt.inference.linear_fit(np.ones((50, 1)), values, ["mean"], sigma=0.1)
    >>> gt.inference.noise_size(e).message
    'residuals are 1.78 times the stated noise: the model lacks an effect, or the noise was stated too small ...'
    """
    if not estimate.known_noise:
        raise ArgumentError("the noise was not stated, so the residuals cannot be compared with it; give sigma")
    if estimate.degrees_of_freedom <= 0:
        return Verdict(0.0, np.nan, False, "as many parameters as measured values: residuals do not show the noise")
    chi2 = float(estimate.residuals @ estimate.residuals)
    p = 2 * float(min(f(chi2, estimate.degrees_of_freedom) for f in (chi_squared_chance, chi_squared_share)))
    ratio = estimate.noise
    text = "residuals are as large as the stated noise"
    if p < SMALL_P:
        text = (
            f"residuals are {ratio:.2f} times the stated noise: the model lacks an effect, or the noise was stated too "
            "small"
            if ratio > 1
            else f"residuals are {ratio:.2f} times the stated noise: it was stated too large"
        )
    return Verdict(
        chi2, p, p >= SMALL_P, f"{text} (chi-squared {chi2:.4g} for {estimate.degrees_of_freedom:.4g}, {shown_p(p)})"
    )


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Held-out `errors` (rows,) with their `rms`, and `inside`, the rms error of the fit to all rows."""

    errors: np.ndarray
    inside: float
    folds: int

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def message(self) -> str:
        return f"held-out error {self.rms:.4g} rms over {self.folds} parts, {self.inside:.4g} on the fitted data"


def cross_validation(
    fit: Callable[[np.ndarray], object], errors: Callable[[object, np.ndarray], np.ndarray], parts: Sequence[np.ndarray]
) -> CrossValidation:
    """Cross-validate a fit: hold out each part of the rows in turn, and compute the errors there.

    `fit(rows)` fits to some rows, given as indices; `errors(fitted, rows)` returns its errors on others; `parts` are
    arrays of indices, see contiguous() and alternate(). Raises ArgumentError for fewer than two parts.

    >>> time = np.linspace(0.0, 1.0, 40)
    >>> y = time**2  # fitted with a straight line
    >>> seen = gt.inference.cross_validation(
    ...     lambda rows: np.polyfit(time[rows], y[rows], 1),
    ...     lambda line, rows: y[rows] - np.polyval(line, time[rows]),
    ...     gt.inference.contiguous(40, 2),
    ... )
    >>> seen.message
    'held-out error 0.30... rms over 2 parts, 0.078... on the fitted data'
    """
    if len(parts) < 2:
        raise ArgumentError("cross-validation needs at least two parts: one to fit and one to hold out")
    every = np.sort(np.concatenate(parts))
    outside = np.concatenate([np.asarray(errors(fit(np.setdiff1d(every, part)), part)).reshape(-1) for part in parts])
    inside = np.asarray(errors(fit(every), every)).reshape(-1)
    return CrossValidation(outside, float(np.sqrt(np.mean(inside**2))), len(parts))


def contiguous(n: int, folds: int) -> list[np.ndarray]:
    """Split indices 0..n-1 into `folds` contiguous parts, for time series, whose neighbours are similar.

    >>> gt.inference.contiguous(5, 2)
    [array([0, 1, 2]), array([3, 4])]
    """
    return list(np.array_split(np.arange(n), folds))


def alternate(n: int, folds: int = 2) -> list[np.ndarray]:
    """Deal indices 0..n-1 in turn to `folds` parts: alternate grid points, Dressler 2012, section 5.5.

    Returns `folds` arrays (m,), m = n / folds; the first ones are longer by one if that is not a whole number.

    >>> gt.inference.alternate(5)
    [array([0, 2, 4]), array([1, 3])]
    """
    return [np.arange(k, n, folds) for k in range(folds)]
