"""The even grid on which signals are wanted, and by which signals clocks are brought together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ...results.options import Long, Options, Unit, Within
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
