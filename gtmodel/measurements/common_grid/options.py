"""The even grid on which signals are wanted, by which signals clocks are brought together, and what the resampling
study returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from ...results import Quantity, Row, Study
from ...results.options import Long, Options, Unit, Within
from ...results.quantity import listed
from ...results.study import to_inherit
from ..resampling import Method


@dataclass(frozen=True)
class EvenGrid(Options):
    """The even grid on which signals are wanted.

    >>> gt.measurements.EvenGrid(sample_time=0.004, method="linear").longest_gap is None
    True
    """

    sample_time: Annotated[
        float | None,
        Unit("s"),
        Within(above=0),
        "from row to row; the median step, of the reference's clock, if left out",
    ] = None
    method: Annotated[Method, "between the rows: cubic spline, linear, or monotone (cubic without overshoot)"] = "cubic"
    longest_gap: Annotated[
        float | None, Unit("s"), Within(above=0),
        "that is bridged; a longer one parts the recording. Five median steps if left out",
    ] = None  # fmt: skip
    start: Annotated[
        float | None, Unit("s"), "first row, on the reference's clock; the first instant of all signals if left out"
    ] = None
    end: Annotated[
        float | None, Unit("s"), "no row behind it, on the reference's clock; the last instant of all if left out"
    ] = None


@dataclass(frozen=True)
class AlignBy(Options):
    """Two signals that show one motion by different clocks; the clock of the second is brought to that of the first.

    >>> gt.measurements.AlignBy("angle", "tracker_angle").drift
    True
    """

    reference: Annotated[str, "the signal whose clock stays; the same clock in all pairs"]
    other: Annotated[str, "the signal whose clock is moved, with all other signals of that clock"]
    drift: Annotated[bool, "whether the two clocks may differ in rate"] = True
    scale: Annotated[bool, "whether the second signal may be the first one times a factor"] = True
    shift: Annotated[bool, "whether it may be shifted by a constant"] = True
    offset_range: Annotated[
        list[float] | None, Unit("s"), Long(2),
        "where the offset is sought; wherever half of the shorter recording overlaps if left out",
    ] = None  # fmt: skip


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ResamplingStudy(Study):
    """Signals of one recording on one even grid: `trajectory`, and how good it is. Empty where it was stopped before.

    By clock: how its rows follow each other, and where it stands against the reference's. By signal, in its SI unit:
    what the method misses its rows by where every other one is left out.
    """

    clocks: Annotated[
        Sequence[str], "names, in the order of all that is said by clock; the first is the reference"
    ] = ()
    rows_read: Annotated[Sequence[int], "of each clock"] = ()
    rows_left_out: Annotated[Sequence[int], "of each clock: rows that lacked a number, came late or twice"] = ()
    rate: Annotated[Sequence[float], Quantity("Hz", "of each clock: one over the median step")] = ()
    jitter: Annotated[Sequence[float], "of each clock: spread of its steps as a share of the median"] = ()
    gaps: Annotated[Sequence[int], "of each clock: where rows are missing"] = ()
    longest_gap: Annotated[Sequence[float], Quantity("s", "of each clock: its longest step")] = ()
    missing: Annotated[Sequence[float], "of each clock: rows that are missing as a share of those that were to be"] = ()
    sample_time: Annotated[float | None, Quantity("s", "of the grid")] = None
    rows_written: Annotated[int | None, "on the grid"] = None
    stretches: Annotated[int | None, "between gaps too long to bridge; their number is the signal `session`"] = None
    method: Annotated[str, "between the rows"] = ""
    units: Annotated[Mapping[str, str], "by signal: its SI unit"] = field(default_factory=dict)
    error: Annotated[
        Mapping[str, Sequence[float]],
        "by signal and component: rows left out are missed by this, rms, in its unit; noise of the rows is in it",
    ] = field(default_factory=dict)
    length: Annotated[Mapping[str, float], "by vector signal: median of its length, in its unit"] = field(
        default_factory=dict
    )
    offset: Annotated[
        Mapping[str, float], Quantity("s", "by clock: what its times want added in the middle of its recording")
    ] = field(default_factory=dict)
    offset_interval: Annotated[Mapping[str, Sequence[float]], Quantity("s", "95 %")] = field(default_factory=dict)
    drift: Annotated[
        Mapping[str, float], Quantity("1", "by clock that may differ in rate: how much slower it runs")
    ] = field(default_factory=dict)
    drift_interval: Annotated[Mapping[str, Sequence[float]], Quantity("1", "95 %")] = field(default_factory=dict)
    explained: Annotated[Mapping[str, float], "by clock: share of its signal that the common curve explains"] = field(
        default_factory=dict
    )
    coloured: Annotated[
        Mapping[str, bool], "by clock: whether residuals are coloured, which the intervals then heed"
    ] = field(default_factory=dict)
    synthetic: Annotated[str | None, "seed and noise of a synthetic recording; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = []
        for k, clock in enumerate(self.clocks):
            left = f", {self.rows_left_out[k]} left out" if self.rows_left_out[k] else ""
            rows.append(Row(f"clock {clock}", f"{self.rows_read[k]} rows{left}, {self.rate[k]:.5g}", "Hz"))
            if self.gaps[k]:
                gaps = "one gap" if self.gaps[k] == 1 else f"{self.gaps[k]} gaps"
                missing = f"; {gaps}, {100 * self.missing[k]:.2g} % missing, at most {1e3 * self.longest_gap[k]:.4g} ms"
            else:
                missing = "; no gap"
            rows.append(Row("  jitter", f"{100 * self.jitter[k]:.2g} %{missing}"))
            rows += self._aligned(clock)
        if self.sample_time is None:
            return rows
        parts = "" if self.stretches == 1 else f", in {self.stretches} stretches between gaps"
        rows.append(Row("rows written", f"{self.rows_written}, every {1e3 * self.sample_time:.6g} ms{parts}"))
        for name, error in self.error.items():
            rows.append(Row(f"error of {name}", f"{listed(error)}  (rms, {self.method})", self.units[name]))
            if name in self.length:
                rows.append(Row(f"  length of {name}", f"{self.length[name]:.4g}  (median)", self.units[name]))
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])

    def _aligned(self, clock: str) -> list[Row]:
        rows = []
        for label, values, intervals, factor, unit in (
            ("  offset", self.offset, self.offset_interval, 1.0, "s"),
            ("  drift", self.drift, self.drift_interval, 1e6, "ppm"),
        ):
            if clock not in values:
                continue
            low, high = factor * np.asarray(intervals[clock])
            digits = _digits(low, high)
            text = f"{low:.{digits}g} .. {high:.{digits}g}, 95 %"
            rows.append(Row(label, f"{factor * values[clock]:.{digits}g}  ({text})", unit))
        return rows


def _digits(low: float, high: float) -> int:
    """As many as show the width of an interval."""
    size = max(abs(low), abs(high))
    return 4 if high <= low or size == 0 else int(np.clip(np.ceil(np.log10(size / (high - low))) + 3, 3, 12))
