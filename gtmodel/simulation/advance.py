"""Advance of a simulation: pieces between discontinuities, intervals for which the states are valid, recorded rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ..compiler.analysis.bounds import Pace
from ..compiler.flat import FlatModel
from ..compiler.rewriting import is_nonsmooth, kinked_in
from ..lang.source import ModelError
from ..results.check import Check
from ..results.status import SolveStatus
from .choice import SWITCH_BELOW
from .inputs import SimulationInputs
from .judgement import Ended, History, wall
from .options import Progress, Switch
from .reduced import TOUCH, Audit
from .systems import SimulatedSystem

if TYPE_CHECKING:
    from .hybrid.comparisons import OneStep
    from .prepare import Ready
    from .reduced import Stepper

# steps between the old and the new value of a discontinuous input, at which roots are checked
STEPS = 64
# share of a derivative's largest value in its table that counts as rest: splines of measured rows end nearly at rest
AT_REST = 1e-3


def refuse_discontinuities(flat: FlatModel) -> None:
    """Raises ModelError, with file and line, for an equation that contains sign() of a variable."""
    if not is_nonsmooth(flat):
        return
    fixed = {q.symbol.element_hash() for q in flat.parameters}
    residuals = [e.residual for e in flat.equations]
    moving = [s for s in ca.symvar(ca.vertcat(*residuals)) if s.element_hash() not in fixed]
    for e, inside in zip(flat.equations, kinked_in(residuals, moving, frozenset([ca.OP_SIGN])), strict=True):
        if inside:
            raise ModelError(
                f"'{e.label}' contains sign(), whose discontinuity makes integrators fail or return wrong results; use "
                "a smoothed friction (TanhFriction, PiecewiseLinearFriction)",
                e.where,
            )


def refuse_discontinuous_inputs(
    inputs: SimulationInputs, needed: Sequence[tuple[int, int]], start: float, end: float
) -> None:
    """Raises ModelError if a table begins or ends inside the run with a nonzero rate whose derivative the model needs.

    needed: (index, order) of the derivatives that the model reads.
    """
    for index, order in needed:
        table = inputs.tables.get(index)
        if table is None:
            continue
        for time, before in ((float(table.times[0]), False), (float(table.times[-1]), True)):
            held = start < time if not before else time < end
            if not held or not start <= time <= end or len(table.times) < 2:
                continue
            moving = table.piece(time, before)
            for k in range(1, min(order, table.coefficients)):
                if abs(moving[k]) > AT_REST * table.largest(k):
                    name, rate = inputs.flat.symbol_name(index, order), inputs.flat.symbol_name(index, k)
                    what = "begins" if not before else "ends"
                    raise ModelError(
                        f"the table of input '{table.name}' {what} at {time:g} s with {rate} = {moving[k]:.3g} and is "
                        f"constant beyond, so {name}, which the model needs, has an impulse there; extend the table "
                        f"over the run, or let it {what[:-1]} at rest"
                    )


def after_discontinuity(
    system: SimulatedSystem, x: np.ndarray, z: np.ndarray, time: float, before: np.ndarray, after: np.ndarray
) -> np.ndarray:
    """Follow the Newton unknowns from the old to the new input values at a discontinuity.

    Raises Ended if a solution turns back, or meets another root, between them.
    """
    if np.array_equal(before[1:], after[1:]):
        return z
    if system.roots and not _roots_go_on(system, x, z, time, before, after):
        labels = "; ".join(system.roots.labels[:4])
        raise _lost(time, labels)
    continuation = system.continuation
    if continuation is None:
        return z
    followed = continuation.follow(z, continuation.place(x, time, before), continuation.place(x, time, after))
    if followed is None:
        raise _lost(time, system.reduced.unknowns)
    return followed


def _roots_go_on(
    system: SimulatedSystem, x: np.ndarray, z: np.ndarray, time: float, before: np.ndarray, after: np.ndarray
) -> bool:
    """Return whether the discriminants stay positive between old and new values; with Newton unknowns, do not check."""
    if z.size or not system.roots.moved_by_inputs:
        return True
    shares = np.linspace(0.0, 1.0, STEPS + 1)
    p = before[:, None] + shares * (after - before)[:, None]
    values = system.roots.values(x, z, time, p)
    a, b, c = values[:-2], values[1:-1], values[2:]
    # a zero between two steps: the minimum of the parabola is negative
    curve = a - 2 * b + c
    with np.errstate(divide="ignore", invalid="ignore"):
        lowest = np.where((b <= a) & (b <= c) & (curve > 0), b - (a - c) ** 2 / (8 * curve), b)
    return bool(np.all(values > 0) and np.all((lowest > TOUCH) | (lowest == b)))


def _lost(time: float, names: str) -> Ended:
    return Ended(
        SolveStatus.FAILED,
        f"the motion ends at {time:.6g} s, where an input is discontinuous: {names} cannot be followed from the old "
        "to the new input value, because the solution turns back or meets another one between them; use a smaller step "
        "or a ramp",
    )


# shortest interval relative to the run: if a shorter one is needed, the motion ends
SHORTEST = 1e-8
# largest ratio of the lengths of successive intervals
GROWTH = 3.0
# if the integrator fails, it tries again with this many times fewer rows
FEWER = 10
# rows between two reports of progress
REPORTED = 50
# the run is stuck if this many calls advance by less than STUCK of the run, or less than this many rows
STUCK_CALLS, STUCK, STUCK_ROWS = 100, 1e-4, 20
# distance from the integrator's Newton unknowns, in tolerances and in nominals, beyond which it is another solution
OTHER_TOLERANCES, OTHER = 100.0, 1e-4


class Integration:
    """A running simulation: its point and its choice of states. `rows` are the times to record, with start and end;
    `grid` contains them and further ends of intervals; `pace` bounds the internal steps of the integrator."""

    def __init__(self, ready: Ready, rows: np.ndarray, grid: np.ndarray, pace: Pace) -> None:
        self.ready, self.recorder, self.end = ready, ready.recorder, float(rows[-1])
        self._systems, self._inputs = ready.systems, ready.inputs
        self._settings = ready.settings
        self._rows, self._grid, self._pace = rows, grid, pace
        system = ready.system
        self.audit = Audit(ready.systems.original_equations, ready.systems.parameters)
        self.system = system
        self.switches: list[Switch] = []
        self.history = History()
        self._x, self._z = system.reduced.from_point(ready.initial.w)
        self._work = np.zeros(2)
        self._known: tuple[Any, ...] = ()  # what the present point depends on, and the point
        # largest state so far, in nominals, for the comparison with the absolute tolerance
        self.largest = float(np.max(np.abs(self._x) / system.stepper.x_scale, initial=0.0))
        self._time = float(rows[0])
        self._progress: Progress | None = None
        self._shortest = SHORTEST * float(rows[-1] - rows[0])
        self._stuck = float(rows[-1] - rows[0]) * min(STUCK, STUCK_ROWS / len(grid))
        self._calls, self._since = 0, self._time
        self._switch_below = SWITCH_BELOW
        # span of the last call, which limits the next one; and the number of rows that a call will probably use
        self._last_span, self._likely = np.inf, len(grid)
        self._p = ready.inputs.piece(self._time)
        continuation = system.continuation
        if continuation is not None:
            better = continuation.correct(self._z, continuation.place(self._x, self._time, self._p))
            self._z = self._z if better is None else better

    def run(self, progress: Progress | None) -> None:
        """Advance to the last row. Raises Ended if it is not reached."""
        self._progress = progress
        end = float(self._rows[-1])
        start = np.array([self._time])
        self._record(start, self._x[None, :], self._z[None, :], self._work[None, :], self._here()[None, :])
        knots = np.union1d(self._inputs.knots(self._time, end), self._pace.knots).tolist()
        for stop in [*knots, end]:
            while self._time < stop:
                self._advance(stop, self._span(stop))
            if stop < end:
                self._begin_piece(stop)

    # -- results -----------------------------------------------------------------------------------

    def finish(self) -> tuple[float, str | None]:
        """Return the largest residual of an equation at any row, and a sentence if an equation is violated."""
        return self.audit.residual, self.audit.verdict()

    def happened(self, status: SolveStatus) -> list[str]:
        """Return notes for the message of a run with this status."""
        n, first = len(self.switches), {i for i, _ in self.ready.system.plan.states}
        others = [f"'{name}'" for name in self._systems.selection.preferred_beside(first)]
        note = f"preferred as a state, but not a state at the start: {', '.join(others)}"
        return [*([f"states switched {n} time{'s' * (n > 1)}"] if n else []), *([note] if others else [])]

    def own_checks(self, moved: float) -> tuple[dict[str, Check], list[str]]:
        """Return further checks, and sentences about failed ones; `moved`: the exchanged energy [J]."""
        return {}, []

    def of_events(self) -> dict[str, Any]:
        """Return the fields of a `Simulation` about events."""
        return {}

    def _begin_piece(self, knot: float) -> None:
        before, after = (self._inputs.piece(knot, before) for before in (True, False))
        self._z = after_discontinuity(self.system, self._x, self._z, self._time, before, after)
        self._p = after
        self._calls = 0

    # -- states ------------------------------------------------------------------------------------

    def _span(self, stop: float) -> float:
        """Return the time [s] of the next advance; switch to better states first."""
        selection, longest = self._systems.selection, min(stop - self._time, GROWTH * self._last_span)
        if not selection.has_choice:
            return longest
        w = self._here()
        matrix = selection.matrix(w, self._time)
        quality = selection.quality(self.system.choice, matrix, self._switch_below)
        if quality < self._switch_below:
            other = self._systems.at(w, self._time, self._settings)
            better = 0.0 if other is None else selection.quality(other.choice, matrix)
            if other is not None and better > quality:
                self._switch(other, w)
                quality = better
            else:  # the best choice available; check again only if it gets much worse
                self._switch_below = 0.5 * quality
        else:
            self._switch_below = SWITCH_BELOW
        if not quality > 0.0:
            raise Ended(
                SolveStatus.FAILED,
                f"the motion ends at {self._time:.6g} s in a singular pose: no choice of states is valid there",
            )
        # if rows are too far apart for these states, advance a fraction of the way to the next row
        after = int(np.searchsorted(self._grid, self._time, side="right"))
        span = min(longest, float(self._grid[after]) - self._time)
        if selection.foresees(self.system.choice, w, self._time, span):
            return longest
        while span >= self._shortest and not selection.foresees(self.system.choice, w, self._time, span):
            span /= 2
        if span < min(longest, self._shortest):
            raise self._wall()
        return span

    def _switch(self, system: SimulatedSystem, w: np.ndarray) -> None:
        self.switches.append(Switch(self._time, self.system.states, system.states))
        self.system = system
        self._x, self._z = system.reduced.from_point(w)
        self._switch_below = SWITCH_BELOW

    def _here(self) -> np.ndarray:
        """Return the present point over the plan's pairs."""
        at = self._x, self._z, self._p, self.system, self._time
        if any(a is not b for a, b in zip(at, self._known, strict=False)) or not self._known:
            self._known = *at, self._points(self._x[None, :], self._z[None, :], np.array([self._time]))[0]
        return self._known[-1]

    @property
    def _stepper(self) -> Stepper | OneStep:
        """The integrator of the present system."""
        return self.system.stepper

    # -- integration -------------------------------------------------------------------------------

    def _advance(self, stop: float, span: float) -> None:
        """Advance by one call of the integrator over at most `span` seconds, by as many rows as are valid."""
        most, first_try = self._stepper.most, True
        while True:
            if self._creeps():
                raise self._wall(self._time - self._since)
            times, length = self._intervals(stop, span, most)
            begin = self._time
            result = self._stepper(
                self._x, self._z, begin, length, self._p, len(times), self._pace.at(begin), self._likely
            )
            if result is not None and (good := self._accept(times, *result)):
                # after a failure, the next call is shorter
                complete = first_try and good == len(times)
                self._last_span = max(self._last_span, span) if complete else good * length
                self._likely = len(self._grid) if complete else good
                return
            if result is None and self._over_failure():
                return
            first_try = False
            if len(times) > 1:
                most = max(1, len(times) // FEWER) if result is None else 1
            else:
                span = 0.5 * length
            if span < self._shortest:
                raise self._wall()

    def _over_failure(self) -> bool:
        """Try to advance after a failure of the integrator; return whether it did."""
        return False

    def _creeps(self) -> bool:
        """Return whether many calls of the integrator together hardly advanced."""
        self._calls += 1
        if self._time - self._since > self._stuck:
            self._calls, self._since = 1, self._time
        return self._calls > STUCK_CALLS

    def _intervals(self, stop: float, span: float, most: int) -> tuple[np.ndarray, float]:
        """Return the ends of the next equal intervals and their length: rows, or a fraction of an interval."""
        slack = 1e-9 * span
        first = int(np.searchsorted(self._grid, self._time, side="right"))
        rows = self._grid[first : first + most]
        rows = rows[rows <= min(stop, self._time + span + slack)]
        if not rows.size:
            length = min(span, stop - self._time)
            return np.array([stop if length == stop - self._time else self._time + length]), length
        length = float(rows[0]) - self._time
        equal = np.abs(rows - self._time - length * np.arange(1, rows.size + 1)) <= 1e-9 * length
        available = rows.size if equal.all() else int(np.argmin(equal))
        return rows[:available], float(rows[available - 1] - self._time) / available

    def _accept(self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray, works: np.ndarray) -> int:
        """Take the intervals over which the states are valid, and return their number."""
        zs = self._followed(times, xs, zs)
        good = len(zs)
        touching: list[str] = []
        when = self._time
        if good and self.system.roots:
            good, touching, when = self._resolved(times[:good], xs[:good], zs)
        begins = np.append(self._time, times[:good])
        points = np.vstack([self._here(), self._points(xs[:good], zs[:good], times[:good])])
        selection = self._systems.selection
        # other states might continue there: a touch counts only if these states are valid over the interval
        if touching and selection.has_choice:
            span = float(times[good] - begins[good])
            if not selection.foresees(self.system.choice, points[good], float(begins[good]), span):
                touching = []
        if good and selection.has_choice:
            good = selection.good_rows(self.system.choice, points, begins, self._switch_below)
        points = points[1:]
        works = self._work + works
        # reports of progress do not change the numbers
        size = REPORTED if self._progress is not None else max(1, good)
        for begin in range(0, good, size):
            block = slice(begin, min(good, begin + size))
            self._take_rows(times[block], xs[block], zs[block], works[block], points[block])
        if touching and good == len(points):
            raise Ended(
                SolveStatus.FAILED,
                f"the motion ends at {when:.6g} s in a singular pose: the two solutions of "
                f"{'; '.join(touching)} meet there, and it is undetermined which one continues",
            )
        return good

    def _take_rows(
        self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray, works: np.ndarray, points: np.ndarray
    ) -> None:
        """Record rows, take the last as the present point, and report progress."""
        rows = np.flatnonzero(self._recorded(times))
        if rows.size:
            self._record(times[rows], xs[rows], zs[rows], works[rows], points[rows])
        self._take(times[-1], xs[-1], zs[-1], works[-1])
        if self._progress is not None and self._progress(self._time):
            raise Ended(SolveStatus.INTERRUPTED, f"stopped by request at {self._time:.6g} s")

    def _followed(self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray) -> np.ndarray:
        """Return the Newton unknowns to round-off, up to the first row with another solution."""
        continuation = self.system.continuation
        if continuation is None:
            return zs
        limit = max(OTHER, OTHER_TOLERANCES * self.system.tolerance)
        rows, z, here = [], self._z, continuation.place(self._x, self._time, self._p)
        for x, near, t in zip(xs, zs, times, strict=True):
            there = continuation.place(x, t, self._p)
            followed = continuation.follow(z, here, there)
            if followed is None or not continuation.apart(followed, near) <= limit:
                break
            rows.append(followed)
            z, here = followed, there
        return np.array(rows).reshape(len(rows), zs.shape[1])

    def _resolved(self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray) -> tuple[int, list[str], float]:
        """Return how many intervals are resolved, that is, clearly on one side of each root; and which discriminants
        touch zero after them, and when."""
        times = np.concatenate([[self._time], times])
        xs, zs = np.vstack([self._x, xs]), np.vstack([self._z, zs])
        values, rates = self.system.roots(xs, zs, times, self._p)
        good, touching, when = self.system.roots.judge(times, values, rates)
        return len(good) if good.all() else int(np.argmin(good)), touching, when

    def _recorded(self, times: np.ndarray) -> np.ndarray:
        """Return which times are recorded rows."""
        place = np.minimum(np.searchsorted(self._rows, times), len(self._rows) - 1)
        return self._rows[place] == times

    def _take(self, time: float, x: np.ndarray, z: np.ndarray, work: np.ndarray) -> None:
        self._time, self._x, self._z, self._work = float(time), x, z, work
        self.largest = max(self.largest, float(np.max(np.abs(x) / self.system.stepper.x_scale, initial=0.0)))

    def _points(self, xs: np.ndarray, zs: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return points over the plan's pairs, one row for each time."""
        return self.system.reduced.point(xs, zs, times[:, None], self._p)[0]

    def _record(self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray, works: np.ndarray, points: np.ndarray) -> None:
        rows = self.system.reduced.row(xs, zs, times[:, None], self._p)[0]
        finite = np.all(np.isfinite(rows), axis=1)
        count = len(times) if finite.all() else int(np.argmin(finite))
        self.recorder.add(self._shown(times[:count]), rows[:count], works[:count])
        self.history.add(tuple(self.system.plan.states), times[:count], xs[:count] / self.system.stepper.x_scale)
        self.audit(points[:count], times[:count])
        if count < len(times):
            self._take(times[count], xs[count], zs[count], works[count])
            raise self._wall(0.0)

    def _shown(self, times: np.ndarray) -> np.ndarray:
        """Return the times of rows as recorded."""
        return times

    def _wall(self, failed: float | None = None) -> Ended:
        """Return why the run ends here; `failed`: interval [s] that the integrator could not pass."""
        run = float(self._rows[0]), float(self._rows[-1])
        failed = self._shortest if failed is None else failed
        return wall(self.system, self._x, self._z, self._time, self._p, self._shortest, run, failed)
