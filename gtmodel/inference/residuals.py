"""What residuals say of a model: are they white, normal, as large as the noise, and as large on other data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..results.estimate import Estimate
from ..results.refusal import ArgumentError
from .chance import chi_squared_chance, chi_squared_share

SMALL_P = 0.01  # a test with a smaller p-value speaks against its hypothesis
TINY_P = 1e-99  # below, a number says no more


def shown_p(p: float) -> str:
    """A p-value in a sentence: never zero, which nothing is.

    >>> from gtmodel.inference.residuals import shown_p
    >>> shown_p(0.021), shown_p(0.0)
    ('p = 0.021', 'p below 1e-99')
    """
    return f"p below {TINY_P:g}" if p < TINY_P else f"p = {p:.2g}"


@dataclass(frozen=True)
class Verdict:
    """A statistical test: its statistic, the p-value `p` under the hypothesis, and a sentence.

    `passed` says that the hypothesis stands: p is 1 % or more.
    """

    statistic: float
    p: float
    passed: bool
    message: str


def autocorrelation(r: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelation coefficients (lags + 1,) of r (T,) at lags 0..lags, which must be less than T.

    The mean is removed, and sums at every lag are divided by T, which makes the coefficients positive definite.

    >>> gt.inference.autocorrelation(np.array([1.0, -1.0, 1.0, -1.0]), 2).round(2)
    array([ 1.  , -0.75,  0.5 ])
    """
    d = np.asarray(r, float) - np.mean(r)
    size = 1 << int(np.ceil(np.log2(2 * len(d))))
    power = np.abs(np.fft.rfft(d, size)) ** 2
    c = np.fft.irfft(power, size)[: lags + 1]
    return c / c[0] if c[0] > 0 else np.concatenate([[1.0], np.zeros(lags)])


