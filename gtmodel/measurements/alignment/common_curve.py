"""Coarse offset between two recordings by correlation, and the fit of one smooth curve to both together with clock,
scale and shift of the second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ...inference.covariance import scales
from ...inference.nonlinear import descend
from ...results.trajectory_checks import Array
from ..log import LogError

OVERLAP = 0.5  # least overlap, as a share of the shorter recording
RIVAL = 0.98  # share of the largest correlation: a second peak as high makes the offset ambiguous
FLAT = 0.5  # share of the largest correlation below which a peak ends


class Series(NamedTuple):
    """One scalar signal in both recordings: times [s], each on its own clock, and values."""

    name: str
    reference_time: Array
    reference: Array
    other_time: Array
    other: Array


def coarse_offset(series: Sequence[Series], low: float, high: float) -> float:
    """Return the offset of the other times, between low and high [s], at which the recordings agree best.

    The criterion is the mean over all series of the squared correlation coefficient in the overlap; signs do not
    matter. Raises LogError if a signal does not vary, and if two offsets fit equally well, as for a periodic motion.
    """
    step = min(
        min(float(np.median(np.diff(s.reference_time))), float(np.median(np.diff(s.other_time)))) for s in series
    )
    score, lags = None, None
    for s in series:
        r, square = _correlation(s, step)
        lags = r
        score = square if score is None else score + square
    assert score is not None and lags is not None
    score = score / len(series)
    offsets = lags * step + series[0].reference_time[0] - series[0].other_time[0]
    inside = (offsets >= low - step) & (offsets <= high + step) & np.isfinite(score)
    if not np.any(inside):
        raise LogError(f"the recordings do not overlap at any offset between {low:g} and {high:g} s")
    score = np.where(inside, np.nan_to_num(score), -1.0)
    best = int(np.argmax(score))
    rival = _rival(score, best)
    if rival is not None:
        raise LogError(
            f"the signals agree as well at an offset of {offsets[rival]:.6g} s as at {offsets[best]:.6g} s; the motion "
            "repeats itself, so state the range of the offset"
        )
    return float(offsets[best])


def _correlation(s: Series, step: float) -> tuple[Array, Array]:
    """Return the lags of the other recording, in samples, and the squared correlation coefficient at each."""
    import scipy

    x, y = _even(s.reference_time, s.reference, step), _even(s.other_time, s.other, step)
    x, y = x - x.mean(), y - y.mean()
    n, m = len(x), len(y)

    def at_lags(a: Array, b: Array) -> Array:
        return scipy.signal.correlate(a, b, mode="full", method="fft")

    lags = np.arange(-(m - 1), n)
    ones_x, ones_y = np.ones(n), np.ones(m)
    count = np.round(at_lags(ones_x, ones_y))
    sum_x, sum_y = at_lags(x, ones_y), at_lags(ones_x, y)
    between = at_lags(x, y) - sum_x * sum_y / count
    var_x, var_y = at_lags(x * x, ones_y) - sum_x**2 / count, at_lags(ones_x, y * y) - sum_y**2 / count
    enough = count >= OVERLAP * min(n, m)
    least = 1e-9 * np.array([np.sum(x * x), np.sum(y * y)])
    if least.min() == 0.0:
        raise LogError(f"'{s.name}' does not vary; use a signal that moves in both recordings")
    varied = enough & (var_x > least[0]) & (var_y > least[1])
    square = np.full(len(lags), np.nan)
    square[varied] = between[varied] ** 2 / (var_x[varied] * var_y[varied])
    return lags.astype(float), square


def _even(time: Array, values: Array, step: float) -> Array:
    return np.interp(np.arange(time[0], time[-1] + 0.5 * step, step), time, values)


def _rival(score: Array, best: int) -> int | None:
    """Return another peak that is nearly as high as the best one, beyond the adjacent valleys."""
    low = score < FLAT * score[best]
    left, right = np.flatnonzero(low[:best]), np.flatnonzero(low[best:])
    others = score.copy()
    others[(left[-1] if left.size else 0) : best + (right[0] if right.size else len(score)) + 1] = -1.0
    second = int(np.argmax(others))
    return second if others[second] > RIVAL * score[best] else None


PROBES = 48  # simulated white residuals: traces accurate to a few per mille, the residual test to a tenth of its spread
ITERATIONS = 30
REWEIGHTS = 4  # updates of the two noise levels
RIDGE = 1e-10  # over the largest diagonal element; fixes the curve where neither recording has rows
SETTLED = 0.02  # change of the logarithm of a noise level at convergence
SMALL = 1e-9  # relative change of the residuals at convergence
# the descent ends if this many tries lowered the sum of squares by no more than this share: a row that enters another
# interval changes the sum by as much, so the step would be shortened again and again
TRIED, LEVEL = 10, 1e-9


@dataclass(frozen=True, eq=False)
class Warp:
    """Estimated parameters: offset [s] at time `at` of the other clock, drift [1], scale and shift of each series."""

    at: float
    offset: float
    drift: float
    scale: Array
    shift: Array

    def __call__(self, time: Array) -> Array:
        """Return the times on the reference clock of times on the other clock."""
        return time + self.offset + self.drift * (time - self.at)


@dataclass(frozen=True, eq=False)
class CurveFit:
    """A fitted common curve. `border` (rows, parameters): Jacobian by the parameters after elimination of the curve.
    `residuals` (rows,). Both are divided by the noise; the rows of each series are those of the reference, then those
    of the other recording. `noise` (series, 2): standard deviations. `curve`: number of coefficients. `simulated`
    (rows, PROBES): residuals of white noise."""

    warp: Warp
    spacing: float
    border: Array
    residuals: Array
    parts: tuple[tuple[slice, slice], ...]
    times: Array
    noise: Array
    curve: int
    simulated: Array = field(repr=False)

    @property
    def degrees_of_freedom(self) -> int:
        return len(self.residuals) - self.curve - self.border.shape[1]

    @property
    def sum_of_squares(self) -> float:
        return float(self.residuals @ self.residuals)


@dataclass(frozen=True)
class Freed:
    """Which of drift, scale and shift are estimated; the offset always is."""

    drift: bool
    scale: bool
    shift: bool


def fit_curve(series: Sequence[Series], warp: Warp, spacing: float, freed: Freed, noise: Array | None) -> CurveFit:
    """Fit the curve with knots `spacing` [s] apart by least squares, and estimate both noise levels.

    warp, noise (series, 2): initial values; noise None starts from the deviations of the signals. Raises LogError if
    the iteration leaves the overlap.
    """
    if noise is None:
        noise = np.array([[np.std(s.reference), np.std(s.other)] for s in series], dtype=float)
    probes = np.random.default_rng(0).normal(size=(sum(len(s.reference) + len(s.other) for s in series), PROBES))
    warp, fit = _descended(series, warp, spacing, freed, noise, probes)
    for _ in range(REWEIGHTS - 1):
        level = _levels(fit)
        if np.all(np.abs(np.log(level / fit.noise)) < SETTLED):
            break
        warp, fit = _descended(series, warp, spacing, freed, level, probes)
    level = _levels(fit)
    # rescale to the final noise levels
    unit = np.concatenate([np.full(p.stop - p.start, level[k, w] / fit.noise[k, w])
                           for k, pair in enumerate(fit.parts) for w, p in enumerate(pair)])  # fmt: skip
    return replace(fit, residuals=fit.residuals / unit, border=fit.border / unit[:, None], noise=level)


def shown(series: Sequence[Series], warp: Warp, spacing: float) -> list[float]:
    """Return the share of the variance of each recording that a curve with knots `spacing` [s] apart explains."""
    level = np.array([[np.std(s.reference), np.std(s.other)] for s in series], dtype=float)
    fit = _evaluated(series, warp, spacing, Freed(drift=False, scale=False, shift=False), level, None)
    return [1.0 - float(np.var(fit.residuals[part])) for pair in fit.parts for part in pair]


def _descended(
    series: Sequence[Series], warp: Warp, spacing: float, freed: Freed, level: Array, probes: Array
) -> tuple[Warp, CurveFit]:
    costs: list[float] = []

    def rows(x: Array) -> list[Array]:
        fit = _evaluated(series, _moved(warp, x, freed), spacing, freed, level, None)
        costs.append(fit.sum_of_squares)
        return [np.column_stack([-fit.border, fit.residuals])]

    def level_now() -> bool:
        best = min(costs)
        return len(costs) > TRIED and min(costs[:-TRIED]) - best <= LEVEL * best

    start = np.zeros(1 + freed.drift + (int(freed.scale) + int(freed.shift)) * len(series))
    size = scales(None, len(start), rows(start)[0][:, :-1])
    warp = _moved(warp, descend(rows, start, size, limit=ITERATIONS, tolerance=SMALL, stop=level_now).x, freed)
    return warp, _evaluated(series, warp, spacing, freed, level, probes)


def _moved(warp: Warp, step: Array, freed: Freed) -> Warp:
    """Add a step of the parameters, ordered as offset, drift, then scale and shift of each series."""
    k = 1 + freed.drift
    by_series = step[k:].reshape(len(warp.scale), -1)
    return replace(
        warp,
        offset=warp.offset + float(step[0]),
        drift=warp.drift + (float(step[1]) if freed.drift else 0.0),
        scale=warp.scale + (by_series[:, 0] if freed.scale else 0.0),
        shift=warp.shift + (by_series[:, -1] if freed.shift else 0.0),
    )


def _evaluated(
    series: Sequence[Series], warp: Warp, spacing: float, freed: Freed, level: Array, probes: Array | None
) -> CurveFit:
    import scipy

    each = int(freed.scale) + int(freed.shift)
    common = 1 + int(freed.drift)
    rows = sum(len(s.reference) + len(s.other) for s in series)
    border, residuals, times = np.zeros((rows, common + each * len(series))), np.zeros(rows), np.zeros(rows)
    simulated = np.zeros((rows, 0 if probes is None else PROBES))
    parts, curve, begin = [], 0, 0
    for k, s in enumerate(series):
        n, m = len(s.reference), len(s.other)
        first, second = slice(begin, begin + n), slice(begin + n, begin + n + m)
        both = slice(begin, begin + n + m)
        u = warp(s.other_time)
        if min(s.reference_time[-1], u[-1]) - max(s.reference_time[0], u[0]) <= 0:
            raise LogError(f"the recordings of '{s.name}' do not overlap at the offset {warp.offset:.6g} s")
        knots = _knots(min(s.reference_time[0], u[0]), max(s.reference_time[-1], u[-1]), spacing)
        A1 = scipy.interpolate.BSpline.design_matrix(s.reference_time, knots, 3) / level[k, 0]
        A2 = scipy.interpolate.BSpline.design_matrix(u, knots, 3) / level[k, 1]
        A = scipy.sparse.vstack([A1, warp.scale[k] * A2]).tocsr()
        y = np.concatenate([s.reference / level[k, 0], (s.other - warp.shift[k]) / level[k, 1]])
        normal = (A.T @ A).tocsc()
        diagonal = normal.diagonal()
        curve += int(np.count_nonzero(diagonal > 1e-6 * diagonal.max()))
        solve = scipy.sparse.linalg.splu(
            normal + RIDGE * diagonal.max() * scipy.sparse.eye(len(diagonal), format="csc")
        ).solve
        c = solve(A.T @ y)
        spline = scipy.interpolate.BSpline(knots, c, 3)
        rate = warp.scale[k] * spline(u, 1) / level[k, 1]
        D = np.zeros((n + m, border.shape[1]))
        D[n:, 0] = rate
        if freed.drift:
            D[n:, 1] = rate * (s.other_time - warp.at)
        column = common + each * k
        if freed.scale:
            D[n:, column] = spline(u) / level[k, 1]
        if freed.shift:
            D[n:, column + each - 1] = 1.0 / level[k, 1]
        border[both] = D - A @ solve(A.T @ D)
        residuals[both] = y - A @ c
        times[first], times[second] = s.reference_time, u
        if probes is not None:
            simulated[both] = probes[both] - A @ solve(A.T @ probes[both])
        parts.append((first, second))
        begin = both.stop
    if probes is not None:  # project out the parameters, too
        Q = np.linalg.qr(border)[0]
        simulated -= Q @ (Q.T @ simulated)
    return CurveFit(warp, spacing, border, residuals, tuple(parts), times, level, curve, simulated)


def _levels(fit: CurveFit) -> Array:
    """Estimate the standard deviations of both recordings of each series, corrected for the noise the fit absorbs."""
    new: Array = np.empty_like(fit.noise)
    for k, pair in enumerate(fit.parts):
        for which, part in enumerate(pair):
            # share of the variance of white noise that remains in the residuals
            share = float(np.mean(fit.simulated[part] ** 2))
            new[k, which] = fit.noise[k, which] * np.sqrt(np.mean(fit.residuals[part] ** 2) / max(share, 1e-6))
    floor = 1e-9 * max(float(new.max()), np.finfo(float).tiny)
    new[new < floor] = floor
    return new


def _knots(low: float, high: float, spacing: float) -> Array:
    """Return knots on a grid through zero, so that halving the spacing keeps them, with three beyond each end."""
    first, last = int(np.floor(low / spacing)), int(np.ceil(high / spacing))
    last += last == first
    return spacing * np.arange(float(first - 3), float(last + 4))
