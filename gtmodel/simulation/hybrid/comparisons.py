"""Simulation with monitored comparisons: their values, the first instant at which one changes its truth value, and
integration with a one-step method after an event."""

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
# steps in one call with monitored comparisons: steps after an event are discarded
WATCHED_STEPS = 24
# steps per interval, averaged over a call, above which a stiff system is integrated with CVODES
MOST_AN_INTERVAL = 60
# step times the largest eigenvalue, estimated as in Hairer's DOP853, above which stability instead of accuracy limits
# the step
STIFF = 3.0


class OneStep:
    """A `Stepper` with the order 8 method of Dormand and Prince (DOP853); it uses CVODES if the system is stiff, and
    IDAS if there are Newton unknowns."""

    def __init__(
        self, reduced: Reduced, stepper: Stepper, tolerance: float, bounded: bool, remembers: bool = False
    ) -> None:
        """remembers: store `way`."""
        self._stepper, self._remembers = stepper, remembers
        self.way: Way | None = None  # steps of the last call; None after a call of CVODES or IDAS
        # if the last call did not complete an interval: time it reached [s], states and energies there
        self.far: tuple[float, np.ndarray, np.ndarray] | None = None
        self.x_scale, self.z_scale = stepper.x_scale, stepper.z_scale
        self._bounded = bounded
        # tighter, like a CVODES call over few intervals, because errors of many short pieces add up
        self._tolerance = min(tolerance, max(FINEST, RESTARTED * tolerance))
        self._stiff = reduced.z.numel() > 0
        rates = ca.vertcat(reduced.rates, reduced.powers)
        self._rates = (
            PointFunction(ca.Function("rates", [reduced.x, reduced.t, reduced.p], [ca.densify(rates)]))
            if (not self._stiff)
            else None
        )
        self._last = np.inf  # proposed next step [s]

    @property
    def likely(self) -> float:
        """The proposed next step [s], infinite before the first one."""
        return self._last

    @property
    def most(self) -> int:
        """Largest number of intervals in one call."""
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
        """Like the call of a `Stepper`, but it may return fewer intervals."""
        self.way = self.far = None
        if not self._stiff:
            result = self._steps(x, time, length, p, count, min(longest, length if self._bounded else np.inf))
            if result is not None or not self._stiff:
                return result
        return self._stepper(x, z, time, length, p, count, longest, 1)

    def _steps(
        self, x: np.ndarray, time: float, length: float, p: np.ndarray, count: int, longest: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Integrate, over fewer intervals if they need many steps; None after a failure, with `_stiff` set if stiff."""
        rates, scale, n = self._rates, np.append(self.x_scale, [1.0, 1.0]), x.size
        assert rates is not None

        def f(t: float, y: np.ndarray) -> np.ndarray:
            return rates(y[:n] * self.x_scale, time + t, p)[0].reshape(-1) / scale

        end = count * length
        times = length * np.arange(1, count + 1)
        rows = np.empty((count, n + 2))
        begin = np.concatenate([x / self.x_scale, [0.0, 0.0]])
        options: dict[str, Any] = {"rtol": self._tolerance, "atol": self._tolerance, "max_step": longest}
        proposed = self._last
        if np.isfinite(proposed):
            options["first_step"] = min(self._last, end)
        with np.errstate(all="ignore"):
            solver = scipy.integrate.DOP853(f, 0.0, begin, end, **options)
            done, steps, stiff = 0, 0, 0
            ends, between = [0.0], []
            while solver.status == "running":
                solver.step()
                steps += 1
                if solver.status == "failed" or not np.all(np.isfinite(solver.y)):
                    self._set_far(solver, n, ends, between)
                    return None
                last = int(np.searchsorted(times, solver.t, side="right")) if solver.status == "running" else count
                # a finished call ends with the solver's own state
                if self._remembers or last > done + (solver.status == "finished"):
                    dense = solver.dense_output()
                    rows[done:last] = dense(times[done:last]).T
                    ends.append(float(solver.t))
                    between.append(dense)
                done = last
                if steps > MOST_AN_INTERVAL:
                    stiff += _stiffness(solver) > STIFF
                if steps > MOST_AN_INTERVAL * max(done, 1) + MOST_AN_INTERVAL and 2 * stiff > steps - MOST_AN_INTERVAL:
                    self._stiff = True
                    return None
                if steps > MOST_STEPS or (self._remembers and done and steps >= WATCHED_STEPS):
                    break
            if not done:
                self._set_far(solver, n, ends, between)
                return None
            if solver.status == "finished":
                rows[-1] = solver.y
            rows = rows[:done]
        # a step shortened by the end of the call is no estimate of the next one
        self._last = max(float(solver.h_abs), proposed if steps == 1 and np.isfinite(proposed) else 0.0)
        if not np.all(np.isfinite(rows)):
            return None
        self.way = self._way(ends, between)
        return rows[:, :n] * self.x_scale, np.zeros((done, 0)), rows[:, n:]

    def _set_far(self, solver: scipy.integrate.DOP853, n: int, ends: list[float], between: list[Any]) -> None:
        if np.all(np.isfinite(solver.y)):
            self.far = float(solver.t), solver.y[:n] * self.x_scale, solver.y[n:].copy()
            self.way = self._way(ends, between)

    def _way(self, ends: list[float], between: list[Any]) -> Way | None:
        if not self._remembers or not between:
            return None
        return Way(np.array(ends), scipy.integrate.OdeSolution(ends, between), self.x_scale)


def _stiffness(solver: scipy.integrate.DOP853) -> float:
    """Estimate the last step times the largest eigenvalue from the two evaluations at its end."""
    h, slopes = solver.h_previous, solver.K
    change = slopes[-1] - slopes[-2]
    apart = h * (slopes[:-1].T @ solver.B - slopes[: solver.n_stages - 1].T @ solver.A[-1, : solver.n_stages - 1])
    return abs(h) * float(np.linalg.norm(change)) / max(float(np.linalg.norm(apart)), 1e-300)


@dataclass(frozen=True, eq=False)
class Way:
    """The steps of one call: their ends [s], beginning with 0, and the states at any time between them."""

    ends: np.ndarray
    solution: Any
    scale: np.ndarray

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """Return states (n, states) at times (n,) [s] from the start of the call."""
        return self.solution(times)[: len(self.scale)].T * self.scale


# corrections below this share of the interval, or of the time, are converged
CLOSE = 1e-13
MOST = 60
# Newton corrections of a root of approximate values
CORRECTIONS = 4
# halvings of an interval to find the side on which it begins
HALVINGS = 40
# largest deviation of a comparison from the straight line given by its rate, relative to the rate
STRAIGHT = 0.01
# largest deviation of a comparison's change between two points from that given by its rates, relative to its value
EXPLAINED = 0.3

# values and rates of the comparisons at a time after the beginning of the interval, with signs such that the previous
# side is positive; None if the integrator fails
Signed = Callable[[float], tuple[np.ndarray, np.ndarray] | None]


def dips(h: np.ndarray, s: np.ndarray, ds: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Return for intervals of length h (n,) the share at which the cubic through signed values s (n + 1, m) with rates
    ds has its minimum, if this is more than the round-off `least` (m,) or (n, m) below 0; else NaN."""
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
    """Return for each interval of length h (n,) whether a comparison is unresolved inside: the rates ds at its ends do
    not explain the change of its values s (n + 1, m), relative to their distance from zero."""
    change = s[1:] - s[:-1]
    larger = np.maximum(np.maximum(np.abs(s[:-1]), np.abs(s[1:])), zero)
    with np.errstate(all="ignore"):
        return np.any(np.abs(change - h[:, None] * (ds[:-1] + ds[1:]) / 2) > EXPLAINED * larger, axis=1)


def first_root(signed: Signed, n: int, low: float, high: float) -> float | None:
    """Return the first time after `low` at which comparison n, negative at `high`, becomes negative; None if the
    integrator fails.

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
            result = signed(probe)
            if result is None:
                return None
            if result[0][n] > 0:
                low, a, da = probe, float(result[0][n]), float(result[1][n])
                break
            high, b, db = probe, float(result[0][n]), float(result[1][n])
            steady = STRAIGHT * -da
            if da < 0 and abs(db - da) <= steady and abs(b - a - da * (high - low)) <= steady * (high - low):
                return low  # the comparison falls in a straight line from there
        else:
            return low
    span = high - low
    for k in range(MOST):
        if high - low <= CLOSE * max(abs(high), span) or b == 0:
            break
        guess = _cubic_root(low, a, da, high, b, db) if k % 4 < 3 else (low + high) / 2
        result = signed(guess)
        if result is None:
            return None
        value, rate = float(result[0][n]), float(result[1][n])
        if value > 0:
            low, a, da = guess, value, rate
        else:
            high, b, db = guess, value, rate
        if rate < 0 and abs(value / rate) <= CLOSE * max(abs(high), span):
            return guess
    return high


def corrected_root(signed: Signed, near: Signed | None, n: int, low: float, high: float) -> float | None:
    """Like `first_root`, starting from the root of the approximate values `near`."""
    guess = None if near is None else first_root(near, n, low, high)
    for _ in range(CORRECTIONS if guess is not None else 0):
        assert guess is not None
        result = signed(guess)
        if result is None or not result[1][n] < 0:
            break
        correction = -float(result[0][n] / result[1][n])
        if abs(correction) <= CLOSE * max(abs(high), high - low):
            return guess
        guess += correction
        if not low <= guess <= high:
            break
        # Newton's method converges quadratically: the next correction is negligible
        if abs(correction) <= CLOSE**0.5 * (high - low):
            return guess
    return first_root(signed, n, low, high)


def _cubic_root(low: float, a: float, da: float, high: float, b: float, db: float) -> float:
    """Return the first root, inside the interval, of the cubic through both ends with their rates."""
    h = high - low
    c = [2 * (a - b) + h * (da + db), 3 * (b - a) - h * (2 * da + db), h * da, a]
    roots = np.roots(c) if np.all(np.isfinite(c)) else np.zeros(0)
    inside = np.sort(roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < 1)])
    share = float(inside[0]) if inside.size else a / (a - b)
    return low + min(max(share, 1e-9), 1 - 1e-9) * h if inside.size else low + 0.5 * h


# relative: times that differ by less are one instant, such as k * 0.004 s as a row, a sample and a knot of an input
SAME = 8 * np.finfo(float).eps
# relative to a comparison's largest value since its last change: closer to zero, its sign is numerical error
ZERO = 1e-9
# the same, relative to its largest value in the whole run
LEAST = 1e-13
# shares of a step at which comparisons are evaluated, not commensurate with a period; how often unresolved intervals
# are halved, and how many of them at once
SHARES, HALVED, MOST_MORE = (0.23, 0.52, 0.79), 8, 2000
# without dense output, rows are refined by this factor, up to this many parts of an interval and this many rows
PARTS, MOST_PARTS, MOST_LOOKS = 4, 64, 1_000_000


class WatchedIntegration(Integration):
    """A running simulation with comparisons.

    truth: the truth value of each comparison, constant between two events.
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
        self._update_round_off()

    @property
    def _stepper(self) -> OneStep:
        system, s = self.system, self._settings
        if system not in self._steppers:
            watching = bool(self._declared.comparisons)
            self._steppers[system] = OneStep(system.reduced, system.stepper, s.tolerance, s.bounded, watching)
        return self._steppers[system]

    def _resolving(
        self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return times at which values and rates of the comparisons resolve their changes, with values and rates:
        rows, integrator steps between them, and shares of the steps. Without dense output, return only the rows before
        the first unresolved interval, and refine the rows from there on."""
        instants = np.concatenate([[self._time], times])
        values, rates = self._comparisons(np.vstack([self._x, xs]), np.vstack([self._z, zs]), instants)
        way = self._stepper.way
        if way is None:
            unresolved = unexplained(np.diff(instants), values, rates, self._zero)
            if unresolved.any() and self._closer():
                last = int(np.argmax(unresolved)) + 1
                return instants[:last], values[:last], rates[:last]
            return instants, values, rates
        begin, new = self._time, way.ends[:-1, None] + np.append(SHARES, 1.0) * np.diff(way.ends)[:, None]
        more = new[new < times[-1] - begin]
        for _ in range(HALVED):
            if not more.size:
                break
            fresh = self._comparisons(way(more), np.zeros((len(more), 0)), begin + more)
            order = np.argsort(np.append(instants, begin + more), kind="stable")
            instants = np.append(instants, begin + more)[order]
            values, rates = (np.vstack(both)[order] for both in zip((values, rates), fresh, strict=True))
            h = np.diff(instants)
            unresolved = np.flatnonzero(unexplained(h, values, rates, self._zero) & (h > self._slack))
            more = (instants[unresolved] + h[unresolved] / 2 - begin)[:MOST_MORE]
        return instants, values, rates

    def _closer(self) -> bool:
        """Refine the rows at which comparisons are evaluated; False at the limit."""
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

    def _update_round_off(self) -> None:
        """Update the round-off of the comparisons that is due to the round-off of the states at this point."""
        if self._declared.comparisons:
            s, watched = self._stepper, self._watching
            self._least = watched.round_off(self._x, self._z, self._time, self._p, s.x_scale, s.z_scale)

    @property
    def _zero(self) -> np.ndarray:
        """Values of the comparisons below which their side is undetermined."""
        return np.maximum(ZERO * self._size, self._round_off)

    @property
    def _round_off(self) -> np.ndarray:
        """Round-off of the comparisons: how far a value at its threshold may go below it."""
        return np.maximum(LEAST * self._largest, self._least)

    def _signs(self) -> np.ndarray:
        return np.where(self.truth, 1.0, -1.0)

    def _comparisons(self, xs: np.ndarray, zs: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return values and rates, one row for each time."""
        return self._watching(xs, zs, times, self._p)

    @property
    def _watching(self) -> Watched:
        if self.system not in self._watched:
            self._watched[self.system] = self._modes.watched(self.system)
        return self._watched[self.system]

    def _first_change(self, instants: np.ndarray, values: np.ndarray, rates: np.ndarray) -> tuple[int, float]:
        """Return the first interval in which a comparison changes, or the number of intervals; and the share of it at
        which a comparison changes and changes back, else 0."""
        s, ds = values * self._signs(), rates * self._signs()
        over = s[1:] < -self._zero
        # for a comparison that was zero, round-off follows from the value that it reaches
        share = dips(np.diff(instants), s, ds, np.maximum(self._round_off, LEAST * np.maximum(s[:-1], s[1:])))
        candidates = over.any(axis=1) | np.isfinite(share).any(axis=1)
        for interval in np.flatnonzero(candidates).tolist():
            if over[interval].any():
                return interval, 0.0
            for u in share[interval][np.isfinite(share[interval])]:
                return interval, float(u)
        return len(instants) - 1, 0.0

    def _near(self, way: Way, after: float, span: float) -> tuple[np.ndarray, np.ndarray]:
        """Return signed values and rates `span` after the present time, from the dense output of steps that began
        `after` earlier."""
        times = np.array([after + span])
        values, rates = self._comparisons(way(times), self._z[None, :], times - after + self._time)
        return values[0] * self._signs(), rates[0] * self._signs()

    def _compared(self) -> np.ndarray:
        """Return the present values of the comparisons."""
        if not self._declared.comparisons:
            return np.zeros(0)
        return self._comparisons(self._x[None, :], self._z[None, :], np.array([self._time]))[0][0]