def insignificant(r: np.ndarray) -> int:
    """The last lag before the autocorrelation of r (T,) first lies within 2 / sqrt(T) of zero."""
    c = autocorrelation(r, len(r) // 2)
    return (
        int(np.argmax(np.abs(c) < 2 / np.sqrt(len(r)))) - 1 if np.any(np.abs(c) < 2 / np.sqrt(len(r))) else len(c) - 1
    )


def portmanteau(c: np.ndarray, T: int) -> float:
    """Ljung and Box's sum of the squared autocorrelations c at lags 1, 2, ... of T residuals."""
    return T * (T + 2) * float(np.sum(c**2 / (T - np.arange(1, len(c) + 1))))


def whiteness(r: np.ndarray, *, lags: int | None = None, parameters: int = 0) -> Verdict:
    """Ljung-Box test of whether residuals r (T,), in the order of time, are uncorrelated.

    `lags` is how many autocorrelations are summed, by default min(20, T / 5); `parameters` how many a model of the
    noise has that was fitted to r before. Raises ArgumentError where the lags are not more than these, or not fewer
    than the residuals.

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
            f"{T} residuals and {K} lags are too few to test whiteness; take at least {parameters + 1} lags"
        )
    if K >= T:
        raise ArgumentError(f"{T} residuals are too few to test whiteness at {K} lags; take fewer lags")
    c = autocorrelation(r, K)[1:]
    if np.ptp(r) == 0 and np.any(np.asarray(r) != 0):
        return Verdict(np.inf, 0.0, False, f"all residuals are {float(np.asarray(r)[0]):.3g}: an offset is left out")
    Q = portmanteau(c, T)
    p = float(chi_squared_chance(Q, K - parameters))
    k = int(np.argmax(np.abs(c)))
    said = (
        "residuals look white"
        if p >= SMALL_P
        else f"residuals are coloured (correlation {c[k]:.2f} at lag {k + 1}): intervals for white noise are too narrow"
    )
    return Verdict(Q, p, p >= SMALL_P, f"{said} (Ljung-Box {shown_p(p)}, {K} lags)")


def normality(r: np.ndarray) -> Verdict:
    """Jarque-Bera test of whether residuals r (T,) are normal, by their skewness and kurtosis.

    A hint only: least squares needs no normal noise, its intervals do. Residuals that are all the same do not pass,
    their p is NaN. Raises ArgumentError for no residuals.

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
    said = (
        "residuals look normal"
        if p >= SMALL_P
        else f"residuals are not normal (skewness {skew:.2g}, excess kurtosis {tail:.2g}): look for outliers, or take "
        "a loss that bears them"
    )
    return Verdict(J, p, p >= SMALL_P, f"{said} (Jarque-Bera {shown_p(p)})")


def noise_size(estimate: Estimate) -> Verdict:
    """Chi-squared test of whether the residuals of a fit are as large as the stated noise, neither more nor less.

    The verdict of a fit with as many parameters as measured values does not pass, its p is NaN. Raises ArgumentError
    where the fit was not given the noise (sigma or covariance).

    >>> values = 3.0 + 0.2 * np.random.default_rng(1).normal(size=50)
    >>> e = gt.inference.linear_fit(np.ones((50, 1)), values, ["mean"], sigma=0.1)
    >>> gt.inference.noise_size(e).message
    'residuals are 1.78 times the stated noise: the model lacks an effect, or the noise was stated too small ...'
    """
    if not estimate.known_noise:
        raise ArgumentError("the noise was not given, so that the residuals cannot be compared with it; give sigma")
    if estimate.degrees_of_freedom <= 0:
        return Verdict(0.0, np.nan, False, "as many parameters as measured values: residuals say nothing of the noise")
    chi2 = float(estimate.residuals @ estimate.residuals)
    p = 2 * float(min(f(chi2, estimate.degrees_of_freedom) for f in (chi_squared_chance, chi_squared_share)))
    ratio = estimate.noise
    said = "residuals are as large as the stated noise"
    if p < SMALL_P:
        said = (
            f"residuals are {ratio:.2f} times the stated noise: the model lacks an effect, or the noise was stated too "
            "small"
            if ratio > 1
            else f"residuals are {ratio:.2f} times the stated noise: it was stated too large"
        )
    return Verdict(
        chi2, p, p >= SMALL_P, f"{said} (chi-squared {chi2:.4g} for {estimate.degrees_of_freedom:.4g}, {shown_p(p)})"
    )


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Errors (rows,) of rows that the fit had not seen; `rms` is theirs, and `inside` that of the fit on all rows."""

    errors: np.ndarray
    inside: float
    folds: int

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def message(self) -> str:
        return (
            f"held-out error {self.rms:.4g} rms over {self.folds} parts, {self.inside:.4g} on the data that were fitted"
        )


def cross_validation(
    fit: Callable[[np.ndarray], object], errors: Callable[[object, np.ndarray], np.ndarray], parts: Sequence[np.ndarray]
) -> CrossValidation:
    """Errors of a fit on rows that it has not seen, each part of the rows being held out in turn.

    `fit(rows)` fits on some rows, given as indices; `errors(fitted, rows)` returns its errors on others; `parts` are
    arrays of indices, see contiguous() and alternate(). Raises ArgumentError for fewer than two parts.

    >>> time = np.linspace(0.0, 1.0, 40)
    >>> y = time**2  # fitted with a straight line
    >>> seen = gt.inference.cross_validation(
    ...     lambda rows: np.polyfit(time[rows], y[rows], 1),
    ...     lambda line, rows: y[rows] - np.polyval(line, time[rows]),
    ...     gt.inference.contiguous(40, 2),
    ... )
    >>> seen.message
    'held-out error 0.30... rms over 2 parts, 0.078... on the data that were fitted'
    """
    if len(parts) < 2:
        raise ArgumentError("cross-validation needs at least two parts: one to fit and one to hold out")
    every = np.sort(np.concatenate(parts))
    outside = np.concatenate([np.asarray(errors(fit(np.setdiff1d(every, part)), part)).reshape(-1) for part in parts])
    inside = np.asarray(errors(fit(every), every)).reshape(-1)
    return CrossValidation(outside, float(np.sqrt(np.mean(inside**2))), len(parts))


def contiguous(n: int, folds: int) -> list[np.ndarray]:
    """Indices 0..n-1 in `folds` stretches, to hold out in turn: for series, where neighbours are alike.

    >>> gt.inference.contiguous(5, 2)
    [array([0, 1, 2]), array([3, 4])]
    """
    return list(np.array_split(np.arange(n), folds))


def alternate(n: int, folds: int = 2) -> list[np.ndarray]:
    """Indices 0..n-1 dealt out in turn to `folds` parts: alternate grid points, Dressler 2012, section 5.5.

    Returns that many arrays (m,), m = n / folds; the first ones are longer by one where that is no whole number.

    >>> gt.inference.alternate(5)
    [array([0, 2, 4]), array([1, 3])]
    """
    return [np.arange(k, n, folds) for k in range(folds)]
