"""Description of a stream: statistics of its columns from a single pass, its clocks, and the probable units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...lang.units import convert, parse_unit
from ...results.interpolation import NEAR, nature_of
from ...results.quantity import unit_of
from ...results.trajectory_checks import Array
from ..sampling import SamplingReport, sampling_of
from ..streams.heads import is_unit, spelled

ENOUGH = 100_000  # largest number of rows for the comparison of two clocks
SLOWEST, FASTEST = 0.9, 1.1  # ratio of the rates of two clocks; beyond it they do not measure the same time


@dataclass(frozen=True, eq=False)
class Clock:
    """A time column: its unit ("" if unknown), its values in s (as stored if the unit is unknown), its sampling."""

    name: str
    unit: str
    time: Array
    sampling: SamplingReport

    @property
    def resets(self) -> int:
        """Number of rows at which the time goes back."""
        return self.sampling.late and int(np.sum(np.diff(self.time) < 0))


@dataclass(frozen=True)
class ClockPair:
    """Two clocks of one table: `other` - `first` is about `offset` [s] at the first row and grows with the rate
    `drift`; the deviation from this line has the robust standard deviation `residual` [s]."""

    first: str
    other: str
    offset: float
    drift: float
    residual: float


def clock_of(name: str, unit: str, values: Array) -> Clock:
    """Return the clock of a column as stored; its sampling ignores rows without a number."""
    known = is_unit(unit) and parse_unit(unit).dimension == parse_unit("s").dimension
    time = np.asarray(convert(values, unit, "s"), dtype=float) if known else values
    finite = np.isfinite(time)
    return Clock(name, unit if known else "", time, sampling_of(time if finite.all() else time[finite]))


def pairs(clocks: list[Clock]) -> list[ClockPair]:
    """Compare the clocks of a stream with the first one, as far as their units are known."""
    timed = [clock for clock in clocks if clock.unit]
    return [pair for other in timed[1:] if (pair := _pair(timed[0], other)) is not None]


def _pair(first: Clock, other: Clock) -> ClockPair | None:
    thin = slice(None, None, max(1, len(first.time) // ENOUGH))
    t, d = first.time[thin], other.time[thin] - first.time[thin]
    finite = np.isfinite(t) & np.isfinite(d)
    if finite.sum() < 3:
        return None
    # median of slopes over long spans (after Theil and Sen): robust against a reset or a bad stamp
    t, d = t[finite], d[finite]
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


HEAD = 20_000  # number of first rows kept in memory
GROWTH = 1.25  # growth factor of the buffers
BINS = 2_048  # stretches of the envelope
CLIPPED = 4  # least rows at an extreme of a clipped signal: noise reaches its extreme once
ABRUPT = 2.0  # least step into an extreme over the mean step: a signal that comes to rest there does so slowly
CUT, HELD = 0.3, 0.5  # least step over the mean step, if more than this share of all repetitions is at the extremes
LEVELS = 16  # columns with fewer distinct values are states, not signals
_STEPS = 64  # differences are expected to be less than this many quantisation steps


@dataclass
class ColumnFacts:
    """Statistics of one column.

    rows: rows with a number; empty: rows without. least, most, mean: of the numbers. step: quantisation step or 0.
    clipped: rows at the largest or smallest number, if the signal reaches it repeatedly in large steps.
    longest: longest run of rows with one number. backward, still: number of negative and of zero steps.
    """

    name: str
    rows: int
    empty: int
    least: float
    most: float
    mean: float
    step: float
    clipped: int
    longest: int
    backward: int
    still: int
    first: float
    last: float

    @property
    def constant(self) -> bool:
        """Whether all numbers are equal."""
        return self.rows > 0 and self.least == self.most


class ColumnScan:
    """Gathers the statistics of the columns of a stream from blocks of rows; the columns named in `kept` are stored."""

    def __init__(self, names: list[str], kept: list[str]) -> None:
        k = len(names)
        self.names, self.lines = names, 0
        self._places = {name: names.index(name) for name in kept}
        self._kept = {name: np.empty(0) for name in kept}
        self._count, self._sum = np.zeros(k, dtype=np.int64), np.zeros(k)
        self._least, self._most = np.full(k, np.inf), np.full(k, -np.inf)
        self._ends = [_Extreme(k, 1.0), _Extreme(k, -1.0)]
        self._backward, self._still = np.zeros(k, dtype=np.int64), np.zeros(k, dtype=np.int64)
        self._run, self._longest = np.ones(k, dtype=np.int64), np.zeros(k, dtype=np.int64)
        self._moves, self._path = np.zeros(k, dtype=np.int64), np.zeros(k)
        self._before: Array | None = None
        self._first: Array | None = None
        self.head = np.empty((0, k))
        self.envelope = Envelope(k)

    def add(self, values: Array) -> None:
        """Add rows (m, k), NaN where there is no number."""
        if not len(values):
            return
        finite = np.isfinite(values)
        self._count += finite.sum(axis=0)
        self._sum += np.where(finite, values, 0.0).sum(axis=0)
        low, high = np.where(finite, values, np.inf).min(axis=0), np.where(finite, values, -np.inf).max(axis=0)
        self._least, self._most = np.minimum(self._least, low), np.maximum(self._most, high)
        before = values[:1] if self._before is None else self._before[None]
        steps = np.diff(np.vstack([before, values]), axis=0)
        if self._before is None:
            self._first, steps = values[0].copy(), steps[1:]
        self._backward += (steps < 0).sum(axis=0)
        self._still += (steps == 0).sum(axis=0)
        self._moves += (np.abs(steps) > 0).sum(axis=0)
        self._path += np.nansum(np.abs(steps), axis=0)
        for end in self._ends:
            end.add(values[len(values) - len(steps) :], steps)
        self._runs(steps == 0)
        self._before = values[-1].copy()
        if len(self.head) < HEAD:
            self.head = np.vstack([self.head, values[: HEAD - len(self.head)]])
        end = self.lines + len(values)
        for name, place in self._places.items():
            if end > len(self._kept[name]):
                self._kept[name].resize(int(GROWTH * end), refcheck=False)
            self._kept[name][self.lines : end] = values[:, place]
        self.envelope.add(values)
        self.lines = end

    def numbers(self, name: str) -> Array:
        """Return all numbers of a stored column."""
        return self._kept[name][: self.lines]

    def forget(self) -> None:
        """Release the stored columns."""
        self._kept = {}

    def facts(self) -> list[ColumnFacts]:
        """Return the statistics of each column."""
        facts = []
        for j, name in enumerate(self.names):
            count = int(self._count[j])
            step = float(self._path[j] / self._moves[j]) if self._moves[j] else np.inf
            held = sum(int(end.held[j]) for end in self._ends) > HELD * self._still[j]
            at_ends = [
                int(end.rows[j])
                for end in self._ends
                if end.rows[j] >= CLIPPED and end.entries[j] > 1 and end.entry(j) > (CUT if held else ABRUPT) * step
            ]
            clipped = sum(at_ends) if len(np.unique(self.head[:, j])) > LEVELS else 0
            facts.append(
                ColumnFacts(
                    name, count, self.lines - count,
                    *((float(self._least[j]), float(self._most[j]), float(self._sum[j] / count)) if count else _NONE),
                    quantum(self.head[:, j]), clipped, int(self._longest[j]),
                    int(self._backward[j]), int(self._still[j]),
                    float(self._first[j]) if self._first is not None else np.nan,
                    float(self._before[j]) if self._before is not None else np.nan,
                )
            )  # fmt: skip
        return facts

    def _runs(self, same: np.ndarray) -> None:
        """Update the length of the current run of equal rows, and the longest one."""
        if not len(same):
            self._longest = np.maximum(self._longest, self._run)
            return
        m = len(same)
        changes = np.where(same, 0, np.arange(1, m + 1)[:, None])
        last = np.maximum.accumulate(changes, axis=0)  # row of the last change, 0: before this block
        run = np.arange(1, m + 1)[:, None] - last + np.where(last == 0, self._run, 1)
        self._longest = np.maximum(self._longest, run.max(axis=0))
        self._run = run[-1]


_NONE = (np.nan, np.nan, np.nan)


class _Extreme:
    """Rows at the largest number so far (the smallest for sign -1), and the steps that lead there."""

    def __init__(self, k: int, sign: float) -> None:
        self._sign, self._most = sign, np.full(k, -np.inf)
        self.rows, self.held, self.entries = (np.zeros(k, dtype=np.int64) for _ in range(3))
        self._steps = np.zeros(k)

    def add(self, values: Array, steps: Array) -> None:
        """Add rows, and the step from the previous row to each."""
        if not len(values):
            return
        signed = self._sign * values
        high = np.where(np.isfinite(signed), signed, -np.inf).max(axis=0)
        above = high > self._most
        self.rows[above] = self.held[above] = self.entries[above] = 0
        self._steps[above] = 0.0
        self._most = np.maximum(self._most, high)
        for j in np.flatnonzero((high == self._most) & np.isfinite(high)):
            extreme = signed[:, j] == self._most[j]
            into = np.abs(steps[extreme, j])
            into = into[into > 0]
            self.rows[j] += int(extreme.sum())
            self.held[j] += int((steps[extreme, j] == 0).sum())
            self.entries[j] += len(into)
            self._steps[j] += float(into.sum())

    def entry(self, j: int) -> float:
        """Return the mean step into the extreme."""
        return float(self._steps[j] / self.entries[j]) if self.entries[j] else 0.0


class Envelope:
    """Smallest and largest number of each column in stretches of equal length, at most 2 `BINS` of them."""

    def __init__(self, k: int) -> None:
        self.width = 1
        self.low, self.high, self._rows = np.empty((0, k)), np.empty((0, k)), 0

    def add(self, values: Array) -> None:
        """Add rows; NaN are ignored."""
        bins = (self._rows + np.arange(len(values))) // self.width
        self._rows += len(values)
        begins = np.flatnonzero(np.diff(bins, prepend=-1))
        low, high = np.fmin.reduceat(values, begins, axis=0), np.fmax.reduceat(values, begins, axis=0)
        if len(self.low) and bins[0] == len(self.low) - 1:
            self.low[-1], self.high[-1] = np.fmin(self.low[-1], low[0]), np.fmax(self.high[-1], high[0])
            low, high = low[1:], high[1:]
        self.low, self.high = np.vstack([self.low, low]), np.vstack([self.high, high])
        while len(self.low) > 2 * BINS:
            begins = np.arange(0, len(self.low), 2)
            self.low = np.fmin.reduceat(self.low, begins, axis=0)
            self.high = np.fmax.reduceat(self.high, begins, axis=0)
            self.width *= 2

    @property
    def rows(self) -> np.ndarray:
        """Middle row of each stretch."""
        return np.minimum((np.arange(len(self.low)) + 0.5) * self.width - 0.5, max(self._rows - 1, 0))


def quantum(values: Array) -> float:
    """Return the quantisation step of a column, of which all changes are multiples; 0 if there is none.

    >>> from gtmodel.measurements.inspection.columns import quantum
    >>> quantum(np.array([0.0, 0.25, 0.25, 1.0, 0.5])), quantum(np.array([0.0, 0.1, 0.25, 1.01]))
    (0.25, 0.0)
    """
    values = values[np.isfinite(values)]
    levels = np.unique(values)
    if len(levels) < 3:
        return 0.0
    steps = np.diff(levels)
    digits = 1e-9 * max(abs(levels[0]), abs(levels[-1]))
    steps = steps[steps > digits]
    if not len(steps):
        return 0.0
    step = float(np.min(steps))
    multiples = steps / step
    near = np.abs(multiples - np.round(multiples))
    # tolerance for numbers rounded to few digits
    if np.any(near > 0.02 * np.maximum(1.0, np.round(multiples))) or np.mean(multiples < _STEPS) < 0.5:
        return 0.0
    return float(steps.sum() / np.round(multiples).sum())


G = 9.81  # m/s2
BACKWARD = 0.2  # largest share of backward steps of a time, from late rows
LATE = 0.05  # the same of a column that is not named like a time, repeated rows included
FILETIME = (1.19e17, 1.58e17)  # 1978 to 2101 in 100 ns since 1601
TURN_RAD, TURN_DEG = 3.2, 7.0  # angles below the first are probably in rad, above the second in deg
_FORCES = r"force|torque|effort|tau|moment|drehm|load"
_CURRENTS = r"(current|strom|curr)s?(_?\d+)?$|^i_?[dquvw]$"
_ANGLES = r"angle|joint|axis|motor|enc|rot|phi|theta|psi|roll|pitch|yaw|winkel|achse|^q\d*$|^q\[|^j\d+$|(^|[._ ])a\d$"
_RATES = r"gyr|omega|angular_vel|rate"
_PLACES = r"pos|tcp|place|coord|travel|stroke|height|length|leg|^[xyz]\d*$|(^|[._])[xyz]$|cart"
_ACCELERATIONS = r"acc"
_TIMES = r"(^|[._ /])(t|time|zeit|stamp|timestamp|clock|uhr)($|[._ \[])|time$|stamp$"
_WHOLE, _PART = r"(^|[._ ])s(ecs?|econds?)?$", r"(^|[._ ])(milli|micro|nano|m|u|µ|n)s(ecs?|econds?)?$"
_NOTHING = r"count|index|token|_id$|number|flag|state|status|mode|seq"


class UnitGuess(NamedTuple):
    """A unit ("" if none can be guessed), the reason, and whether the file states it."""

    unit: str
    why: str
    stated: bool = False


def is_time(name: str) -> bool:
    """Return whether the name of a column is that of a time."""
    return re.search(_TIMES, name.lower()) is not None


def is_clock(name: str, values: Array) -> bool:
    """Return whether a column named like a time runs forward, apart from resets and late rows."""
    steps = np.diff(values[np.isfinite(values)])
    return is_time(name) and bool(np.mean(steps < 0) <= BACKWARD if len(steps) else True)


def counts_rows(values: Array) -> bool:
    """Return whether a column counts the rows, as 1, 2, 3 do: an index, which is not a time."""
    return len(values) > 2 and values[0] % 1 == 0 and bool(np.all(np.diff(values) == 1.0))


def runs_forward(name: str, values: Array) -> bool:
    """Return whether a column of another name counts time: whole numbers that increase, apart from late rows."""
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    if re.search(_NOTHING, name.lower()) or not len(steps) or np.any(values % 1 != 0):
        return False
    return bool(np.mean(steps <= 0) <= LATE and float(np.median(steps)) > 1)


class TimeParts(NamedTuple):
    """Two columns whose sum is the time: whole seconds, and the rest in `unit`."""

    whole: str
    rest: str
    unit: str

    @property
    def label(self) -> str:
        return f"{self.whole} + {self.rest}"


def time_parts(names: Sequence[str], head: Array) -> TimeParts | None:
    """Recognise a time in two neighbouring columns, such as sec and usec."""
    for j, (whole, rest) in enumerate(pairwise(names)):
        match = re.search(_PART, rest.lower())
        if match is None or not re.search(_WHOLE, whole.lower()):
            continue
        unit = "us" if match[2] in ("micro", "µ") else f"{match[2][0]}s"
        most = 1 / parse_unit(unit).scale
        two = head[np.isfinite(head[:, j : j + 2]).all(axis=1), j : j + 2]
        if len(two) < 3 or np.any(two % 1 != 0) or np.any((two[:, 1] < 0) | (two[:, 1] >= most)):
            continue
        if np.mean(np.diff(two[:, 0] - two[0, 0] + two[:, 1] / most) < 0) <= BACKWARD:
            return TimeParts(whole, rest, unit)
    return None


def unit_guess(facts: ColumnFacts, stated: str, head: Array, group: Array | None, time: bool = False) -> UnitGuess:
    """Return the unit of a column from the header, its name, or its numbers.

    stated: unit in the header, "" if there is none. head: first rows of the column. group: first rows (n, k) of the
    vector that it belongs to, or None. time: whether the column is known to be a time.
    """
    if time and not stated and facts.rows:
        return _of_time(facts, head)
    if stated:
        return UnitGuess(stated, "stated in the header", stated=True)
    name = re.sub(r"\[\d+\]$", "", facts.name)
    if unit := unit_of_name(name):
        return UnitGuess(unit, f"the name ends in it: {name}")
    if facts.constant or not facts.rows:
        return UnitGuess("", "")
    lower, size = name.lower(), max(abs(facts.least), abs(facts.most))
    if re.search(_NOTHING, lower) and np.all(head[np.isfinite(head)] % 1 == 0):
        return UnitGuess("1", "whole numbers: a count or a state")
    if is_clock(name, head):
        return _of_time(facts, head)
    if counts_rows(head):
        return UnitGuess("1", "counts the rows: an index")
    if group is not None and (known := _of_vector(lower, group)) is not None:
        return known
    if re.search(_CURRENTS, lower):
        return UnitGuess("A", "named like a current")
    if re.search(_RATES, lower):
        if size > 35.0:
            return UnitGuess("deg/s", f"named like an angular velocity, up to {size:.3g}: too fast for rad/s")
        return UnitGuess("rad/s", f"named like an angular velocity, within {size:.3g}")
    if re.search(_ACCELERATIONS, lower) or re.search(_FORCES, lower):
        return UnitGuess("", "")
    if re.search(_ANGLES, lower) and not re.search(r"vel|speed|_d\d", lower):
        if size <= TURN_RAD:
            return UnitGuess("rad", f"named like an angle, within ±{size:.3g}: at most half a turn in rad")
        if TURN_DEG < size <= 3600.0:
            return UnitGuess("deg", f"named like an angle, up to {size:.4g}")
    if re.search(_PLACES, lower) and not re.search(r"vel|speed", lower):
        if 20.0 < size < 1e5:
            return UnitGuess("mm", f"named like a position, up to {size:.4g}: too large for m")
        if 0.0 < size <= 10.0 and "leg" not in lower:
            return UnitGuess("m", f"named like a position, within {size:.3g}")
    return UnitGuess("", "")


def unit_of_name(name: str) -> str:
    """Return the unit at the end of a name: force_N, act_vel_deg_per_s, torque_nm."""
    plain = re.sub(r"_per_", "_", name)
    last = re.split(r"[_.\s/]", plain)[-1]
    if re.fullmatch(r"[A-Z]\d+", last):  # axis A1, which is no square of amperes
        return ""
    if last.lower() == "nm":
        return "N.m"
    if "_" in plain and (unit := unit_of(plain.rpartition(".")[2])):
        # a single capital letter is more often a name, as in q_A, except N and V
        return "" if len(unit) == 1 and unit not in "NVms" else unit
    text = spelled(last)
    return text if len(text) > 1 and text != name and is_unit(text) else ""


def _of_time(facts: ColumnFacts, head: Array) -> UnitGuess:
    """Guess the unit of a time: of an epoch from its size, otherwise from its step."""
    for unit, low in (("ns", 1e18), ("us", 1e15), ("ms", 1e12), ("s", 1e9)):
        if low < facts.least and facts.most < 4 * low:
            return UnitGuess(unit, f"about {facts.least:.4g}: {unit} since 1970")
    if FILETIME[0] < facts.least and facts.most < FILETIME[1]:
        return UnitGuess("100 ns", f"about {facts.least:.4g}: 100 ns since 1601")
    head = head[np.isfinite(head)]
    step = float(np.nanmedian(np.abs(np.diff(head)))) if len(head) > 1 else 0.0
    if facts.step == 1.0 and step == 1.0:
        return UnitGuess("1", "counts rows")
    for unit, low, high in (("s", 1e-5, 0.5), ("ms", 0.5, 500.0), ("us", 500.0, 5e5), ("ns", 5e5, 5e8)):
        if low <= step < high:
            return UnitGuess(unit, f"named like a time, {step:.4g} from row to row")
    return UnitGuess("", "")


def _of_vector(lower: str, group: Array) -> UnitGuess | None:
    """Recognise quaternions, and accelerations at rest, by their length."""
    rows = group[np.isfinite(group).all(axis=1)]
    if not len(rows):
        return None
    length = np.linalg.norm(rows, axis=1)
    median = float(np.median(length))
    off = np.abs(length - 1.0) > NEAR
    if nature_of(rows, "1", near=NEAR) == "quaternion":
        but = f", but {off.sum()} rows are off, the worst of length {length[np.argmax(np.abs(length - 1))]:.2g}"
        return UnitGuess("1", f"four columns of length 1: a quaternion{but if off.any() else ''}")
    if group.shape[1] == 3 and re.search(_ACCELERATIONS, lower):
        for unit, size, text in (("m/s2", G, "9.81 m/s2"), ("", 1.0, "1, so the unit is probably g = 9.81 m/s2"),
                                 ("", 1000.0, "1000, so the unit is probably a thousandth of g")):  # fmt: skip
            if abs(median - size) < 3 * NEAR * size:
                return UnitGuess(unit, f"rests at {median:.4g}, near {text}")
    return None
