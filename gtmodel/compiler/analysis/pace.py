"""How long a step may be without missing what a function of time does: pulses after rest, edges, ripple.

An integrator that sees a function at rest, or on a straight line, makes its steps as long as its other equations
allow, and steps over a short pulse. Bounds over cells of time (see `bounds`) show where a function may leave its
straight line; cells are halved there until they show that it does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..rewriting import Instruction
from .bounds import bounds, functions_of_time

# of a function's range: what leaves a straight line by more is followed
SEEN = 1e-4
# of a function's size: a range below this part of it is not looked at any closer, it may be round-off
FLOOR = 1e-3
# a run begins as so many cells, and none is shorter than this part of the run
CELLS, SHORTEST = 64, 2.0**-40
# cells of one function, and operations over them: a function that takes more is followed as closely as its cells are
MOST_CELLS, MOST_WORK = 300_000, 20_000_000
# straight stretches whose lengths differ by more do not share one longest step: the integrator restarts between them
RATIO = 16.0
# a step may be as long as so many straight stretches of its surroundings: a pulse has more of them
STRETCHES = 32.0


@dataclass(frozen=True, eq=False)
class Pace:
    """`knots`: times [s] at which an integrator must restart, `longest`: longest step [s] before the first of them,
    between them, and after the last."""

    knots: np.ndarray
    longest: np.ndarray

    def at(self, time: float) -> float:
        """Longest step [s] from a time on."""
        return float(self.longest[int(np.searchsorted(self.knots, time, side="right"))])


def pace_of(column: ca.SX, t: ca.SX, start: float, end: float) -> Pace:
    """Pace of every part of expressions that is a function of t alone."""
    paces = [_pace(steps, start, end) for steps in functions_of_time(column, t)]
    knots = np.unique(np.concatenate([np.zeros(0), *(p.knots for p in paces)]))
    middles = np.concatenate([[start], knots])
    return Pace(knots, np.array([min([np.inf, *(p.at(time) for p in paces)]) for time in middles.tolist()]))


def edges_of(column: ca.SX, t: ca.SX, start: float, end: float) -> np.ndarray:
    """Times [s] between which every part of expressions that is a function of t alone is a straight line to SEEN."""
    ends = [_stretches(steps, start, end)[1][:-1] for steps in functions_of_time(column, t)]
    return np.unique(np.concatenate([np.zeros(0), *map(np.array, ends)]))


def _pace(steps: Sequence[Instruction], start: float, end: float) -> Pace:
    """Pieces of time in which the straight stretches of a function are of one length, up to RATIO."""
    lengths, ends = _stretches(steps, start, end)
    knots: list[float] = []
    longest: list[float] = []
    least = most = lengths[0]
    for n in range(1, len(lengths)):
        length = lengths[n]
        # the run ends before the last stretch does
        low, high = (min(least, length), max(most, length)) if n < len(lengths) - 1 else (least, max(most, length))
        if high > RATIO * low:
            knots.append(ends[n - 1])
            longest.append(STRETCHES * least)
            low = high = length
        least, most = low, high
    return Pace(np.array(knots), np.array([*longest, STRETCHES * least if len(lengths) > 1 else np.inf]))


def _stretches(steps: Sequence[Instruction], start: float, end: float) -> tuple[list[float], list[float]]:
    """Lengths and ends of stretches, one after another, on each of which a function is a straight line to SEEN."""
    low, high, (a, b), (da, db), seen = _cells(steps, start, end)
    lengths: list[float] = []
    ends: list[float] = []
    begin = start
    hull: tuple[float, float, float, float] | None = None
    rows = zip(low.tolist(), high.tolist(), a.tolist(), b.tolist(), da.tolist(), db.tolist(), strict=True)
    for first, last, *here in rows:
        if hull is None:
            hull = here[0], here[1], here[2], here[3]
            continue
        joined = min(hull[0], here[0]), max(hull[1], here[1]), min(hull[2], here[2]), max(hull[3], here[3])
        if min(joined[1] - joined[0], (joined[3] - joined[2]) * (last - begin)) <= seen:
            hull = joined
            continue
        lengths.append(first - begin)
        ends.append(first)
        begin, hull = first, (here[0], here[1], here[2], here[3])
    return [*lengths, end - begin], [*ends, end]


def _cells(
    steps: Sequence[Instruction], start: float, end: float
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray], float]:
    """Cells from `start` to `end` over which bounds show that a function is a straight line, the bounds of its value
    and rate over them, and the distance from the line that counts."""
    edges = np.linspace(start, end, CELLS + 1)
    table = _evaluated(steps, edges[:-1], edges[1:])
    work, shortest, seen = 2 * CELLS * len(steps), SHORTEST * (end - start), 0.0
    while True:
        low, high, a, b, da, db, middles = table
        with np.errstate(invalid="ignore", over="ignore"):
            off = np.fmin(b - a, (db - da) * (high - low))
        # by values that it takes: bounds of what is written as a difference may be far wider than its range
        if (taken := middles[np.isfinite(middles)]).size:
            seen = SEEN * max(float(np.ptp(taken)), FLOOR * float(np.max(np.abs(taken))))
        split = ~(off <= seen) & (high - low > shortest)
        if not split.any() or work > MOST_WORK or low.size > MOST_CELLS:
            order = np.argsort(low)
            low, high, a, b, da, db, _ = table[:, order]
            return low, high, (a, b), (da, db), seen
        middle = 0.5 * (low[split] + high[split])
        fresh = _evaluated(steps, np.append(low[split], middle), np.append(middle, high[split]))
        work += 2 * fresh.shape[1] * len(steps)
        table = np.concatenate([table[:, ~split], fresh], axis=1)


def _evaluated(steps: Sequence[Instruction], low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Rows: cells, bounds of the value, bounds of the rate, value in the middle."""
    (a, b), (da, db) = bounds(steps, low, high)
    middle = 0.5 * (low + high)
    return np.array([low, high, a, b, da, db, bounds(steps, middle, middle)[0][0]])
