"""Advance of a simulation with events: ordinary pieces, the instants between them, and the events there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compiler.analysis.events import acting, holds
from ...compiler.flat import FlatModel
from ...lang.source import ModelError
from ...results.check import Check
from ...results.status import SolveStatus
from ..advance import after_discontinuity
from ..judgement import Ended
from ..options import Progress
from ..reduced import Audit
from ..systems import SimulatedSystem, Systems
from .actions import Actions, Changes, RunningBlock
from .clock import Accumulation, Due, Event, SampleClock, exact
from .comparisons import ZERO, Signed, corrected_root
from .sides import OverEdges, Restarted, Unsettled

if TYPE_CHECKING:
    from .modes import ReadyInMode, SimulatedModes

Pair = tuple[int, int]

# largest difference, relative to the exchanged energy, of declared loss and change of stored energies at an impact
DECLARED_LOSS = 1e-9
# rounds of event iteration at one instant, in addition to one for each event and switch
ROUNDS = 30


class HybridIntegration(OverEdges):
    """A running simulation with events. `events` are the events so far, `blocks` the sampled blocks with their samples.

    held: the present truth value of each condition of gt.when.
    """

    def __init__(self, ready: ReadyInMode, modes: SimulatedModes, rows: np.ndarray, grid: np.ndarray) -> None:
        super().__init__(ready, modes, rows, grid)
        begin, end = self._begin, self._end
        self._paces = {ready.values: self._pace}
        self._flat: FlatModel = modes.flat
        self._actions = Actions(modes.flat, modes.events, modes.pairs)
        self.events: list[Event] = []
        self._values = ready.values
        self.held = ready.held.copy()
        self._accumulation = Accumulation(end - begin)
        self._energy_error, self._largest_energy = 0.0, 0.0
        self._declares_loss = any(w.loss is not None for w in self._declared.whens)
        self._audited = 0.0
        self._broken: str | None = None
        self._sources: list[set[int]] = [set() for _ in self._declared.blocks]
        self._sources_of: SimulatedSystem | None = None
        self._last_recorded = self._next_row = -np.inf
        self.clock = SampleClock()
        self.blocks = [RunningBlock(b, self._flat, self._numbers) for b in self._declared.blocks]
        for n, block in enumerate(self.blocks):
            self.clock.add(block.first(begin), Due("block", n))
        self._times = modes.sample_times(self._numbers)
        for n, times in enumerate(self._times):
            period, offset = times or (Fraction(1), exact(begin))
            steps = max(0, -(-(exact(begin) - offset) // period))
            self.clock.add(offset + steps * period, Due("sample", n))

    @property
    def _numbers(self) -> np.ndarray:
        """Values of all parameters, including discrete variables."""
        return self._systems.parameters

    # -- between events ----------------------------------------------------------------------------

    def run(self, progress: Progress | None) -> None:
        """Advance to the last row. Raises Ended if it is not reached."""
        self._progress = progress
        self._record(*self._one_row())
        self._grow(self._comparisons(self._x[None, :], self._z[None, :], np.array([self._time]))[0])
        self._instant()
        of_inputs = self._inputs.knots(self._begin, self._end)
        while self._time < self._end:
            passed = self._time + self._slack
            knot = min(_first_after(passed, of_inputs), _first_after(passed, self._pace.knots))
            stop = self._row_at(min(self._next_sample(), knot, self._end))
            while self._time < stop:
                self._advance(stop, self._span(stop))
            if stop < self._end and knot <= stop + self._slack:
                self._knot(max(stop, knot))
            self._instant()
        self._at_the_end()

    def _knot(self, time: float) -> None:
        """Pass a knot; inputs that jump there, or come to rest at a threshold, cause their events immediately."""
        before = self._compared()
        self._begin_piece(time)
        after, zero = self._compared(), self._zero
        at_rest = (np.abs(after) <= zero) & (self.truth != self._modes.at_equality)
        before = np.where(at_rest, np.inf, before)
        if np.any(np.abs(after - before) > zero):
            self._event([], previous=before)

    def _at_the_end(self) -> None:
        """Handle an event at the last row that round-off would miss."""
        if self._declared.comparisons:
            end = np.array([self._time])
            values, rates = self._comparisons(self._x[None, :], self._z[None, :], end)
            s, ds = values[0] * self._signs(), rates[0] * self._signs()
            if (flips := np.flatnonzero((np.abs(s) <= self._zero) & (ds < -self._slow(self._zero)))).size:
                self._event(flips.tolist())

    def _row_at(self, time: float) -> float:
        """Return the recorded row at a time, or the time if there is none."""
        place = int(np.searchsorted(self._grid, time - self._slack))
        return float(self._grid[place]) if self._grid[place] <= time + self._slack else time

    def _next_sample(self) -> float:
        return np.inf if self.clock.next is None else float(self.clock.next)

    def _instant(self) -> None:
        """Handle all samples that are due now."""
        while self._next_sample() <= self._time + self._slack:
            self._sampled(*self.clock.take())

    def _intervals(self, stop: float, span: float, most: int) -> tuple[np.ndarray, float]:
        times, length = super()._intervals(stop, span, most)
        # only powers of 2, because each number of intervals needs its own integrator
        count = 1 << (len(times).bit_length() - 1)
        return times[:count], length

    def _accept(self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray, works: np.ndarray) -> int:
        """Accept intervals up to the first change of a comparison, including its event."""
        times = times[: len(xs)]
        if not self._declared.comparisons:
            return super()._accept(times, xs, zs, works)
        way, origin = self._stepper.way, self._time
        instants, values, rates = self._resolving(times, xs, zs)
        place, dip = self._first_change(instants, values, rates)
        changes = place < len(instants) - 1
        after, side = (instants[place + 1], "left") if changes else (instants[-1], "right")
        interval = int(np.searchsorted(times, after, side=side))
        good = interval
        if interval:
            good = super()._accept(times[:interval], xs[:interval], zs[:interval], works[:interval])
            self._grow(values[1 : int(np.searchsorted(instants, self._time, side="right"))])
        if good < interval or not changes:
            return good
        # a comparison that dips is on its previous side again at the end of the interval
        self._grow(values[1 : place + 1 + (dip > 0)])
        near = None if way is None else partial(self._near, way, self._time - origin)
        done = self._to_change(float(instants[place]), float(instants[place + 1]), dip, near)
        return max(good, 1) if done else good

    def _advance(self, stop: float, span: float) -> None:
        """Advance; if the integrator fails at a switch beyond which the equations are undefined, go over it."""
        try:
            super()._advance(stop, span)
        except Ended as error:
            if error.status is not SolveStatus.FAILED or not self._over_edge():
                raise

    def _to_change(self, start: float, end: float, dip: float, near: Signed | None = None) -> bool:
        """Advance to the first change between two times and handle its event; False if the integrator fails.

        dip: share of the interval at which a comparison seems to be negative although it is not at the end, or 0. near:
        approximate signed values.
        """
        begin, x, z, p = self._time, self._x, self._z, self._p
        steps: dict[float, tuple[np.ndarray, ...] | None] = {}

        def step(span: float) -> tuple[np.ndarray, ...] | None:
            if span not in steps:
                steps[span] = self._stepper(x, z, begin, span, p, 1, self._pace.at(begin), 1)
            return steps[span]

        def signed(span: float) -> tuple[np.ndarray, np.ndarray] | None:
            result = (x[None, :], z[None, :]) if span == 0.0 else step(span)
            if result is None:
                return None
            values, rates = self._comparisons(result[0], result[1], np.array([begin + span]))
            return values[0] * self._signs(), rates[0] * self._signs()

        low, high = max(start - begin, 0.0), end - begin
        if dip:
            high = low + dip * (high - low)
        at_end = signed(high)
        if at_end is None:
            return False
        changing = at_end[0] < -(self._round_off if dip else self._zero)
        if not changing.any():
            # only the interpolation dips: advance to this time and continue from there
            return self._go(high, step(high), begin + high)
        n = -1
        while changing.any():
            n = int(np.flatnonzero(changing)[0])
            root = corrected_root(signed, near, n, low, high)
            if root is None:
                return False
            high = root
            at_end = signed(root)
            assert at_end is not None
            changing = at_end[0] < -self._zero
            changing[n] = False
        falls = -np.minimum(at_end[1], 0.0)
        zero = np.maximum(self._zero, falls * self._slack)
        at_zero = (np.abs(at_end[0]) <= zero) & (falls > self._slow(self._zero))
        # at the last floating-point time before the root, its comparison may be farther from zero than others
        at_zero[n] = True
        flips = np.flatnonzero(at_zero).tolist()
        if high > 0.0 and not self._go(high, step(high), begin + high):
            return False
        self._event(flips)
        return True

    def _go(self, span: float, result: tuple[np.ndarray, ...] | None, time: float) -> bool:
        """Advance by one interval with the result of its integration; return whether that succeeds."""
        if result is None:
            return False
        if time <= self._time:
            return True
        return super()._accept(np.array([time]), *result) == 1

    # -- at an instant -----------------------------------------------------------------------------

    def _sampled(self, now: Fraction, due: Sequence[Due]) -> None:
        """Take the samples that are due now: inputs have their previous values, outputs without delay act at once."""
        new: dict[int, float] = {}
        blocks = [d.number for d in due if d.kind == "block"]
        inputs = self._block_inputs({}) if blocks else {}
        for n in self._order(blocks) if blocks else ():
            block = self.blocks[n]
            numbers = self._numbers.copy()
            numbers[list(new)] = list(new.values())
            immediate = {place: v for m in self._sources[n] for place, v in self._outputs_in(new, m)}
            block_inputs = self._block_inputs(immediate) if immediate else inputs
            result = block.step(self._time, block_inputs[n], numbers)
            outputs = {place for s in block.block.outputs for place in s.places}
            new |= {place: v for place, v in result.items() if place not in outputs or not block.delay}
            if block.delay:
                late = {place: v for place, v in result.items() if place in outputs}
                self.clock.add(now + block.delay, Due("outputs", n, late))
            self.clock.add(now + block.period, Due("block", n))
        for d in due:
            if d.kind == "outputs":
                new |= d.values
            elif d.kind == "sample" and (times := self._times[d.number]) is not None:
                self.clock.add(now + times[0], Due("sample", d.number))
        samples = [n for n in range(len(self._times)) if Due("sample", n) in due]
        previous = self._compared() if new else None
        if new:
            self._set(new)
        if samples or (new and (self._declared.comparisons)):
            self._event([], samples, previous)

    def _outputs_in(self, new: Mapping[int, float], block: int) -> list[tuple[int, float]]:
        """Return the new outputs of a block."""
        places = [place for s in self.blocks[block].block.outputs for place in s.places]
        return [(place, new[place]) for place in places if place in new]

    def _order(self, blocks: Sequence[int]) -> list[int]:
        """Return simultaneous blocks in the order of their data flow.

        Raises ModelError for a loop of blocks without delay.
        """
        if len(self.blocks) > 1 and self._sources_of is not self.system:
            self._sources = self._modes.sources(self.system, [not b.delay for b in self.blocks])
            self._sources_of = self.system
        remaining, ordered = list(blocks), []
        while remaining:
            ready = [n for n in remaining if not self._sources[n].intersection(remaining)]
            if not ready:
                names = ", ".join(self.blocks[n].name for n in remaining)
                raise ModelError(
                    f"the sampled blocks {names} read each other's outputs at the same instant, in an algebraic loop; "
                    "give one of them a delay"
                )
            ordered += ready
            remaining = [n for n in remaining if n not in ready]
        return ordered

    def _block_inputs(self, new: Mapping[int, float]) -> dict[int, np.ndarray]:
        """Return the inputs of each block at this point; `new`: values that replace those of discrete variables."""
        p = self._inputs.with_parameters(self._p, new) if new else self._p
        row = self.system.reduced.row(self._x[None, :], self._z[None, :], np.array([[self._time]]), p)[0][0]
        return {n: row[self._modes.columns_of(b.block)] for n, b in enumerate(self.blocks)}

    def _set(self, new: Mapping[int, float]) -> None:
        """Set discrete variables; continuous ones continue."""
        changed = {place: v for place, v in new.items() if self._inputs.parameters[place] != v}
        if not changed:
            return
        before = self._p
        self._inputs.parameters.update(changed)
        after = self._inputs.with_parameters(before, changed)
        self._renumber(self._systems)
        self._z = after_discontinuity(self.system, self._x, self._z, self._time, before, after)
        self._p = after
        self._calls = 0

    def _renumber(self, systems: Systems) -> None:
        """Take the systems with the present values."""
        flat = renumbered(systems.flat, self._inputs.parameters)
        self._close_audit()
        self._systems = systems.with_numbers(flat, None)
        self.audit = Audit(self._systems.original_equations, self._systems.parameters)

    def _close_audit(self) -> None:
        self._audited = max(self._audited, self.audit.residual)
        self._broken = self._broken or self.audit.verdict()

    def finish(self) -> tuple[float, str | None]:
        """Return residual and sentence as `Integration` does, over all parameter values of the run."""
        self._close_audit()
        return self._audited, self._broken

    def happened(self, status: SolveStatus) -> list[str]:
        """Return the notes of `Integration`, and the number of events."""
        n = len(self.events)
        return [*([f"{n} event{'s' * (n > 1)}"] if n and status.ok else []), *super().happened(status)]

    def own_checks(self, moved: float) -> tuple[dict[str, Check], list[str]]:
        """Return the check "declared_loss", that events dissipate the energy that they declare, and its sentence."""
        if not self._declares_loss:
            return {}, []
        scale = max(moved, self._largest_energy)
        share = self._energy_error / scale if scale > 0 else self._energy_error
        check = Check(share, DECLARED_LOSS, "correct the formula of gt.energy_loss")
        sentence = f"the energy loss of an event differs from its gt.energy_loss by {self._energy_error:.3g} J"
        return {"declared_loss": check}, [] if check.passed else [sentence]

    def of_events(self) -> dict[str, Any]:
        """Return the events, the samples of the blocks, and the time [s] at which events accumulate."""
        samples = {b.name: b.trajectory for b in self.blocks if b.count}
        return {"events": self.events, "samples": samples, "accumulation": self._accumulation.point}

    def _event(self, forced: Sequence[int], samples: Sequence[int] = (), previous: np.ndarray | None = None) -> None:
        """Handle the events of this instant until nothing changes: comparisons `forced` change, `samples` are due.
        previous: values of the comparisons before, if some have jumped already.

        In each round modes switch and gt.when acts together. If this does not settle, gt.when waits in each round for
        modes that are consistent with their comparisons, because the equations of one instant hold together.
        """
        begin = self._snapshot()
        try:
            self._rounds(forced, samples, previous, waits=False)
        except Unsettled:
            if not self._declared.modes:
                raise
            self._restore(begin)
            self._rounds(forced, samples, previous, waits=True)

    def _rounds(self, forced: Sequence[int], samples: Sequence[int], previous: np.ndarray | None, waits: bool) -> None:
        events, causes = self._declared, dict[str, None]()
        discrete: dict[int, tuple[float, float]] = {}
        restarted: dict[Pair, tuple[float, float]] = {}
        impulses: dict[str, float] = {}
        stored, declared, modes = self._stored(), None, self._values
        row_before = self._one_row()
        visited: set[tuple[object, ...]] = set()
        self._update_round_off()
        due, zero = [n in samples for n in range(len(events.samples))], self._zero
        previous = self._compared() if previous is None else previous
        # at the last floating-point time before the root, the value may be larger
        zero[forced] = np.maximum(zero[forced], 2 * np.abs(previous[forced]))
        changed, reset, jumped = np.zeros((3, len(events.comparisons)), dtype=bool)
        acted, impacts, ends = False, False, list[int]()
        for turn in range(ROUNDS + len(events.whens) + len(events.modes)):
            before = previous
            truth, previous = self._sides(forced if turn == 0 else (), zero, previous, reset)
            values = tuple(holds(m.logic, truth) for m in events.modes)
            changed |= truth != self.truth
            jumped = jumped | ((truth != self.truth) & (np.abs(previous - before) > zero))
            self.truth = truth
            switched = values != self._values
            fired: list[int] = []
            if not (waits and switched):
                conditions = np.array([holds(w.logic, truth, due) for w in events.whens], dtype=bool)
                fired = acting(events.whens, np.flatnonzero(conditions & ~self.held).tolist())
                self.held, due, jumped = conditions, [], np.zeros_like(jumped)
            if not fired and not switched:
                break
            if not acted:
                if self._last_recorded < self._time:
                    self._record(*row_before)
                acted = True
            causes |= dict.fromkeys(f"{events.whens[n].name} ({events.whens[n].where})" for n in fired)
            causes |= dict.fromkeys(
                f"{m.name} ({m.where})"
                for m, old, new in zip(events.modes, self._values, values, strict=True)
                if old != new
            )
            ends += [n for n in fired if events.whens[n].end is not None]
            changes = self._changes(fired, values)
            for place, v in changes.discrete.items():
                first = discrete.get(place, (float(self._numbers[place]), v))[0]
                discrete[place] = first, v
            for pair, v in changes.restarted.items():
                before = restarted.get(pair, (self._value(pair), v))[0]
                restarted[pair] = before, v
            declared = declared if changes.loss is None else (declared or 0.0) + changes.loss
            impacts = impacts or bool(changes.restarted)
            state = values, tuple(sorted((self._inputs.parameters | changes.discrete).items()))
            if state in visited and not changes.restarted:
                agreeing = self._agreeing(np.flatnonzero(jumped).tolist(), zero, reset) if waits and not fired else None
                if agreeing is None:
                    raise self._unsettled(list(causes))
                values = agreeing
            visited.add(state)
            for force, impulse in self._restart(values, changes).items():
                impulses[force] = impulses.get(force, 0.0) + impulse
            reset = reset | self._compares_reset(changes)
        else:
            raise self._unsettled(list(causes))
        # the largest value of a comparison that changed its side starts again, from its remainder on the other side
        self._size = np.where(changed, self._remainder() / ZERO, self._size)
        at_start = bool(samples) and all(self._times[n] is None for n in samples)
        unchanged = not restarted and values == modes and all(old == new for old, new in discrete.values())
        if not acted or (at_start and unchanged and not ends):
            return
        after = self._stored()
        change = after - stored
        self._largest_energy = max(self._largest_energy, abs(stored), abs(after))
        self._book(change, declared, impacts)
        self._record(*self._one_row())
        name = self._actions.name_of
        helpers = {place for s in self._modes.events.shown if s.helper for place in s.places}
        self.events.append(
            Event(
                self._time,
                tuple(causes),
                {name(k): v for k, v in discrete.items() if v[0] != v[1] and k not in helpers},
                {name(k): v for k, v in restarted.items()},
                change,
                impulses,
            )
        )
        if ends:
            raise self._termination(ends)
        self._last_span = max(self._accumulation.add(self._time, tuple(causes)), self._shortest)
        if (sentence := self._accumulation.sentence()) is not None:
            raise Ended(SolveStatus.FAILED, sentence)

    def _termination(self, ends: Sequence[int]) -> Ended:
        """Return the end that an event declares; failures have precedence."""
        declared = [end for n in ends if (end := self._declared.whens[n].end) is not None]
        end = next((end for end in declared if end.failed), declared[0])
        status = SolveStatus.FAILED if end.failed else SolveStatus.SOLVED
        return Ended(status, f"at {self._time:.6g} s {end.sentence} ({end.where})")

    def _changes(self, fired: Sequence[int], modes: tuple[bool, ...]) -> Changes:
        if not fired:
            return Changes()
        row = self._row()
        values = row[self._modes.read_columns]
        return self._actions(fired, values, self._numbers, modes, self._time)

    def _restart(self, values: tuple[bool, ...], changes: Changes) -> dict[str, float]:
        """Continue in these modes, with new discrete values and reinitialised states; return the impulses."""
        if values == self._values and not changes.restarted:
            self._set(changes.discrete)
            return {}
        point, old = self._here(), self.system
        struck: dict[Pair, float] = {}
        impulses: dict[str, float] = {}
        if changes.forces:
            struck, impulses = self._modes.struck(self._systems, old, point, self._time, changes)
        self._inputs.parameters.update(changes.discrete)
        systems = self._systems if values == self._values else self._modes.systems(values)
        self._renumber(systems)
        self._p = self._inputs.with_parameters(self._p, changes.discrete)

        def restart(point: np.ndarray, time: float) -> Restarted:
            return self._modes.restart(
                self._systems, self._settings, old, point, time, self._p, changes.restarted, struck,
                (self._values, values),
            )  # fmt: skip

        self._time, (self.system, self._x, self._z) = self._on_new_side(restart, point)
        if values != self._values:
            self._values = values
            if values not in self._paces:
                self._paces[values] = self._modes.pace(self._systems, values, self._inputs, self._begin, self._end)
            self._pace = self._paces[values]
        self._calls = 0
        return impulses

    def _value(self, pair: Pair) -> float:
        """Return the present value of a variable's derivative that actions read."""
        return float(self._row()[self._modes.read_columns][self._modes.pairs.index(pair)])

    # -- rows and energies -------------------------------------------------------------------------

    def _row(self) -> np.ndarray:
        return self.system.reduced.row(self._x[None, :], self._z[None, :], np.array([[self._time]]), self._p)[0][0]

    def _stored(self) -> float:
        return float(self._row()[-1]) if self._modes.has_energy else 0.0

    def _book(self, change: float, declared: float | None, impacts: bool) -> None:
        """Book the energy of an event: its declared loss, else the change by an impact. Any other change of the stored
        energy is an error of the balance."""
        if not self._modes.has_energy or (declared is None and not impacts):
            return
        if declared is not None:
            self._energy_error = max(self._energy_error, abs(change + declared))
        loss = -change if declared is None else declared
        self._work = self._work + (np.array([0.0, loss]) if loss > 0 else np.array([-loss, 0.0]))

    def _one_row(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        time = np.array([self._time])
        return time, self._x[None, :], self._z[None, :], self._work[None, :], self._here()[None, :]

    def _record(self, times: np.ndarray, xs: np.ndarray, zs: np.ndarray, works: np.ndarray, points: np.ndarray) -> None:
        """Record rows; the second row of an instant is at the next larger floating-point time."""
        self._next_row = times[0]
        if times[0] <= self._last_recorded:
            last = self._last_recorded
            self._next_row = max(float(np.nextafter(last, np.inf)), last + float(np.spacing(self._end - self._begin)))
        super()._record(times, xs, zs, works, points)
        self._last_recorded = max(self._next_row, float(times[-1]))

    def _shown(self, times: np.ndarray) -> np.ndarray:
        return np.append(self._next_row, times[1:]) if times.size else times


def _first_after(time: float, times: np.ndarray) -> float:
    """Return the first of sorted times after this one, infinite if there is none."""
    place = int(np.searchsorted(times, time, side="right"))
    return float(times[place]) if place < len(times) else np.inf


def renumbered(flat: FlatModel, numbers: Mapping[int, float]) -> FlatModel:
    """Return the model with other values of independent parameters, given by place in `flat.p`."""
    parameters = list(flat.parameters)
    for place, value in numbers.items():
        if parameters[place].value != value:
            parameters[place] = replace(parameters[place], value=value)
    return replace(flat, parameters=parameters)
