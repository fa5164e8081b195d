"""Numbers that describe the columns of a stream, gathered in one pass over rows of any count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...results.trajectory_checks import Array

HEAD = 20_000  # first rows that are kept, for what needs neighbours
GROWTH = 1.25  # of what is kept
BINS = 2_048  # of the envelope that is drawn
CLIPPED = 4  # rows at one extreme: noise comes there once
ABRUPT = 2.0  # times the mean step: what rests at its extreme comes there slowly
CUT, HELD = 0.3, 0.5  # of the mean step, where so much of all repetition is at the extremes
LEVELS = 16  # with fewer a column is a state, not a signal
_STEPS = 64  # a quantisation step is one that all differences are multiples of, up to this


@dataclass
class ColumnFacts:
    """One column: what it holds.

    rows: those that hold a number; empty: those that do not. least, most, mean: of the numbers. step: smallest change,
    where all changes are multiples of it, 0 if they are not. clipped: rows at the largest or smallest number, where it
    is reached again and again by steps larger than usual. longest: rows in a row that repeat one number. backward,
    still: steps back, and steps of zero.
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
        """Whether all numbers are one."""
        return self.rows > 0 and self.least == self.most


class ColumnScan:
    """Facts of the columns of a stream, from blocks of rows; `kept`: names of columns whose numbers are all kept."""

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
        """Further rows (m, k), NaN where there is no number."""
        if not len(values):
            return
        good = np.isfinite(values)
        self._count += good.sum(axis=0)
        self._sum += np.where(good, values, 0.0).sum(axis=0)
        low, high = np.where(good, values, np.inf).min(axis=0), np.where(good, values, -np.inf).max(axis=0)
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
        """All numbers of a column that is kept."""
        return self._kept[name][: self.lines]

    def forget(self) -> None:
        """Let go of the numbers that were kept."""
        self._kept = {}

    def facts(self) -> list[ColumnFacts]:
        """What was gathered, column by column."""
        made = []
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
            made.append(
                ColumnFacts(
                    name, count, self.lines - count,
                    *((float(self._least[j]), float(self._most[j]), float(self._sum[j] / count)) if count else _NONE),
                    quantum(self.head[:, j]), clipped, int(self._longest[j]),
                    int(self._backward[j]), int(self._still[j]),
                    float(self._first[j]) if self._first is not None else np.nan,
                    float(self._before[j]) if self._before is not None else np.nan,
                )
            )  # fmt: skip
        return made

    def _runs(self, same: np.ndarray) -> None:
        """Carry on the number of equal rows up to here, and its largest."""
        if not len(same):
            self._longest = np.maximum(self._longest, self._run)
            return
        m = len(same)
        at = np.where(same, 0, np.arange(1, m + 1)[:, None])
        last = np.maximum.accumulate(at, axis=0)  # the row behind which the present run began, 0: before this block
        run = np.arange(1, m + 1)[:, None] - last + np.where(last == 0, self._run, 1)
        self._longest = np.maximum(self._longest, run.max(axis=0))
        self._run = run[-1]


_NONE = (np.nan, np.nan, np.nan)


class _Extreme:
    """Rows at the largest number so far, or at the smallest where the sign is -1, and the steps that led there."""

    def __init__(self, k: int, sign: float) -> None:
        self._sign, self._most = sign, np.full(k, -np.inf)
        self.rows, self.held, self.entries = (np.zeros(k, dtype=np.int64) for _ in range(3))
        self._steps = np.zeros(k)

    def add(self, values: Array, steps: Array) -> None:
        """Further rows, and how far each is from the row before."""
        if not len(values):
            return
        signed = self._sign * values
        high = np.where(np.isfinite(signed), signed, -np.inf).max(axis=0)
        above = high > self._most
        self.rows[above] = self.held[above] = self.entries[above] = 0
        self._steps[above] = 0.0
        self._most = np.maximum(self._most, high)
        for j in np.flatnonzero((high == self._most) & np.isfinite(high)):
            at = signed[:, j] == self._most[j]
            into = np.abs(steps[at, j])
            into = into[into > 0]
            self.rows[j] += int(at.sum())
            self.held[j] += int((steps[at, j] == 0).sum())
            self.entries[j] += len(into)
            self._steps[j] += float(into.sum())

    def entry(self, j: int) -> float:
        """How far the row before an extreme was from it, in the mean."""
        return float(self._steps[j] / self.entries[j]) if self.entries[j] else 0.0


class Envelope:
    """Least and largest number of each column in stretches of equal length, at most `BINS` of them."""

    def __init__(self, k: int) -> None:
        self.width = 1
        self.low, self.high, self._rows = np.empty((0, k)), np.empty((0, k)), 0

    def add(self, values: Array) -> None:
        """Further rows; of a stretch with a NaN the numbers count."""
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
        """The row in the middle of each stretch."""
        return np.minimum((np.arange(len(self.low)) + 0.5) * self.width - 0.5, max(self._rows - 1, 0))


def quantum(values: Array) -> float:
    """The step in which a column is quantised: all changes are multiples of the smallest; 0 where they are not.

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
    # written digits make each number a little wrong
    if np.any(near > 0.02 * np.maximum(1.0, np.round(multiples))) or np.mean(multiples < _STEPS) < 0.5:
        return 0.0
    return float(steps.sum() / np.round(multiples).sum())
