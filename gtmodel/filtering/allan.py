"""Sensor noise from a log at rest: Allan deviation, and the noise densities that filters take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ..inference.chance import chi_squared_bound
from ..results.estimate import half_width
from ..results.refusal import ArgumentError

NoiseTerm = Literal["white", "flicker", "walk"]
TERMS: tuple[NoiseTerm, ...] = ("white", "flicker", "walk")
LEAST = 64  # samples: with fewer the fit has hardly any averaging times
LONGEST = 8  # averaging times up to 1/8 of the log: longer ones have few independent pairs
FLAT = 2 * np.log(2) / np.pi  # Allan variance of 1/f noise over its squared coefficient
ROUNDING = 1e-12  # added to the diagonal of a correlation matrix
STEPS = 20  # iterations of the fit: its weights depend on its result
SAME = 1e-5  # relative change of the fitted curve at which the fit ends: far below the resolution of the data
CHUNK = 1 << 15  # frequencies at a time
UNEXPLAINED = 0.999  # quantile of chi-squared above which a note says that the terms do not explain the curve


def allan_deviation(values: Any, period: float, sizes: Sequence[int] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return averaging times [s] and overlapping Allan deviations in the unit of the values.

    Args:
        values: samples (n,) of a rate, such as a gyro's, one every `period` [s].
        sizes: numbers of samples to average; powers of two up to an eighth of the log if left out.

    Raises ArgumentError for samples that are not finite, and for sizes above half of the log.

    Source: IEEE Std 952-1997, annex C; Riley 2008, NIST SP 1065, section 5.2.4.

    >>> data = [892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0]  # NIST SP 1065, section 12.1
    >>> tau, deviation = gt.filtering.allan_deviation(data, 1.0, [1, 2])
    >>> deviation.round(5).tolist()
    [91.22945, 85.95287]
    """
    y = _samples(values, period)
    m = _powers(len(y)) if sizes is None else np.asarray(sizes, int)
    if not m.size or m.min() < 1 or 2 * m.max() > len(y):
        raise ArgumentError(f"expected numbers of samples from 1 to {len(y) // 2}; found {list(m)}", "sizes")
    return m * period, np.sqrt(_variances(y, m))


