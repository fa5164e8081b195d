"""The modes of a model with events: an ordinary simulation for each, made when it is met first."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from ...compiler.analysis.bounds import Pace
from ...compiler.analysis.events import BlockSignal, FlatBlock, FlatEvents, holds
from ...compiler.analysis.switching import differentiated, in_mode, names_of
from ...compiler.flat import FlatModel
from ...compiler.flat_cache import with_values
from ...lang.slips import floats
from ...lang.source import ModelError
from ...results.status import SolveStatus
from ..inputs import SimulationInputs
from ..judgement import Ended
from ..prepare import Ready, prepare_in
from ..record import Recorded, RecordedQuantity, Recorder
from ..reduced import Watched
from ..systems import IntegratorSettings, SimulatedSystem, Systems
from .actions import Changes, ValuesIn, carried_over, read_by
from .clock import exact

Pair = tuple[int, int]
# tries of modes that suit a start
TRIES = 20
# comparisons that are zero at the start, of which both sides are tried
MOST_UNDECIDED = 8
# of what a comparison at the start compares: nearer to zero its sign is round-off; and of the nominals of states
ZERO = 1e-12
ROUND_OFF = 8 * np.finfo(float).eps
# of the nominals: a state that a change of modes moves further has jumped
JUMPED = 1e-6


@dataclass(frozen=True, eq=False)
class ReadyInMode:
    """A simulation with events before its first step: the values of the modes, the truth of each comparison, and of
    each condition of gt.when."""

    ready: Ready
    values: tuple[bool, ...]
    truth: np.ndarray
    held: np.ndarray


class SimulatedModes:
    """A model with events in one run. `flat` has the numbers of its start; `pairs` are what actions and blocks read,
    in `read_columns` of a row; comparisons stand from `first_comparison` on."""

    def __init__(
        self, flat: FlatModel, now: FlatModel, given: SimulationInputs, outputs: Sequence[str], prefer: Sequence[int]
    ) -> None:
        assert flat.events is not None
        self._compiled, self.flat, self.events = flat, now, flat.events
        self._given, self._outputs, self._prefer = given, tuple(outputs), prefer
        self.pairs = read_by(self.events, flat)
        self.recorded = _recorded(flat, self.events, self._outputs, self.pairs)
        self.has_energy = bool(flat.energies)
        self.first_comparison = len(self.recorded.expressions) - self.recorded.extra
        first = self.first_comparison + len(self.events.comparisons)
        self.read_columns = slice(first, first + len(self.pairs))
        self._place = {pair: first + n for n, pair in enumerate(self.pairs)}
        self._discrete = np.array([c.discrete for c in self.events.comparisons], dtype=bool)
        self._strict = np.array([c.strict for c in self.events.comparisons], dtype=bool)
        self.at_equality = ~self._strict  # truth of each comparison where both of its sides are equal
        self._flats: dict[tuple[bool, ...], FlatModel] = flat.cache.setdefault("modes", {})

    def columns_of(self, block: FlatBlock) -> list[int]:
        """Of a block's inputs in a row, in order."""
        return [self._place[i, 0] for s in block.inputs for i in s.places]

    def flat_in(self, values: tuple[bool, ...]) -> FlatModel:
        """The model in these modes, always the same one."""
        if values not in self._flats:
            self._flats[values] = in_mode(self._compiled, values)
        return self._flats[values]

    def systems(self, values: tuple[bool, ...]) -> Systems:
        """In these modes, with the numbers of now."""
        flat = self.flat_in(values)
        return Systems.kept(flat, self._given, self.recorded_in(values), self._prefer, self._numbered(flat))

    def _numbered(self, flat: FlatModel) -> FlatModel:
        return with_values(flat, self._given.parameters)

    def recorded_in(self, values: tuple[bool, ...]) -> Recorded:
        """What rows consist of in these modes."""
        cache = self.flat_in(values).cache
        key = "recorded with events", self._outputs
        if key not in cache:
            expressions = self.recorded.expressions
            if self.events.modes:
                old = ca.vertcat(*[m.symbol for m in self.events.modes])
                numbers = ca.DM([float(v) for v in values])
                expressions = ca.vertsplit(ca.substitute(ca.vertcat(*expressions), old, numbers))
            cache[key] = replace(self.recorded, expressions=expressions)
        return cache[key]

    def pace(
        self, systems: Systems, values: tuple[bool, ...], inputs: SimulationInputs, start: float, end: float
    ) -> Pace:
        """How fast functions of time change in these modes, those among them that events look at."""
        last = self.first_comparison + len(self.events.comparisons)
        watched = ca.SX(ca.vertcat(*self.recorded_in(values).expressions[self.first_comparison : last]))
        return systems.pace(inputs, start, end, watched, self.events.discrete)

    # -- start -------------------------------------------------------------------------------------

    def start(
        self, start: Mapping[str, Any], start_time: float, settings: IntegratorSettings, end: float
    ) -> ReadyInMode:
        """A consistent start in modes that suit it.

        Raises ModelError where each try leads to other modes.
        """
        guess, undecided = self._guess(start, start_time)
        refused: ModelError | None = None
        # what is zero at the start may be on either side
        for choice in product(*[(False, True)] * min(len(undecided), MOST_UNDECIDED)):
            truth = guess.copy()
            truth[undecided[: len(choice)]] ^= np.array(choice, dtype=bool)
            try:
                ready = self._settled(truth, start, start_time, settings, end)
            except ModelError as error:
                refused = refused or error
                continue
            if ready is not None:
                return ready
        if refused is not None:
            raise refused
        # a sign() that switches is the law of dry friction
        held = ", as where friction would hold" if any(m.name == "sign()" for m in self.events.modes) else ""
        wheres = ", ".join(dict.fromkeys(f"{m.name} at {m.where}" for m in self.events.modes))
        raise ModelError(
            f"{self.flat.title}: no side of {wheres} suits the start: each leads to the other{held}; "
            "give another start, or a mode of its own in between (gt.discrete)"
        )

    def _settled(
        self, truth: np.ndarray, start: Mapping[str, Any], start_time: float, settings: IntegratorSettings, end: float
    ) -> ReadyInMode | None:
        """A start in modes that suit it, looked for from these; None where each leads to others."""
        seen: list[tuple[bool, ...]] = []
        for _ in range(TRIES):
            values = tuple(holds(m.logic, truth) for m in self.events.modes)
            flat = self.flat_in(values)
            ready = prepare_in(
                flat, self._numbered(flat), self._given, self.recorded_in(values), Recorder(self.recorded), start,
                start_time, self._prefer, settings,
            )  # fmt: skip
            truth = self._truth(ready, start_time, end, truth)
            again = tuple(holds(m.logic, truth) for m in self.events.modes)
            if again == values:
                held = np.array([holds(w.logic, truth) for w in self.events.whens], dtype=bool)
                return ReadyInMode(ready, values, truth, held)
            seen.append(values)
            if again in seen:
                break
        return None

    def _guess(self, start: Mapping[str, Any], time: float) -> tuple[np.ndarray, np.ndarray]:
        """Truth of the comparisons at the declared start values, and the numbers of those that are zero there."""
        flat = self.flat
        scope = flat.scope
        column = ca.vertcat(*[c.expression for c in self.events.comparisons])
        if not self.events.comparisons:
            return np.zeros(0, dtype=bool), np.zeros(0, dtype=int)
        pairs = list(scope.symbols_in(column))
        values = {(v.index, 0): v.start or 0.0 for v in flat.variables}
        for name, value in start.items():
            _, indices, order = flat.lookup(name)
            array = np.broadcast_to(floats(value).reshape(-1), (len(indices),))
            values |= {(i, order): float(x) for i, x in zip(indices, array, strict=True)}
        known = [p for p in pairs if p[0] in set(self._given.known)]
        values |= dict(zip(known, self._given.values(known, time), strict=True)) if known else {}
        given = {pair: values.get(pair, 0.0) for pair in pairs}
        prescribed = {(i, order) for name in start for _, indices, order in [flat.lookup(name)] for i in indices}
        exact = prescribed | {(v.index, 0) for v in flat.variables if v.fixed} | set(known)
        compared, zero = self._compared(given, exact, time)
        at_zero = np.where(self._strict, compared > 0, compared >= 0)
        truth = self.sides(compared, np.zeros_like(compared), 0.0, 0.0, at_zero)
        return truth, np.flatnonzero(~self._discrete & (np.abs(compared) <= zero))

    def _compared(
        self, given: Mapping[Pair, float], exact: Container[Pair], time: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values of the comparisons, and so near to zero that round-off decides on their signs: of what is compared,
        and of the nominals of what follows from it but for those that are `exact`."""
        numbers = np.array(list(given.values()))
        nominals = np.array([self.flat.variables[i].nominal for i, _ in given])
        stated = np.array([pair in exact for pair in given], dtype=bool)
        errors = np.maximum(ZERO * np.abs(numbers), np.where(stated, ROUND_OFF, ZERO) * nominals)
        modes = np.ones(len(self.events.modes))
        made = self._with_derivatives(tuple(given))(numbers, self.flat.p0, time, modes)
        values, by_given, by_p, by_time = (np.abs(np.asarray(m.full())) if n else m.full() for n, m in enumerate(made))
        zero = by_given @ errors + ZERO * (by_p @ np.abs(self.flat.p0) + by_time[:, 0] * abs(time))
        return values.reshape(-1), np.nan_to_num(zero)

    def _with_derivatives(self, pairs: tuple[Pair, ...]) -> ca.Function:
        """Of the comparisons, by the variables' derivatives that they read, by parameters and by time."""
        scope, cache = self.flat.scope, self._compiled.cache
        if "comparisons" not in cache:
            column = ca.vertcat(*[c.expression for c in self.events.comparisons])
            symbols = [scope.symbol(*pair) for pair in pairs]
            read = ca.SX(ca.vertcat(*symbols)) if symbols else ca.SX(0, 1)
            modes = ca.SX(ca.vertcat(*[m.symbol for m in self.events.modes])) if self.events.modes else ca.SX(0, 1)
            outputs = [column, *(ca.jacobian(column, x) for x in (read, self._compiled.p, scope.time))]
            arguments = [read, self._compiled.p, scope.time, modes]
            cache["comparisons"] = ca.Function("comparisons", arguments, [ca.densify(x) for x in outputs])
        return cache["comparisons"]

    def _truth(self, ready: Ready, time: float, end: float, before: np.ndarray) -> np.ndarray:
        """Of the comparisons at a start: by their values, at zero by their rates."""
        if not self.events.comparisons:
            return np.zeros(0, dtype=bool)
        watched, plan = self.watched(ready.system), ready.system.plan
        x, z = ready.system.reduced.from_point(ready.initial.w)
        values, rates = watched(x[None, :], z[None, :], np.array([time]), ready.inputs.piece(time))
        column = ca.vertcat(*[c.expression for c in self.events.comparisons])
        value = ValuesIn(ready.system, ready.initial.w)
        given = {pair: value(pair) for pair in self.flat.scope.symbols_in(column)}
        states = {pair for pair in given if plan.alias.resolve(*pair)[1:] in plan.states}
        _, zero = self._compared(given, states, time)
        return self.sides(values[0], rates[0], zero, zero / (end - time), before)

    def watched(self, system: SimulatedSystem) -> Watched:
        """The comparisons in a system."""
        last = self.first_comparison + len(self.events.comparisons)
        return Watched(system.reduced, system.reduced.outputs[self.first_comparison : last])

    def sides(self, values: np.ndarray, rates: np.ndarray, zero: Any, slow: Any, before: np.ndarray) -> np.ndarray:
        """Truth of the comparisons from now on: by their values, within `zero` by their rates, and as they were
        `before` where these are `slow`; of discrete variables exactly."""
        truth = np.where(np.abs(values) > zero, values > 0, np.where(np.abs(rates) > slow, rates > 0, before))
        return np.where(self._discrete, np.where(self._strict, values > 0, values >= 0), truth)

    # -- on the way --------------------------------------------------------------------------------

    def restart(
        self,
        systems: Systems,
        settings: IntegratorSettings,
        old: SimulatedSystem,
        point: np.ndarray,
        time: float,
        p: np.ndarray,
        restarted: Mapping[Pair, float],
        struck: Mapping[Pair, float],
        modes: tuple[tuple[bool, ...], tuple[bool, ...]],
    ) -> tuple[SimulatedSystem, np.ndarray, np.ndarray]:
        """A system for the modes of `systems` from a point of the old one, with its states and Newton unknowns; `modes`
        are the values before and after.

        States go on, but for those that start anew, and those that an impulse changed: `struck` has their values by
        symbols of the old system. Raises ModelError where a state would jump although nobody says so, and Ended where
        the new equations have no solution there.
        """
        flat, plan = systems.flat, systems.plan
        before = point.copy()
        own = {pair: n for n, pair in enumerate(old.plan.pairs)}
        for pair, number in struck.items():
            point[own[pair]] = number
        continuous, later = (differentiated(self.flat_in(values)) for values in modes)
        w = carried_over(plan.pairs, plan.alias, ValuesIn(old, point), continuous, later)
        anew: dict[Pair, float] = {}
        for pair, number in restarted.items():
            sign, kept, order = plan.alias.resolve(*pair)
            anew[kept, order] = sign * number
        place = {pair: n for n, pair in enumerate(plan.pairs)}
        for pair, number in anew.items():
            if pair in place:
                w[place[pair]] = number
        system, w = self._beside(systems, settings, w, time, p)
        if system is None:
            raise _ended(f"at {time:.6g} s no choice of states describes the motion after the event")
        for pair in [] if struck else anew:
            if pair not in system.plan.states:
                name = flat.symbol_name(*pair)
                states = ", ".join(system.states)
                clauses = [(c.where, q) for c in self.events.whens for q, _ in c.reinits]
                raise ModelError(
                    f"'{name}' cannot start anew at {time:.6g} s: it is no state there but follows from {states}; give "
                    f"reinit() one of these, or the force whose impulse does it, reinit(..., impulse=...)",
                    next((where for where, q in clauses if plan.alias.resolve(*q)[1:] == pair), None),
                )
        x, z = system.reduced.from_point(w)
        if z.size:
            z = self._unknowns(system, x, z, time, p)
        at = system.reduced.point(x[None, :], z[None, :], np.array([[time]]), p)[0][0]
        if not np.all(np.isfinite(at)):
            raise _ended(f"at {time:.6g} s the equations have no solution after the event")
        moved = {*restarted, *struck}
        moved |= {pair for pair in continuous if plan.alias.resolve(*pair)[1:] in anew}
        moved |= {pair for pair in continuous if old.plan.alias.resolve(*pair)[1:] in struck}
        self._refuse_jumps(old, before, continuous, system, at, {*anew, *struck}, moved, time)
        return system, x, z

    def _beside(
        self, systems: Systems, settings: IntegratorSettings, w: np.ndarray, time: float, p: np.ndarray
    ) -> tuple[SimulatedSystem | None, np.ndarray]:
        """The system that suits a point after an event, of which `w` has the states, and with the values before it what
        follows from them; and the point that it was chosen at.

        Old values may make the new equations singular, as a denominator that was 0 does, and may give a root the slope
        of its other side: what follows from the states is computed, and roots alone are taken near their old values.
        """
        for sample in (w, *systems.samples):
            if (system := systems.at(sample, time, settings)) is not None and (
                np.all(np.isfinite(point := self._computed(system, w, time, p)))
            ):
                break
        else:
            return systems.at(w, time, settings), w
        if sample is not w and (system := systems.at(point, time, settings)) is None:
            return None, w
        for _ in range(TRIES if any(b.roots for b in system.plan.blocks) else 0):
            point = self._computed(system, w, time, p)
            owner, place = system.plan.flat.scope.owner, {pair: n for n, pair in enumerate(system.plan.pairs)}
            roots = [owner(s) for b in system.plan.blocks if b.roots for s, _ in b.assignments]
            own = [place[pair] for pair in roots if pair in place]
            point[own] = w[own]
            again = systems.at(point, time, settings) if np.all(np.isfinite(point)) else None
            if again is None or again is system:
                break
            system = again
        return system, w

    def _computed(self, system: SimulatedSystem, w: np.ndarray, time: float, p: np.ndarray) -> np.ndarray:
        """A point with what a system computes from its states in w."""
        x, z = system.reduced.from_point(w)
        z = self._unknowns(system, x, z, time, p) if z.size else z
        return system.reduced.point(x[None, :], z[None, :], np.array([[time]]), p)[0][0].copy()

    def struck(
        self, systems: Systems, system: SimulatedSystem, point: np.ndarray, time: float, changes: Changes
    ) -> tuple[dict[Pair, float], dict[str, float]]:
        """Velocities after impulses that give some of them new values, by symbols of the system; and the impulses.

        The equations of the highest derivatives, integrated over the instant: finite forces vanish, velocities change,
        and the equation that keeps a force between impacts is replaced by one of the velocity that is asked for.

        Raises ModelError for a force that no equation of its own keeps, and Ended where masses and constraints admit no
        such change.
        """
        plan, flat = system.plan, self.flat
        matrix = systems.selection.matrix(point, time).copy()
        column = {index: n for n, index in enumerate(plan.structure.unknowns)}
        highest = plan.structure.d
        given = np.zeros(len(matrix))
        value = ValuesIn(system, point)
        forces: dict[str, tuple[int, int]] = {}
        for pair, force in changes.forces.items():
            sign, kept, order = plan.alias.resolve(*pair)
            force_sign, by, force_order = plan.alias.resolve(*force)
            name, force_name = flat.symbol_name(*pair), flat.symbol_name(*force)
            n, k = column.get(kept), column.get(by)
            rows = [] if k is None else np.flatnonzero((matrix[:, k] != 0) & (np.count_nonzero(matrix, axis=1) == 1))
            if n is None or order != highest[n] - 1:
                raise ModelError(f"'{name}' is no velocity: an impulse changes what the model differentiates once more")
            if k is None or force_order or highest[k] or not len(rows):
                raise ModelError(
                    f"'{force_name}' takes no impulse: it needs an equation of its own that holds between impacts, "
                    f"such as {force_name} == 0"
                )
            matrix[rows[0]] = 0.0
            matrix[rows[0], n] = sign
            given[rows[0]] = changes.restarted[pair] - value(pair)
            forces[force_name] = k, force_sign
        try:
            change = np.linalg.solve(matrix, given)
        except np.linalg.LinAlgError:
            change = np.full(len(matrix), np.nan)
        if not np.all(np.isfinite(change)):
            names = ", ".join(forces)
            raise _ended(f"at {time:.6g} s an impulse of {names} cannot give the velocities that are asked for")
        place = {pair: n for n, pair in enumerate(plan.pairs)}
        after = {}
        for index, n in column.items():
            pair = index, int(highest[n]) - 1
            if pair in place:
                after[pair] = float(point[place[pair]] + change[n])
        return after, {name: sign * float(change[k]) for name, (k, sign) in forces.items()}

    def _unknowns(
        self, system: SimulatedSystem, x: np.ndarray, z: np.ndarray, time: float, p: np.ndarray
    ) -> np.ndarray:
        """Newton unknowns after an event: what lies beside the old ones, else by Newton with ever shorter steps."""
        continuation = system.continuation
        assert continuation is not None
        place = continuation.place(x, time, p)
        better = continuation.correct(z, place)
        for _ in range(TRIES):
            if better is not None:
                return better
            step = continuation.step(z, place)
            if step is None or not np.all(np.isfinite(step)):
                break
            z = z + step
            better = continuation.correct(z, place)
        raise _ended(f"at {time:.6g} s Newton finds no solution for {system.reduced.unknowns} after the event")

    def _refuse_jumps(
        self,
        old: SimulatedSystem,
        before: np.ndarray,
        continuous: Sequence[Pair],
        new: SimulatedSystem,
        after: np.ndarray,
        anew: set[Pair],
        moved: set[Pair],
        time: float,
    ) -> None:
        """Raises ModelError for a state that the new equations move although nobody says so: `anew` starts anew by
        symbols of the systems, and `moved` are the names whose values follow from it."""
        value, past = ValuesIn(new, after), ValuesIn(old, before)
        names = names_of(continuous, old.plan.alias)
        highest = dict(zip(old.plan.structure.unknowns, old.plan.structure.d.tolist(), strict=True))
        for state in old.plan.states:
            # a speed follows from one that starts anew; a place does not
            below = state[1] < highest.get(state[0], 0) - 1
            if anew and not (below and all(order > 0 for _, order in anew)):
                continue
            for pair in names.get(state, [state]):
                now, was = value(pair), past(pair)
                nominal = self.flat.variables[state[0]].nominal
                if pair in moved or not np.isfinite(now) or abs(now - was) <= JUMPED * max(nominal, abs(was)):
                    continue
                sign, *kept = new.plan.alias.resolve(*pair)
                one = names_of(continuous, new.plan.alias).get((kept[0], kept[1]), [])
                others = [
                    f" = {'' if new.plan.alias.resolve(*other)[0] == sign else '-'}{self.flat.symbol_name(*other)}"
                    for other in one
                    if other != pair
                ]
                name = "".join([self.flat.symbol_name(*pair), *others])
                raise ModelError(
                    f"at {time:.6g} s the equations after the event want {name} = {now:.6g}, and it is {was:.6g}: a "
                    f"state does not jump by itself; say by gt.reinit what it starts anew from, or switch where both "
                    "agree"
                )

    def sample_times(self, numbers: np.ndarray) -> list[tuple[Fraction, Fraction] | None]:
        """Period and offset of each gt.sample [s]; None for gt.initial."""
        result: list[tuple[Fraction, Fraction] | None] = []
        for s in self.events.samples:
            if s.period is None or s.offset is None:
                result.append(None)
                continue
            column = ca.vertcat(s.period, s.offset)
            period, offset = np.asarray(ca.Function("times", [self.flat.p], [column])(numbers)).reshape(-1).tolist()
            if not (period > 0 and np.isfinite(period) and np.isfinite(offset)):
                raise ModelError(f"sample() has a period of {period:g} s and an offset of {offset:g} s", s.where)
            result.append((exact(period), exact(offset)))
        return result

    @cached_property
    def _outputs_of_blocks(self) -> list[list[int]]:
        return [[place for s in b.outputs for place in s.places] for b in self.events.blocks]

    def sources(self, system: SimulatedSystem, immediate: Sequence[bool]) -> list[set[int]]:
        """Of each block the other blocks whose outputs its inputs depend on at the same instant; `immediate`: whose
        outputs have no delay."""
        reduced, given = system.reduced, self._given
        result: list[set[int]] = []
        for n, block in enumerate(self.events.blocks):
            inputs = ca.vertcat(*[reduced.outputs[k] for k in self.columns_of(block)])
            own: set[int] = set()
            for m, places in enumerate(self._outputs_of_blocks):
                symbols = ca.vertcat(*[given.symbol_of(place) for place in places])
                if m != n and immediate[m] and inputs.numel() and ca.depends_on(inputs, symbols):
                    own.add(m)
            result.append(own)
        return result


def _ended(sentence: str) -> Ended:
    return Ended(SolveStatus.FAILED, sentence)


def _recorded(flat: FlatModel, events: FlatEvents, outputs: tuple[str, ...], pairs: Sequence[Pair]) -> Recorded:
    """Rows of a model with events: discrete variables too, and after the energies' terms what events look at."""
    discrete = {s.name for s in events.shown}
    base = Recorded.of(flat, tuple(name for name in outputs if name not in discrete))
    shown = [s for s in events.shown if (s.name.count(".") <= 1 and not s.helper) or s.name in outputs]
    entries, symbols = list(base.entries), list(base.expressions[: len(base.expressions) - base.terms])
    for s in shown:
        entries += _quantities(s)
        symbols += [flat.parameters[place].symbol for place in s.places]
    watched = [c.expression for c in events.comparisons]
    read = [flat.scope.symbol(*pair) for pair in pairs]
    expressions = [*symbols, *base.expressions[len(base.expressions) - base.terms :], *watched, *read]
    names = ("with events", *outputs)
    return Recorded(names, entries, expressions, base.terms, base.has_energy, len(watched) + len(read))


def _quantities(signal: BlockSignal) -> list[RecordedQuantity]:
    unit = signal.unit or "?"
    if len(signal.shape) > 1:
        names = [f"{signal.name}[{','.join(map(str, k))}]" for k in np.ndindex(*signal.shape)]
        return [RecordedQuantity(n, (), ((place, -1),), unit) for n, place in zip(names, signal.places, strict=True)]
    return [RecordedQuantity(signal.name, signal.shape, tuple((place, -1) for place in signal.places), unit)]


def discrete_starts(flat: FlatModel, start: Mapping[str, Any]) -> tuple[dict[int, float], dict[str, Any]]:
    """Start values of discrete variables by places in `flat.p`, and the other start values.

    Raises ModelError for a value of another shape.
    """
    events = flat.events
    assert events is not None
    own = {s.name: s for s in events.shown}
    values: dict[int, float] = {}
    rest: dict[str, Any] = {}
    for name, value in start.items():
        if name not in own:
            rest[name] = value
            continue
        try:
            array = floats(value)
        except (TypeError, ValueError):
            raise ModelError(f"the start of '{name}' takes numbers; found {value!r}") from None
        if array.shape not in ((), own[name].shape) or not np.all(np.isfinite(array)):
            raise ModelError(f"the start of '{name}' has shape {own[name].shape} and is finite; found {value!r}")
        numbers = np.broadcast_to(array, own[name].shape).reshape(-1).tolist()
        values |= dict(zip(own[name].places, numbers, strict=True))
    return values, rest
