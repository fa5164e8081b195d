"""Clocks of a stream: how they run, and how two in one table go with each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...lang.units import convert, parse_unit
from ...results.trajectory_checks import Array
from ..sampling import SamplingReport, sampling_of
from ..streams.heads import is_unit

ENOUGH = 100_000  # rows by which two clocks are compared
SLOWEST, FASTEST = 0.9, 1.1  # of one clock against another: beyond these they are no clocks of one thing


@dataclass(frozen=True, eq=False)
class Clock:
    """A column of time: its unit, "" if it is not known, its values in s or as they stand, and how they follow."""

    name: str
    unit: str
    time: Array
    sampling: SamplingReport

    @property
    def resets(self) -> int:
        """How often the time goes back."""
        return self.sampling.late and int(np.sum(np.diff(self.time) < 0))


@dataclass(frozen=True)
class ClockPair:
    """Two clocks of one table: `other` - `first` is `offset` [s] at the first row and grows by `drift`, roughly; what a
    straight line leaves has the standard deviation `residual` [s]."""

    first: str
    other: str
    offset: float
    drift: float
    residual: float


def clock_of(name: str, unit: str, values: Array) -> Clock:
    """A clock from a column as it stands; rows without a number are left out of how they follow."""
    known = is_unit(unit) and parse_unit(unit).dimension == parse_unit("s").dimension
    time = np.asarray(convert(values, unit, "s"), dtype=float) if known else values
    whole = np.isfinite(time)
    return Clock(name, unit if known else "", time, sampling_of(time if whole.all() else time[whole]))


def pairs(clocks: list[Clock]) -> list[ClockPair]:
    """The clocks of a stream that go with the first one of known unit."""
    timed = [clock for clock in clocks if clock.unit]
    made: list[ClockPair] = []
    for other in timed[1:]:
        pair = _pair(timed[0], other)
        made += [pair] if pair is not None else []
    return made


def _pair(first: Clock, other: Clock) -> ClockPair | None:
    thin = slice(None, None, max(1, len(first.time) // ENOUGH))
    t, d = first.time[thin], other.time[thin] - first.time[thin]
    good = np.isfinite(t) & np.isfinite(d)
    if good.sum() < 3:
        return None
    # Theil and Sen in the large: a reset or a bad stamp does not move it
    t, d = t[good], d[good]
    if np.ptp(t) == 0.0:
        return None
    quarter = max(1, len(t) // 4)
    slopes = (d[-quarter:] - d[:quarter]) / np.where(t[-quarter:] == t[:quarter], np.nan, t[-quarter:] - t[:quarter])
    if not np.isfinite(slopes).any():
        return None
    drift = float(np.nanmedian(slopes))
    if not SLOWEST < 1 + drift < FASTEST:
        return None
    offset = float(np.median(d - drift * (t - t[0])))
    rest = d - drift * (t - t[0]) - offset
    return ClockPair(first.name, other.name, offset, drift, float(1.4826 * np.median(np.abs(rest))))
