"""How a recording is sampled: its rate, jitter, gaps, and rows that come late or twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..results.trajectory_checks import Array

LateRows = Literal["refuse", "drop", "sort"]
EmptyRows = Literal["refuse", "drop"]
MISSING = 0.5  # of a sample time beyond the next row: a sample is missing, not late
FENCE = 1.5  # interquartile ranges above the upper quartile: a step beyond is no jitter
MOST_LOST = 1e15  # samples in a gap: more are a time that is no time
LONGEST_LIST = 1000  # gaps that are kept one by one


@dataclass(frozen=True)
class Gap:
    """Samples that are missing: behind `row`, from 0, at `time` [s], for `duration` [s], about `missing` of them."""

    row: int
    time: float
    duration: float
    missing: int


@dataclass(frozen=True)
class SamplingReport:
    """How the rows of a recording follow each other.

    rows: their number. step: median time from row to row [s]. rate: its inverse [Hz]. duration: last minus first [s].
    jitter: deviation of a step from the median, as a share of it: the standard deviation of a normal distribution with
        the same quartiles, for gaps are no jitter. most: the largest deviation of a step that is no gap, as a share.
    gaps: where samples are missing, the first thousand: steps half as long again as the median, and longer than the
        jitter explains. missing: about how many in all, as a share of those that were to be.
    late, repeated: rows whose time is before, or that of, an earlier row.
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
        """Whether each step is the median within this share, without gaps and late rows."""
        return not (self.gaps or self.late or self.repeated) and self.most <= jitter


def sampling_of(time: Array | Sequence[float]) -> SamplingReport:
    """How these times [s] follow each other, in the order of the rows.

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
    # no more copies than needed: a clock may have ten million rows
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
    # two times are each off by half a unit in the last place
    spread = high - low if high - low > 4 * np.spacing(max(abs(float(time.min())), abs(float(time.max())))) else 0.0
    return SamplingReport(rows, step, 1 / step, span, spread / 1.349 / step, most, gaps, missing, late, repeated)


def in_order(time: Array, late_rows: LateRows) -> np.ndarray | None:
    """Which rows to take, in which order, so that the time increases strictly; None for all as they are.

    late_rows: "drop" leaves out what comes late or twice, "sort" brings late rows to their place; of rows at one time
    the first is taken. "refuse" changes nothing.
    """
    if late_rows == "refuse" or not np.any(np.diff(time) <= 0):
        return None
    if late_rows == "drop":
        latest = np.maximum.accumulate(time)
        return np.flatnonzero(np.concatenate([[True], time[1:] > latest[:-1]]))
    order = np.argsort(time, kind="stable")
    return order[np.concatenate([[True], np.diff(time[order]) > 0])]
