"""The shift at which two recordings agree, to within a sample: by correlation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...results.trajectory_checks import Array
from ..log import LogError

OVERLAP = 0.5  # of the shorter recording: less of it says little of a shift
RIVAL = 0.98  # of the largest correlation: another peak as high leaves the shift open
FLAT = 0.5  # of the largest correlation, below which a peak ends


class Series(NamedTuple):
    """One scalar signal in both recordings: times [s] and values of the reference, and of the other by its clock."""

    name: str
    reference_time: Array
    reference: Array
    other_time: Array
    other: Array


def coarse_offset(series: Sequence[Series], low: float, high: float) -> float:
    """What the other's times want added to agree best, between low and high [s].

    The squared correlation coefficients of all series, over what overlaps, are averaged; signs do not matter. Raises
    LogError where nothing varies, and where two shifts agree alike, as with a periodic motion.
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
            "repeats itself, so give the range in which the offset lies"
        )
    return float(offsets[best])


def _correlation(s: Series, step: float) -> tuple[Array, Array]:
    """Lags in samples of the other's start against the reference's, and the squared correlation coefficient of each."""
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
        raise LogError(f"'{s.name}' does not vary; take a signal that moves in both recordings")
    varied = enough & (var_x > least[0]) & (var_y > least[1])
    square = np.full(len(lags), np.nan)
    square[varied] = between[varied] ** 2 / (var_x[varied] * var_y[varied])
    return lags.astype(float), square


def _even(time: Array, values: Array, step: float) -> Array:
    return np.interp(np.arange(time[0], time[-1] + 0.5 * step, step), time, values)


def _rival(score: Array, best: int) -> int | None:
    """Another peak nearly as high, beyond the valley beside the best one."""
    low = score < FLAT * score[best]
    left, right = np.flatnonzero(low[:best]), np.flatnonzero(low[best:])
    others = score.copy()
    others[(left[-1] if left.size else 0) : best + (right[0] if right.size else len(score)) + 1] = -1.0
    other = int(np.argmax(others))
    return other if others[other] > RIVAL * score[best] else None
