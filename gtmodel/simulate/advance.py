"""A simulation under way: pieces between knots, intervals that its states are good for, rows on the way."""

from __future__ import annotations

import numpy as np

from ..compiler.initial import Initial
from ..results.status import SolveStatus
from .audit import Audit
from .choice import LARGEST_CHANGE, SWITCH_BELOW, Reference
from .inputs import Inputs
from .record import Recorder
from .result import Progress, Switch
from .step import CHUNKS
from .systems import System, Systems

# an interval this much shorter than the whole run means that the motion leads nowhere
SHORTEST = 1e-8
# where a run ends, a state of so many nominals has grown without bound
UNBOUNDED = 1e6
# an interval may be so many times as long as the one before it
GROWTH = 3.0
# a margin this small beside its typical size is named as what ends the motion
NEAR_ZERO = 1e-3


class Ended(Exception):
    """The run ends early; says why."""

    def __init__(self, status: SolveStatus, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class Course:
    """Where a simulation is, and with which states. `rows` are the times to record, start and end included."""

    def __init__(
        self, systems: Systems, inputs: Inputs, recorder: Recorder, start: Initial, system: System, rows: np.ndarray
    ) -> None:
        self._systems, self._inputs, self._recorder, self._rows = systems, inputs, recorder, rows
        self._audit = Audit(systems.plan)
        self.system = system
        self.switches: list[Switch] = []
        self.residual = 0.0
        self._x, self._z = system.reduced.from_point(start.w)
        self._work = np.zeros(2)
        self._time = float(rows[0])
        self._shortest = SHORTEST * float(rows[-1] - rows[0])
        self._reference: Reference | None = None
        self._switch_below = SWITCH_BELOW
        self._last_span = np.inf
        self._begin_piece()

    def run(self, progress: Progress | None) -> None:
        """Go to the last row. Raises Ended where that is not reached."""
        end = float(self._rows[-1])
        at = np.array([self._time])
        self._record(at, self._x[None, :], self._z[None, :], self._work[None, :], self._here()[None, :])
        for stop in [*self._inputs.knots(self._time, end).tolist(), end]:
            while self._time < stop:
                self._advance(stop, self._span(stop))
                if progress is not None and progress(self._time):
                    raise Ended(SolveStatus.INTERRUPTED, f"stopped by request at {self._time:.6g} s")
            self._begin_piece()

    def _begin_piece(self) -> None:
        self._p = self._inputs.piece(self._time)
        self._z = self.system.reduced.polish(self._x, self._z, self._time, self._p)

    # -- states ------------------------------------------------------------------------------------

    def _span(self, stop: float) -> float:
        """Time [s] for which the states are good, after a look whether others would be better."""
        watch, longest = self._systems.watch, min(stop - self._time, GROWTH * self._last_span)
        if not watch.has_choice:
            return longest
        w = self._here()
        matrix = watch.matrix(w, self._time)
        reference = watch.refer(self.system.choice, matrix)
        if reference.quality < self._switch_below:
            other = self._systems.at(w, self._time)
            better = None if other is None else watch.refer(other.choice, matrix)
            if other is not None and better is not None and better.quality > reference.quality:
                self._switch(other, w)
                reference = better
            else:  # the best there is, until it gets much worse
                self._switch_below = 0.5 * reference.quality
        else:
            self._switch_below = SWITCH_BELOW
        if not reference.quality > 0.0:
            raise Ended(
                SolveStatus.FAILED,
                f"the motion ends at {self._time:.6g} s in a singular pose: no choice of states describes it there",
            )
        self._reference = reference
        span = watch.horizon(self.system.choice, reference, w, self._time, longest)
        if span < longest:
            self._last_span = span
        if span < min(longest, self._shortest):
            raise Ended(*self._wall())
        return span

    def _switch(self, system: System, w: np.ndarray) -> None:
        self.switches.append(Switch(self._time, self.system.states, system.states))
        self.system = system
        self._x, self._z = system.reduced.from_point(w)
        self._switch_below = SWITCH_BELOW

    def _here(self) -> np.ndarray:
        return self._points(self._x[None, :], self._z[None, :], np.array([self._time]))[0]

    # -- integration -------------------------------------------------------------------------------

    def _advance(self, stop: float, span: float) -> None:
        """One call of the integrator over at most `span` seconds: many rows at once where that goes well."""
        most, last = CHUNKS[0], max(self._last_span, span)
        while True:
            times, length = self._intervals(stop, span, most)
            result = self.system.stepper(self._x, self._z, self._time, length, self._p, len(times))
            if result is not None and self._accept(times, *result):
                self._last_span = last
                return
            last = length
            if len(times) > 1:
                most = next(n for n in CHUNKS if n < len(times))
            else:
                span = 0.5 * length
            if span < self._shortest:
                raise Ended(*self._wall())

    def _intervals(self, stop: float, span: float, most: int) -> tuple[np.ndarray, float]:
        """Ends of the next equal intervals, and their length: as many rows as there are, or a part of the way."""
        slack = 1e-9 * span
        rows = self._rows[np.searchsorted(self._rows, self._time, side="right") :]
        rows = rows[rows <= min(stop, self._time + span + slack)][:most]
        if not rows.size:
            length = min(span, stop - self._time)
            return np.array([stop if length == stop - self._time else self._time + length]), length
        length = float(rows[0]) - self._time
        equal = np.abs(rows - self._time - length * np.arange(1, rows.size + 1)) <= 1e-9 * length
        available = rows.size if equal.all() else int(np.argmin(equal))
        count = next(n for n in CHUNKS if n <= available)
        return rows[:count], float(rows[count - 1] - self._time) / count

    def _accept(self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray, works: np.ndarray) -> bool:
        """Take the intervals over which the states stayed good; False if there is none."""
        reduced, watch = self.system.reduced, self._systems.watch
        zs = np.array([reduced.polish(x, z, t, self._p) for x, z, t in zip(xs, zs, times, strict=True)])
        points = self._points(xs, zs, times)
        good = len(times)
        if self._reference is not None:
            changes = watch.changes(self.system.choice, self._reference, points, times)
            good = good if np.all(changes <= LARGEST_CHANGE) else int(np.argmin(changes <= LARGEST_CHANGE))
            if good == 0:
                return False
        works = self._work + works
        rows = np.flatnonzero(np.isin(times[:good], self._rows))
        if rows.size:
            self._record(times[rows], xs[rows], zs[rows], works[rows], points[rows])
        self._take(times[good - 1], xs[good - 1], zs[good - 1], works[good - 1])
        return True

    def _take(self, time: float, x: np.ndarray, z: np.ndarray, work: np.ndarray) -> None:
        self._time, self._x, self._z, self._work = float(time), x, z, work

    def _points(self, xs: np.ndarray, zs: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Points over the plan's pairs, one row for each time."""
        return np.asarray(self.system.reduced.point(xs.T, zs.T, times[None, :], self._p).full()).T

    def _record(self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray, works: np.ndarray, points: np.ndarray) -> None:
        rows = np.asarray(self.system.reduced.row(xs.T, zs.T, times[None, :], self._p).full()).T
        finite = np.all(np.isfinite(rows), axis=1)
        count = len(times) if finite.all() else int(np.argmin(finite))
        self._recorder.add(times[:count], rows[:count], works[:count])
        self.residual = max(self.residual, self._audit(points[:count], times[:count]))
        if count < len(times):
            self._take(times[count], xs[count], zs[count], works[count])
            raise Ended(*self._wall())

    def _wall(self) -> tuple[SolveStatus, str]:
        """Why it does not go on from here."""
        at = f"the motion ends at {self._time:.6g} s"
        if np.any(np.abs(self._x) > UNBOUNDED * self.system.stepper.x_scale):
            return SolveStatus.DIVERGED, f"{at}: the state grows without bound"
        reduced = self.system.reduced
        numbers = np.asarray(reduced.margins(self._x, self._z, self._time, self._p).full()).reshape(-1)
        margins = [m for b in reduced.plan.blocks for m in b.margins]
        gone: dict[str, list[str]] = {"condition": [], "discriminant": [], "pivot": []}
        for m, value in zip(margins, numbers.tolist(), strict=True):
            size = abs(value) if m.kind == "pivot" else value
            if not size > NEAR_ZERO * m.scale:
                gone[m.kind].append(f"the {m.kind} of {m.label} is {value:.3g}, typically {m.scale:.3g}")
        found = gone["condition"] or gone["discriminant"] or gone["pivot"]
        if found:
            return SolveStatus.FAILED, f"{at}, where it leads out of the model's range: {'; '.join(found[:3])}"
        return SolveStatus.FAILED, f"{at}: the integrator's steps became too small there, or no numbers came out"