@dataclass(frozen=True, eq=False)
class _Curves:
    """Model of an Allan curve: variances of the log (k,), variances of each term with a coefficient of one
    (k, terms), and the covariance of the variances for each pair of terms (terms, terms, k, k)."""

    variances: np.ndarray
    units: np.ndarray
    spread: np.ndarray

    def weighted(self, squares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`units` and `variances`, whitened for noise with these squared coefficients."""
        C = np.einsum("t,u,tuij->ij", squares, squares, self.spread)
        scale = 1 / np.sqrt(np.diag(C))
        L = np.linalg.cholesky(C * np.outer(scale, scale) + ROUNDING * np.eye(len(C)))
        white = np.linalg.solve(L, scale[:, None] * np.column_stack([self.units, self.variances]))
        return white[:, :-1], white[:, -1]

    def fit(self, fixed: int | None = None, value: float = 0.0, squares: np.ndarray | None = None) -> np.ndarray:
        """Fit the squared coefficients, one of them fixed at a value; `squares` is the initial guess."""
        now = self._first() if squares is None else squares.copy()
        if fixed is not None:
            now[fixed] = value
            if not now.any():  # the log has noise, but this term alone would have to explain it
                now = self._first()
                now[fixed] = value
        for _ in range(STEPS):
            if not now.any():
                break
            A, y = self.weighted(now)
            before, now = now, _least(A, y, fixed, value)
            fitted = self.units @ now
            if np.all(np.abs(fitted - self.units @ before) <= SAME * fitted):
                break
        return now

    def _first(self) -> np.ndarray:
        """First guess: weighted by relative errors alone."""
        return _least(self.units / self.variances[:, None], np.ones(len(self.variances)), None, 0.0)

    def distance(self, k: int, value: float, squares: np.ndarray) -> float:
        """Likelihood-ratio statistic of a value of one squared coefficient; chi-squared with one degree of freedom if
        the value is true. The weights are those of the noise at this value: small coefficients are better known."""
        squares_at = self.fit(k, value, squares)
        if not squares_at.any():
            return np.inf
        A, y = self.weighted(squares_at)
        return float(np.sum((y - A @ squares_at) ** 2) - np.sum((y - A @ _least(A, y, None, 0.0)) ** 2))


def _least(A: np.ndarray, y: np.ndarray, fixed: int | None, value: float) -> np.ndarray:
    """Non-negative least squares for the squared coefficients, one of them fixed at a value."""
    from scipy.optimize import nnls

    size = np.linalg.norm(A, axis=0)
    free = np.array([k for k in range(A.shape[1]) if k != fixed], int)
    squares = np.zeros(A.shape[1])
    if fixed is not None:
        squares[fixed] = value
    if free.size:
        squares[free] = nnls(A[:, free] / size[free], y - A @ squares)[0] / size[free]
    return squares


@dataclass(frozen=True, eq=False)
class AllanFit:
    """Noise of a sensor from the Allan deviation of a log at rest, in the unit of its values.

    white: density [unit/sqrt(Hz)], the `density` of a `Sensor`; a gyro's angle random walk. flicker: bias instability,
        coefficient of 1/f noise [unit]; the flat part of the curve is at 0.664 times this. walk: random walk of the
        bias [unit/sqrt(s)]; its square is the density of the noise that drives the bias if it is a state.
    terms: the fitted terms; the others are 0.
    tau, deviation, fitted: averaging times [s], measured and fitted deviations.
    period: sampling period [s]. notes: sentences on the limits of the result.
    """

    white: float
    flicker: float
    walk: float
    terms: tuple[NoiseTerm, ...]
    tau: np.ndarray
    deviation: np.ndarray
    fitted: np.ndarray
    period: float
    notes: tuple[str, ...]
    curves: _Curves = field(repr=False)

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence limits of "white", "flicker" or "walk"; the lower one is 0 if the term may be absent.

        The interval holds every value that a likelihood-ratio test accepts. Raises ArgumentError for a term that was
        not fitted.
        """
        from scipy.optimize import brentq

        if name not in self.terms:
            fitted = ", ".join(f"'{t}'" for t in self.terms)
            raise ArgumentError(f"'{name}' was not fitted; the fitted terms are {fitted}", "name")
        if not 0 < level < 1:
            raise ArgumentError(f"expected a level between 0 and 1; found {level}", "level")
        k, limit = [str(t) for t in self.terms].index(name), half_width(level) ** 2
        squares = np.array([getattr(self, term) ** 2 for term in self.terms])

        def beyond(root: float) -> float:
            return self.curves.distance(k, root**2, squares) - limit

        estimate = float(np.sqrt(squares[k]))
        high = max(estimate, 1e-3 * float(np.sqrt(np.min(self.curves.variances / self.curves.units[:, k]))))
        while beyond(high) < 0:
            high *= 1.5
        high = brentq(beyond, estimate, high, xtol=1e-6 * high)
        low = 0.0 if beyond(0.0) < 0 else brentq(beyond, 0.0, estimate, xtol=1e-6 * estimate)
        return float(low), float(high)  # type: ignore[arg-type]

    def mean_deviation(self, duration: float) -> float:
        """Return the standard deviation of the bias at the end of a log of this duration [s], estimated by its mean.

        White noise averages out; the bias itself drifts by random walk and flicker. A short log cannot exclude these
        terms, so its standard deviation tends to be too large.
        """
        return float(np.sqrt(self.white**2 / duration + FLAT * self.flicker**2 + self.walk**2 * duration / 3))


def allan_fit(values: Any, period: float, *, terms: Sequence[NoiseTerm] = TERMS) -> AllanFit:
    """Fit white-noise density, bias instability and bias random walk to a log at rest, with intervals.

    Generalised least squares on the Allan variances, weighted with the covariance that the fitted noise implies. No
    coefficient is negative.

    Args:
        values: samples (n,) at rest, one every `period` [s], n at least 64.
        terms: the terms to fit.

    Raises ArgumentError if samples are not finite or too few, or if the log has no noise.

    Source: IEEE Std 952-1997, annex C; Guerrier, Skaloud, Stebler, Victoria-Feser 2013, J. Am. Stat. Assoc. 108,
    1021-1030, for the weights.

    >>> rng = np.random.default_rng(0)  # synthetic: white noise of density 1e-3 at 100 Hz, seed 0
    >>> fit = gt.filtering.allan_fit(1e-2 * rng.standard_normal(5000), 0.01)
    >>> low, high = fit.interval("white")
    >>> bool(low < 1e-3 < high), fit.interval("walk")[0]
    (True, 0.0)
    >>> gt.filtering.Sensor("gyro", "rate", density=fit.white, period=0.01).name
    'gyro'
    """
    y = _samples(values, period)
    chosen: tuple[NoiseTerm, ...] = tuple(term for term in TERMS if term in terms)
    if not chosen or len(chosen) != len(set(terms)):
        raise ArgumentError(f"expected terms from 'white', 'flicker', 'walk'; found {list(terms)}", "terms")
    if len(y) < LEAST:
        raise ArgumentError(f"expected at least {LEAST} samples; found {len(y)}", "values")
    m = _powers(len(y))
    variances = _variances(y, m)
    if not np.all(variances > 0):
        raise ArgumentError("the values do not change: they were rounded, or they are not a measurement", "values")
    tau = m * period
    curves = _Curves(variances, *_model(chosen, m, len(y), period))
    squares = curves.fit()
    fitted = curves.units @ squares
    A, y_white = curves.weighted(squares)
    notes = []
    if np.sum((y_white - A @ squares) ** 2) > chi_squared_bound(1 - UNEXPLAINED, len(m) - len(chosen)):
        worst = tau[int(np.argmax(np.abs(np.log(variances / fitted))))]
        notes.append(
            f"{', '.join(chosen)} do not explain the Allan curve, worst at {worst:.3g} s: look for vibration, a filter "
            "in the sensor, rounding, or warm-up"
        )
    roots = dict(zip(chosen, np.sqrt(squares), strict=True))
    density, flicker, walk = (float(roots.get(term, 0.0)) for term in TERMS)
    return AllanFit(
        density, flicker, walk, chosen, tau, np.sqrt(variances), np.sqrt(fitted),
        float(period), tuple(notes), curves,
    )  # fmt: skip


def _samples(values: Any, period: float) -> np.ndarray:
    y = np.asarray(values, float)
    if y.ndim != 1 or not np.all(np.isfinite(y)):
        raise ArgumentError(
            f"expected finite samples (n,) of one axis; found shape {y.shape}, {np.sum(~np.isfinite(y))} not finite",
            "values",
        )
    if not period > 0:
        raise ArgumentError(f"expected more than 0 s; found {period}", "period")
    return y - y.mean()


def _powers(n: int) -> np.ndarray:
    return 2 ** np.arange(max(1, int(np.log2(max(n, 2) / LONGEST)) + 1))


def _variances(y: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Overlapping Allan variances."""
    S = np.concatenate([[0.0], np.cumsum(y)])
    variances = []
    for m in sizes.tolist():
        d = (S[2 * m :] - 2 * S[m:-m] + S[: -2 * m]) / m
        variances.append(0.5 * float(d @ d) / len(d))
    return np.array(variances)


def _model(terms: Sequence[NoiseTerm], m: np.ndarray, n: int, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Allan variances of each term with a coefficient of one (k, terms), and for each pair of terms the covariance of
    the overlapping Allan variances of Gaussian noise (terms, terms, k, k), from spectra and averaging filters.

    The covariance of means of n_i and n_j squares of two processes with cross-spectrum C is
    2 int |C|^2 df / max(n_i, n_j). This is an upper bound: it counts each lag as often as the shorter sum holds it.
    """
    count = 16 * int(m[-1])
    units, total = np.zeros((len(m), len(terms))), np.zeros((len(terms), len(terms), len(m), len(m)))
    for begin in range(0, count, CHUNK):
        f = (np.arange(begin, min(begin + CHUNK, count)) + 0.5) / (2 * count)  # cycles per sample, up to 1/2
        s = np.sin(np.pi * f)
        spectra = {"white": 1 / period + 0 * f, "flicker": 1 / (2 * np.pi * f), "walk": period / (4 * s**2)}
        gain = 2 * np.sin(np.pi * f * m[:, None]) ** 4 / (m[:, None] * s) ** 2  # half the squared difference
        W = [gain * spectra[term] for term in terms]
        units += np.column_stack([w.sum(axis=1) for w in W]) / count
        for t, first in enumerate(W):
            for u, second in enumerate(W):
                total[t, u] += first @ second.T
    pairs = n - 2 * m + 1
    return units, 2 * total / count / np.maximum.outer(pairs, pairs)
