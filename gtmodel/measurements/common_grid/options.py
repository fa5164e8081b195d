"""Options and result of the resampling study: the even grid, and the signals that align the clocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from ...results import Quantity, Row, Study
from ...results.options import Long, Options, Unit, Within
from ...results.quantity import listed
from ...results.study import to_inherit
from ..resampling import Method


@dataclass(frozen=True)
class EvenGrid(Options):
    """The even grid on which signals are resampled.

    >>> gt.measurements.EvenGrid(sample_time=0.004, method="linear").longest_gap is None
    True
    """

    sample_time: Annotated[
        float | None,
        Unit("s"),
        Within(above=0),
        "sample time of the grid; default: the median step of the reference clock",
    ] = None
    method: Annotated[Method, "interpolation: cubic spline, linear, or monotone (cubic without overshoot)"] = "cubic"
    longest_gap: Annotated[
        float | None, Unit("s"), Within(above=0),
        "longest gap that is bridged; a longer gap splits the recording. Default: five median steps",
    ] = None  # fmt: skip
    start: Annotated[
        float | None, Unit("s"), "first time, on the reference clock; default: the first time common to all signals"
    ] = None
    end: Annotated[
        float | None, Unit("s"), "last time, on the reference clock; default: the last time common to all signals"
    ] = None


Curve = Literal["values", "length", "speed"]


@dataclass(frozen=True)
class AlignBy(Options):
    """Two signals of one motion on different clocks; the clock of the second is aligned with the clock of the first.

    Lengths and speeds do not depend on the frames of the sensors: the speed of a quaternion is the angular speed, and
    equals the length of a gyroscope's rates on the same body.

    >>> gt.measurements.AlignBy("angle", "tracker_angle").drift
    True
    >>> by = gt.measurements.AlignBy("orientation", "gyro", reference_curve="speed", other_curve="length")
    """

    reference: Annotated[str, "signal on the reference clock, which is the same in all pairs"]
    other: Annotated[str, "signal on the other clock; all signals of that clock are shifted"]
    drift: Annotated[bool, "whether the two clocks may differ in rate"] = True
    scale: Annotated[bool, "whether the signals may differ by a factor"] = True
    shift: Annotated[bool, "whether the signals may differ by a constant"] = True
    offset_range: Annotated[
        list[float] | None, Unit("s"), Long(2),
        "search range of the offset; default: all offsets at which half of the shorter recording overlaps",
    ] = None  # fmt: skip
    reference_curve: Annotated[
        Curve,
        "the common curve: values of the signal; length of a vector, such as a gyroscope's; or speed: length of its "
        "derivative, for a quaternion or rotation matrix the angular speed",
    ] = "values"
    other_curve: Annotated[Curve, "the same for the other signal"] = "values"
    window: Annotated[
        float | None, Unit("s"), Within(above=0),
        "time over which vectors and derivatives are averaged before their length is taken, and step of the curve; if "
        "left out, four steps of the slower clock if one curve is a speed, else nothing is averaged",
    ] = None  # fmt: skip


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ResamplingStudy(Study):
    """Signals of one recording on one even grid (`trajectory`), and their quality. Empty if it was stopped early.

    Per clock: sampling statistics, and the alignment with the reference clock. Per signal, in its SI unit: the error of
    interpolating every other row from the remaining rows.
    """

    clocks: Annotated[Sequence[str], "names, in the order of all lists per clock; the first is the reference"] = ()
    rows_read: Annotated[Sequence[int], "per clock: rows read"] = ()
    rows_left_out: Annotated[
        Sequence[int], "per clock: rows dropped because they lack a number, are late or repeat"
    ] = ()
    rate: Annotated[Sequence[float], Quantity("Hz", "per clock: sampling rate, 1 / median step")] = ()
    jitter: Annotated[Sequence[float], "per clock: spread of the steps over the median step"] = ()
    gaps: Annotated[Sequence[int], "per clock: number of gaps"] = ()
    longest_gap: Annotated[Sequence[float], Quantity("s", "per clock: longest step")] = ()
    missing: Annotated[Sequence[float], "per clock: share of missing rows"] = ()
    sample_time: Annotated[float | None, Quantity("s", "sample time of the grid")] = None
    rows_written: Annotated[int | None, "rows of the grid"] = None
    stretches: Annotated[int | None, "stretches between gaps too long to bridge, numbered by the signal `session`"] = (
        None
    )
    method: Annotated[str, "interpolation method"] = ""
    units: Annotated[Mapping[str, str], "per signal: SI unit"] = field(default_factory=dict)
    error: Annotated[
        Mapping[str, Sequence[float]],
        "per signal and component: RMS error of interpolating left-out rows, in the signal's unit, noise included",
    ] = field(default_factory=dict)
    length: Annotated[Mapping[str, float], "per vector signal: median length, in its unit"] = field(
        default_factory=dict
    )
    offset: Annotated[
        Mapping[str, float], Quantity("s", "per clock: offset to add to its times, at the middle of its recording")
    ] = field(default_factory=dict)
    offset_interval: Annotated[Mapping[str, Sequence[float]], Quantity("s", "95 %")] = field(default_factory=dict)
    drift: Annotated[
        Mapping[str, float], Quantity("1", "per clock, if estimated: relative rate by which it runs slow")
    ] = field(default_factory=dict)
    drift_interval: Annotated[Mapping[str, Sequence[float]], Quantity("1", "95 %")] = field(default_factory=dict)
    explained: Annotated[Mapping[str, float], "per clock: share of the variance that the common curve explains"] = (
        field(default_factory=dict)
    )
    coloured: Annotated[
        Mapping[str, bool], "per clock: whether the residuals are coloured; the intervals then allow for it"
    ] = field(default_factory=dict)
    synthetic: Annotated[str | None, "seed and noise of a synthetic recording; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = []
        for k, clock in enumerate(self.clocks):
            dropped = f", {self.rows_left_out[k]} left out" if self.rows_left_out[k] else ""
            rows.append(Row(f"clock {clock}", f"{self.rows_read[k]} rows{dropped}, {self.rate[k]:.5g}", "Hz"))
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
    """Return the number of digits that shows the width of an interval."""
    size = max(abs(low), abs(high))
    return 4 if high <= low or size == 0 else int(np.clip(np.ceil(np.log10(size / (high - low))) + 3, 3, 12))
