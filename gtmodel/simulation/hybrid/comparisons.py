"""A simulation whose comparisons are watched: their values, the first instant at which one changes its truth, and
integration by a one-step method after an event."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
import scipy

from ...compiler.analysis.events import FlatEvents
from ...compiler.rows import PointFunction
from ..advance import Integration
from ..prepare import watched_grid
from ..reduced import FINEST, MOST_ROWS, RESTARTED, Reduced, Stepper, Watched
from ..systems import SimulatedSystem

if TYPE_CHECKING:
    from .modes import ReadyInMode, SimulatedModes

# steps in one call
MOST_STEPS = 2000
# and where somebody looks for events in them: what comes after one is thrown away
WATCHED_STEPS = 24
# so many steps in one interval, on average over a call, are too many for a stiff system, and CVODES goes on with it
MOST_AN_INTERVAL = 60
# step times the largest eigenvalue, as Hairer's DOP853 estimates it: above it stability and not accuracy decides on the
# step, most of the time
STIFF = 3.0


class OneStep:
    """As a `Stepper`, by Dormand and Prince's method of order 8 (DOP853); by CVODES where the system is stiff, and by
    IDAS where Newton unknowns ride along."""

    def __init__(
        self, reduced: Reduced, stepper: Stepper, tolerance: float, bounded: bool, remembers: bool = False
    ) -> None:
        """remembers: `way` is kept."""
        self._stepper, self._remembers = stepper, remembers
        self.way: Way | None = None  # of the last call; None where it was one of CVODES or IDAS
        # of the last call where it came to the end of no interval: how far it came [s], states and energies there
        self.far: tuple[float, np.ndarray, np.ndarray] | None = None
        self.x_scale, self.z_scale = stepper.x_scale, stepper.z_scale
        self._bounded = bounded
        # as a call of CVODES over few intervals, for the same reason: errors of many short pieces add up
        self._tolerance = min(tolerance, max(FINEST, RESTARTED * tolerance))
        self._stiff = reduced.z.numel() > 0
        rates = ca.vertcat(reduced.rates, reduced.powers)
        self._rates = (
            PointFunction(ca.Function("rates", [reduced.x, reduced.t, reduced.p], [ca.densify(rates)]))
            if (not self._stiff)
            else None
        )
        self._last = np.inf  # the step that it would take next [s]

    @property
    def likely(self) -> float:
        """The step that it would take next [s], infinite before the first one."""
        return self._last

    @property
    def most(self) -> int:
        """Intervals in one call."""
        return self._stepper.most if self._stiff else MOST_ROWS

    def __call__(
        self,
        x: np.ndarray,
        z: np.ndarray,
        time: float,
        length: float,
        p: np.ndarray,
        count: int = 1,
        longest: float = np.inf,
        likely: int = 1,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """As a `Stepper`'s, or fewer of the intervals."""
        self.way = self.far = None
        if not self._stiff:
            made = self._steps(x, time, length, p, count, min(longest, length if self._bounded else np.inf))
            if made is not None or not self._stiff:
                return made
        return self._stepper(x, z, time, length, p, count, longest, 1)

    def _steps(
        self, x: np.ndarray, time: float, length: float, p: np.ndarray, count: int, longest: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Fewer intervals where they take many steps. None where it fails; then `_stiff` says whether that is why."""
        rates, scale, n = self._rates, np.append(self.x_scale, [1.0, 1.0]), x.size
        assert rates is not None

        def f(t: float, y: np.ndarray) -> np.ndarray:
            return rates(y[:n] * self.x_scale, time + t, p)[0].reshape(-1) / scale

        end = count * length
        at = length * np.arange(1, count + 1)
        rows = np.empty((count, n + 2))
        begin = np.concatenate([x / self.x_scale, [0.0, 0.0]])
        options: dict[str, Any] = {"rtol": self._tolerance, "atol": self._tolerance, "max_step": longest}
        wanted = self._last
        if np.isfinite(wanted):
            options["first_step"] = min(self._last, end)
        with np.errstate(all="ignore"):
            solver = scipy.integrate.DOP853(f, 0.0, begin, end, **options)
            done, steps, stiff = 0, 0, 0
            ends, between = [0.0], []
            while solver.status == "running":
                solver.step()
                steps += 1
                if solver.status == "failed" or not np.all(np.isfinite(solver.y)):
                    self._came_to(solver, n, ends, between)
                    return None
                last = int(np.searchsorted(at, solver.t, side="right")) if solver.status == "running" else count
                if last > done or self._remembers:
                    dense = solver.dense_output()
                    rows[done:last] = dense(at[done:last]).T
                    done = last
                    ends.append(float(solver.t))
                    between.append(dense)
                if steps > MOST_AN_INTERVAL:
                    stiff += _stiffness(solver) > STIFF
                if steps > MOST_AN_INTERVAL * max(done, 1) + MOST_AN_INTERVAL and 2 * stiff > steps - MOST_AN_INTERVAL:
                    self._stiff = True
                    return None
                if steps > MOST_STEPS or (self._remembers and done and steps >= WATCHED_STEPS):
                    break
            if not done:
                self._came_to(solver, n, ends, between)
                return None
            if solver.status == "finished":
                rows[-1] = solver.y
            rows = rows[:done]
        # a step that the end cut short says nothing about the next one
        self._last = max(float(solver.h_abs), wanted if steps == 1 and np.isfinite(wanted) else 0.0)
        if not np.all(np.isfinite(rows)):
            return None
        self.way = self._way(ends, between)
        return rows[:, :n] * self.x_scale, np.zeros((done, 0)), rows[:, n:]

    def _came_to(self, solver: scipy.integrate.DOP853, n: int, ends: list[float], between: list[Any]) -> None:
        if np.all(np.isfinite(solver.y)):
            self.far = float(solver.t), solver.y[:n] * self.x_scale, solver.y[n:].copy()
            self.way = self._way(ends, between)

    def _way(self, ends: list[float], between: list[Any]) -> Way | None:
        if not self._remembers or not between:
            return None
        return Way(np.array(ends), scipy.integrate.OdeSolution(ends, between), self.x_scale)


def _stiffness(solver: scipy.integrate.DOP853) -> float:
    """The last step times the largest eigenvalue, by the two evaluations at its end."""
    h, slopes = solver.h_previous, solver.K
    change = slopes[-1] - slopes[-2]
    apart = h * (slopes[:-1].T @ solver.B - slopes[: solver.n_stages - 1].T @ solver.A[-1, : solver.n_stages - 1])
    return abs(h) * float(np.linalg.norm(change)) / max(float(np.linalg.norm(apart)), 1e-300)


@dataclass(frozen=True, eq=False)
class Way:
    """The steps of one call: their ends [s], the first one 0, and the states anywhere between them."""

    ends: np.ndarray
    solution: Any
    scale: np.ndarray

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """States (n, states) at times (n,) after the call's begin [s]."""
        return self.solution(times)[: len(self.scale)].T * self.scale


# a correction of so many parts of the interval, or of the time, no longer moves the instant
CLOSE = 1e-13
MOST = 60
# from a root of values that are nearly right
CORRECTIONS = 4
# halvings of an interval until it is seen on which side it begins
HALVINGS = 40
# part of a rate that a comparison may be off the straight line of it, which it follows from one end to the other
STRAIGHT = 0.01
# of a comparison's distance from zero: what its rates at two ends leave of its change between them
EXPLAINED = 0.3

# values and rates of the comparisons, signed so that they are positive on the side where they were, at a time after the
# interval's beginning; None where the integrator gives up
Signed = Callable[[float], tuple[np.ndarray, np.ndarray] | None]


def dips(h: np.ndarray, s: np.ndarray, ds: np.ndarray, least: np.ndarray) -> np.ndarray:
    """For intervals of length h (n,), the share at which the cubic through signed values s (n + 1, m) with rates ds has
    its minimum where that lies more than the round-off `least` (m,) or (n, m) below 0; NaN elsewhere."""
    a, b, da, db = s[:-1], s[1:], ds[:-1] * h[:, None], ds[1:] * h[:, None]
    # derivative of the cubic: c0 + c1 u + c2 u^2
    c0, c1, c2 = da, 6 * (b - a) - 4 * da - 2 * db, 6 * (a - b) + 3 * (da + db)
    with np.errstate(all="ignore"):
        root = np.sqrt(c1**2 - 4 * c0 * c2)
        u = np.where(np.abs(c2) > 1e-12 * np.abs(c1), (-c1 + root) / (2 * c2), -c0 / c1)
        lowest = (1 + 2 * u) * (1 - u) ** 2 * a + u * (1 - u) ** 2 * da + u**2 * (3 - 2 * u) * b + u**2 * (u - 1) * db
        inside = (u > 0) & (u < 1) & (lowest < -least) & (a >= 0) & (b >= 0)
    return np.where(inside, u, np.nan)


def unexplained(h: np.ndarray, s: np.ndarray, ds: np.ndarray, zero: np.ndarray) -> np.ndarray:
    """Whether values s (n + 1, m) with rates ds at the ends of intervals of length h (n,) leave open what a comparison
    does inside: its rates do not give its change, to a part of its distance from zero. For each interval."""
    change = s[1:] - s[:-1]
    larger = np.maximum(np.maximum(np.abs(s[:-1]), np.abs(s[1:])), zero)
    with np.errstate(all="ignore"):
        return np.any(np.abs(change - h[:, None] * (ds[:-1] + ds[1:]) / 2) > EXPLAINED * larger, axis=1)


def first_root(signed: Signed, n: int, low: float, high: float) -> float | None:
    """Where comparison n, negative at `high`, becomes negative first after `low`; None where numbers do not come out.

    At `low` it is positive, or zero and about to become positive.
    """
    if high <= low:
        return low
    ends = {end: signed(end) for end in (low, high)}
    if any(end is None for end in ends.values()):
        return None
    (a, da), (b, db) = ((float(e[0][n]), float(e[1][n])) for e in ends.values() if e is not None)
    if not a > 0:
        probe = high
        for _ in range(HALVINGS):
            probe = low + (probe - low) / 2
            at = signed(probe)
            if at is None:
                return None
            if at[0][n] > 0:
                low, a, da = probe, float(at[0][n]), float(at[1][n])
                break
            high, b, db = probe, float(at[0][n]), float(at[1][n])
            steady = STRAIGHT * -da
            if da < 0 and abs(db - da) <= steady and abs(b - a - da * (high - low)) <= steady * (high - low):
                return low  # it falls from there on, in a straight line
        else:
            return low
    span = high - low
    for k in range(MOST):
        if high - low <= CLOSE * max(abs(high), span) or b == 0:
            break
        guess = _cubic_root(low, a, da, high, b, db) if k % 4 < 3 else (low + high) / 2
        at = signed(guess)
        if at is None:
            return None
        value, rate = float(at[0][n]), float(at[1][n])
        if value > 0:
            low, a, da = guess, value, rate
        else:
            high, b, db = guess, value, rate
        if rate < 0 and abs(value / rate) <= CLOSE * max(abs(high), span):
            return guess
    return high


def corrected_root(signed: Signed, near: Signed | None, n: int, low: float, high: float) -> float | None:
    """As `first_root`, begun where values `near` the true ones have theirs."""
    guess = None if near is None else first_root(near, n, low, high)
    for _ in range(CORRECTIONS if guess is not None else 0):
        assert guess is not None
        at = signed(guess)
        if at is None or not at[1][n] < 0:
            break
        correction = -float(at[0][n] / at[1][n])
        if abs(correction) <= CLOSE * max(abs(high), high - low):
            return guess
        guess += correction
        if not low <= guess <= high:
            break
        # Newton's next correction is of its square
        if abs(correction) <= CLOSE**0.5 * (high - low):
            return guess
    return first_root(signed, n, low, high)


def _cubic_root(low: float, a: float, da: float, high: float, b: float, db: float) -> float:
    """The root of the cubic through both ends with their rates that is the first one inside."""
    h = high - low
    c = [2 * (a - b) + h * (da + db), 3 * (b - a) - h * (2 * da + db), h * da, a]
    roots = np.roots(c) if np.all(np.isfinite(c)) else np.zeros(0)
    inside = np.sort(roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 1)])
    share = float(inside[0]) if inside.size else a / (a - b)
    return low + min(max(share, 1e-9), 1 - 1e-9) * h if inside.size else low + 0.5 * h


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
