"""Sampling of a recording: rate, jitter, gaps, late and repeated rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..results.trajectory_checks import Array

LateRows = Literal["refuse", "drop", "sort"]
EmptyRows = Literal["refuse", "drop"]
MISSING = 0.5  # a step longer than 1 + MISSING sample times is a missing sample, not jitter
FENCE = 1.5  # a step this many interquartile ranges above the upper quartile is not jitter
MOST_LOST = 1e15  # limit on the samples of a gap, for times that are not plausible
LONGEST_LIST = 1000  # number of gaps listed


@dataclass(frozen=True)
class Gap:
    """A gap of about `missing` samples after row `row` (from 0) at `time` [s]; the step lasts `duration` [s]."""

    row: int
    time: float
    duration: float
    missing: int


@dataclass(frozen=True)
class SamplingReport:
    """Sampling statistics of a recording.

    rows: number of rows. step: median time between rows [s]. rate: 1 / step [Hz]. duration: span of the times [s].
    jitter: standard deviation of the steps over the median step, from the quartiles, so that gaps do not count.
        most: the largest deviation of a step from the median, over the median, gaps excluded.
    gaps: the first thousand steps that are longer than 1.5 medians and longer than the jitter explains.
        missing: estimated share of the samples that is missing.
    late, repeated: number of rows whose time is before, or equal to, the time of an earlier row.
    """

    rows: int
    step: float
    rate: float
    duration: float
    jitter: float
    most: float
    gaps: tuple[Gap, ...] = field(repr=False)
    missing: float
    late: int
    repeated: int

    def even(self, jitter: float) -> bool:
        """Return whether there are no gaps or late rows and every step is within this share of the median."""
        return not (self.gaps or self.late or self.repeated) and self.most <= jitter


def sampling_of(time: Array | Sequence[float]) -> SamplingReport:
    """Return the sampling statistics of times [s], given in the order of the rows.

    >>> sampling = gt.measurements.sampling_of([0.0, 0.01, 0.02, 0.05, 0.06, 0.07])
    >>> round(sampling.rate, 6), sampling.gaps[0].missing, sampling.gaps[0].row
    (100.0, 2, 2)
    """
    time = np.asarray(time, dtype=float)
    steps = np.diff(time)
    late, repeated, forward = 0, 0, steps
    if steps.size and steps.min() <= 0:
        steps = time[1:] - np.maximum.accumulate(time)[:-1]
        late, repeated = int(np.sum(steps < 0)), int(np.sum(steps == 0))
        forward = steps[steps > 0]
    rows, span = int(time.size), float(np.ptp(time)) if time.size else 0.0
    if not forward.size:
        return SamplingReport(rows, 0.0, 0.0, span, 0.0, 0.0, (), 0.0, late, repeated)
    # few copies: a clock may have ten million rows
    low, step, high = (float(x) for x in np.percentile(forward, [25.0, 50.0, 75.0]))
    longest = max((1 + MISSING) * step, high + FENCE * (high - low))
    wide = np.flatnonzero(steps > longest)
    lost = np.maximum(np.round(np.minimum(steps[wide] / step, MOST_LOST)).astype(int) - 1, 1)
    gaps = tuple(
        Gap(int(k), float(time[k]), float(steps[k]), int(n))
        for k, n in zip(wide[:LONGEST_LIST], lost[:LONGEST_LIST], strict=True)
    )
    slowest = float(np.max(forward, where=forward <= longest, initial=step))
    most = max(slowest / step - 1.0, 1.0 - float(forward.min()) / step)
    missing = float(lost.sum() / (lost.sum() + rows))
    # rounding: each of two times is off by half a unit in the last place
    spread = high - low if high - low > 4 * np.spacing(max(abs(float(time.min())), abs(float(time.max())))) else 0.0
    return SamplingReport(rows, step, 1 / step, span, spread / 1.349 / step, most, gaps, missing, late, repeated)


def in_order(time: Array, late_rows: LateRows) -> np.ndarray | None:
    """Return the indices of the rows to take so that the time increases strictly, or None to take all rows.

    late_rows: "drop" leaves out late and repeated rows; "sort" sorts the rows by time; "refuse" changes nothing. Of
        rows with equal times only the first is kept.
    """
    if late_rows == "refuse" or not np.any(np.diff(time) <= 0):
        return None
    if late_rows == "drop":
        latest = np.maximum.accumulate(time)
        return np.flatnonzero(np.concatenate([[True], time[1:] > latest[:-1]]))
    order = np.argsort(time, kind="stable")
    return order[np.concatenate([[True], np.diff(time[order]) > 0])]
