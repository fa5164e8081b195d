"""A simulation whose comparisons are watched: their values, and between which instants one of them changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...compiler.analysis.events import FlatEvents
from ..advance import Integration
from ..prepare import watched_grid
from ..roots import Watched
from ..systems import SimulatedSystem
from .crossing import dips, unexplained
from .one_step import OneStep, Way

if TYPE_CHECKING:
    from .modes import ReadyInMode, SimulatedModes

# relative: times that differ by less are one instant, k * 0.004 s as a row, a sample and a knot of an input
SAME = 8 * np.finfo(float).eps
# of a comparison's largest value since it changed: nearer to zero its sign is round-off and the integrator's error
ZERO = 1e-9
# and of its largest value in the whole run
LEAST = 1e-13
# where comparisons are looked at within a step, parts of it that no period of theirs fits well, and how often what
# stays open there is halved, at so many places at once
SHARES, HALVED, MOST_MORE = (0.23, 0.52, 0.79), 8, 2000
# where the integrator does not say what it did between rows: so many times closer together, again and again up to so
# many parts of an interval, and places to look at in all
PARTS, MOST_PARTS, MOST_LOOKS = 4, 64, 1_000_000


class WatchedIntegration(Integration):
    """Where a simulation with comparisons is.

    truth: of each comparison, constant between two events.
    """

    def __init__(self, ready: ReadyInMode, modes: SimulatedModes, rows: np.ndarray, grid: np.ndarray) -> None:
        begin, end = float(rows[0]), float(rows[-1])
        self._modes, self._begin, self._end = modes, begin, end
        self._slack = SAME * max(abs(begin), abs(end))
        self._steppers: dict[SimulatedSystem, OneStep] = {}
        pace = modes.pace(ready.ready.systems, ready.values, ready.ready.inputs, begin, end)
        super().__init__(ready.ready, rows, grid, pace)
        self._coarse, self._parts = grid, 1
        self._declared: FlatEvents = modes.events
        self._watched: dict[SimulatedSystem, Watched] = {}
        self.truth = ready.truth.copy()
        self._size = self._largest = self._least = np.zeros(len(self._declared.comparisons))
        self._see_round_off()

    @property
    def _stepper(self) -> OneStep:
        system, s = self.system, self._settings
        if system not in self._steppers:
            watching = bool(self._declared.comparisons)
            self._steppers[system] = OneStep(system.reduced, system.stepper, s.tolerance, s.bounded, watching)
        return self._steppers[system]

    def _looked_at(
        self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, from now on, between which values and rates of the comparisons show what they do: rows, steps of the
        integrator between them, and shares of these. Where the integrator does not say what it did between rows, up to
        the first of them between which something is open; then rows are closer together from there on."""
        at = np.concatenate([[self._time], times])
        values, rates = self._comparisons(np.vstack([self._x, xs]), np.vstack([self._z, zs]), at)
        way = self._stepper.way
        if way is None:
            open_ = unexplained(np.diff(at), values, rates, self._zero)
            if open_.any() and self._closer():
                last = int(np.argmax(open_)) + 1
                return at[:last], values[:last], rates[:last]
            return at, values, rates
        begin, new = self._time, way.ends[:-1, None] + np.append(SHARES, 1.0) * np.diff(way.ends)[:, None]
        more = new[new < times[-1] - begin]
        for _ in range(HALVED):
            if not more.size:
                break
            fresh = self._comparisons(way(more), np.zeros((len(more), 0)), begin + more)
            order = np.argsort(np.append(at, begin + more), kind="stable")
            at = np.append(at, begin + more)[order]
            values, rates = (np.vstack(both)[order] for both in zip((values, rates), fresh, strict=True))
            h = np.diff(at)
            open_ = np.flatnonzero(unexplained(h, values, rates, self._zero) & (h > self._slack))
            more = (at[open_] + h[open_] / 2 - begin)[:MOST_MORE]
        return at, values, rates

    def _closer(self) -> bool:
        """Rows to look at closer together; False where they are as close as they get."""
        parts = PARTS * self._parts
        if parts > MOST_PARTS or parts * len(self._coarse) > MOST_LOOKS:
            return False
        self._parts = parts
        self._grid = watched_grid(self._coarse, float(np.max(np.diff(self._coarse))) / parts)
        return True

    def _grow(self, values: np.ndarray) -> None:
        if len(values):
            largest = np.max(np.abs(values), axis=0)
            self._size, self._largest = np.maximum(self._size, largest), np.maximum(self._largest, largest)

    def _see_round_off(self) -> None:
        """Round-off of the comparisons by that of the states, whose difference they may be, from here on."""
        if self._declared.comparisons:
            s, watched = self._stepper, self._watching
            self._least = watched.round_off(self._x, self._z, self._time, self._p, s.x_scale, s.z_scale)

    @property
    def _zero(self) -> np.ndarray:
        """So near to zero no comparison shows a side."""
        return np.maximum(ZERO * self._size, self._round_off)

    @property
    def _round_off(self) -> np.ndarray:
        """Of the comparisons: a value that stays at its threshold dips so far below it."""
        return np.maximum(LEAST * self._largest, self._least)

    def _signs(self) -> np.ndarray:
        return np.where(self.truth, 1.0, -1.0)

    def _comparisons(self, xs: np.ndarray, zs: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and rates, one row for each time."""
        return self._watching(xs, zs, times, self._p)

    @property
    def _watching(self) -> Watched:
        if self.system not in self._watched:
            self._watched[self.system] = self._modes.watched(self.system)
        return self._watched[self.system]

    def _first_change(self, at: np.ndarray, values: np.ndarray, rates: np.ndarray) -> tuple[int, float]:
        """The first interval in which a comparison changes, their number where none does; and where inside of it one
        changes and changes back, else 0."""
        s, ds = values * self._signs(), rates * self._signs()
        over = s[1:] < -self._zero
        # what was zero so far has its round-off from the size that it grows to
        share = dips(np.diff(at), s, ds, np.maximum(self._round_off, LEAST * np.maximum(s[:-1], s[1:])))
        candidates = over.any(axis=1) | np.isfinite(share).any(axis=1)
        for interval in np.flatnonzero(candidates).tolist():
            if over[interval].any():
                return interval, 0.0
            for u in share[interval][np.isfinite(share[interval])]:
                return interval, float(u)
        return len(at) - 1, 0.0

    def _near(self, way: Way, after: float, span: float) -> tuple[np.ndarray, np.ndarray]:
        """Signed values and rates so long after now by the integrator's interpolation of steps that began `after`
        earlier."""
        at = np.array([after + span])
        values, rates = self._comparisons(way(at), self._z[None, :], at - after + self._time)
        return values[0] * self._signs(), rates[0] * self._signs()

    def _compared(self) -> np.ndarray:
        """Values of the comparisons now."""
        if not self._declared.comparisons:
            return np.zeros(0)
        return self._comparisons(self._x[None, :], self._z[None, :], np.array([self._time]))[0][0]
