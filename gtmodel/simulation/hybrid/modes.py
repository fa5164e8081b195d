"""The modes of a model with events: an ordinary simulation for each, prepared when the mode first occurs."""

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
from ..record import Recorded, RecordedQuantity, Recorder, Wanted
from ..reduced import Watched
from ..systems import IntegratorSettings, SimulatedSystem, Systems
from .actions import Changes, ValuesIn, carried_over, read_by
from .clock import exact

Pair = tuple[int, int]
# attempts to find modes that are consistent with the start
TRIES = 20
# comparisons that are zero at the start, of which both sides are tried
MOST_UNDECIDED = 8
# relative to the compared values and to nominals of states: closer to zero, a comparison's sign is round-off
ZERO = 1e-12
ROUND_OFF = 8 * np.finfo(float).eps
# in nominals: a state that changes more at a change of modes has jumped
JUMPED = 1e-6


@dataclass(frozen=True, eq=False)
class ReadyInMode:
    """A simulation with events before its first step: the values of the modes, and the truth values of the comparisons
    and of the conditions of gt.when."""

    ready: Ready
    values: tuple[bool, ...]
    truth: np.ndarray
    held: np.ndarray


class SimulatedModes:
    """A model with events in one run. `flat` has the values at its start. Actions and blocks read `pairs`, which are in
    `read_columns` of a row; comparisons are in the columns from `first_comparison` on."""

    def __init__(
        self, flat: FlatModel, now: FlatModel, inputs: SimulationInputs, wanted: Wanted, prefer: Sequence[int]
    ) -> None:
        assert flat.events is not None
        self._compiled, self.flat, self.events = flat, now, flat.events
        self._inputs, self._wanted, self._prefer = inputs, wanted, prefer
        self.pairs = read_by(self.events, flat)
        self.recorded = _recorded(flat, self.events, wanted, self.pairs)
        self.has_energy = bool(flat.energies)
        self.first_comparison = len(self.recorded.expressions) - self.recorded.extra
        first = self.first_comparison + len(self.events.comparisons)
        self.read_columns = slice(first, first + len(self.pairs))
        self._place = {pair: first + n for n, pair in enumerate(self.pairs)}
        self._discrete = np.array([c.discrete for c in self.events.comparisons], dtype=bool)
        self._strict = np.array([c.strict for c in self.events.comparisons], dtype=bool)
        self.at_equality = ~self._strict  # truth of each comparison if both of its sides are equal
        self._flats: dict[tuple[bool, ...], FlatModel] = flat.cache.setdefault("modes", {})

    def columns_of(self, block: FlatBlock) -> list[int]:
        """Return the columns of a block's inputs in a row, in order."""
        return [self._place[i, 0] for s in block.inputs for i in s.places]

    def flat_in(self, values: tuple[bool, ...]) -> FlatModel:
        """Return the model in these modes; cached."""
        if values not in self._flats:
            self._flats[values] = in_mode(self._compiled, values)
        return self._flats[values]

    def systems(self, values: tuple[bool, ...]) -> Systems:
        """Return the systems in these modes, with the present values."""
        flat = self.flat_in(values)
        return Systems.kept(flat, self._inputs, self.recorded_in(values), self._prefer, self._numbered(flat))

    def _numbered(self, flat: FlatModel) -> FlatModel:
        return with_values(flat, self._inputs.parameters)

    def recorded_in(self, values: tuple[bool, ...]) -> Recorded:
        """Return the columns of a row in these modes."""
        cache = self.flat_in(values).cache
        key = "recorded with events", self._wanted
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
        """Return how fast functions of time change in these modes, including those in comparisons."""
        last = self.first_comparison + len(self.events.comparisons)
        watched = ca.SX(ca.vertcat(*self.recorded_in(values).expressions[self.first_comparison : last]))
        return systems.pace(inputs, start, end, watched, self.events.discrete)

    # -- start -------------------------------------------------------------------------------------

    def start(
        self, start: Mapping[str, Any], start_time: float, settings: IntegratorSettings, end: float
    ) -> ReadyInMode:
        """Return a start in modes that are consistent with it.

        Raises ModelError if there is none.
        """
        guess, undecided = self._guess(start, start_time)
        refused: ModelError | None = None
        # comparisons that are zero at the start may be on either side
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
        friction = ", as if friction would stick" if any(m.name == "sign()" for m in self.events.modes) else ""
        wheres = ", ".join(dict.fromkeys(f"{m.name} at {m.where}" for m in self.events.modes))
        raise ModelError(
            f"{self.flat.title}: no side of {wheres} is consistent with the start: each leads to the other{friction}; "
            "give another start, or add a mode in between (gt.discrete)"
        )

    def _settled(
        self, truth: np.ndarray, start: Mapping[str, Any], start_time: float, settings: IntegratorSettings, end: float
    ) -> ReadyInMode | None:
        """Return a start in consistent modes, searched from these truth values; None if there is none."""
        visited: list[tuple[bool, ...]] = []
        for _ in range(TRIES):
            values = tuple(holds(m.logic, truth) for m in self.events.modes)
            flat = self.flat_in(values)
            ready = prepare_in(
                flat, self._numbered(flat), self._inputs, self.recorded_in(values), Recorder(self.recorded), start,
                start_time, self._prefer, settings,
            )  # fmt: skip
            truth = self._truth(ready, start_time, end, truth)
            again = tuple(holds(m.logic, truth) for m in self.events.modes)
            if again == values:
                held = np.array([holds(w.logic, truth) for w in self.events.whens], dtype=bool)
                return ReadyInMode(ready, values, truth, held)
            visited.append(values)
            if again in visited:
                break
        return None

    def _guess(self, start: Mapping[str, Any], time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the truth of the comparisons at the declared start values, and the indices of those that are zero."""
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
        known = [p for p in pairs if p[0] in set(self._inputs.known)]
        values |= dict(zip(known, self._inputs.values(known, time), strict=True)) if known else {}
        arguments = {pair: values.get(pair, 0.0) for pair in pairs}
        prescribed = {(i, order) for name in start for _, indices, order in [flat.lookup(name)] for i in indices}
        exact = prescribed | {(v.index, 0) for v in flat.variables if v.fixed} | set(known)
        compared, zero = self._compared(arguments, exact, time)
        at_zero = np.where(self._strict, compared > 0, compared >= 0)
        truth = self.sides(compared, np.zeros_like(compared), 0.0, 0.0, at_zero)
        return truth, np.flatnonzero(~self._discrete & (np.abs(compared) <= zero))

    def _compared(
        self, arguments: Mapping[Pair, float], exact: Container[Pair], time: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the values of the comparisons, and the values below which their signs are round-off: of the arguments,
        and of the nominals of arguments that are not `exact`."""
        numbers = np.array(list(arguments.values()))
        nominals = np.array([self.flat.variables[i].nominal for i, _ in arguments])
        exact_ = np.array([pair in exact for pair in arguments], dtype=bool)
        errors = np.maximum(ZERO * np.abs(numbers), np.where(exact_, ROUND_OFF, ZERO) * nominals)
        modes = np.ones(len(self.events.modes))
        results = self._with_derivatives(tuple(arguments))(numbers, self.flat.p0, time, modes)
        values, by_x, by_p, by_time = (np.abs(np.asarray(m.full())) if n else m.full() for n, m in enumerate(results))
        zero = by_x @ errors + ZERO * (by_p @ np.abs(self.flat.p0) + by_time[:, 0] * abs(time))
        return values.reshape(-1), np.nan_to_num(zero)

    def _with_derivatives(self, pairs: tuple[Pair, ...]) -> ca.Function:
        """Return the comparisons with their derivatives by the variables that they read, parameters and time."""
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
        """Return the truth of the comparisons at a start, from their values, or from their rates at zero."""
        if not self.events.comparisons:
            return np.zeros(0, dtype=bool)
        watched, plan = self.watched(ready.system), ready.system.plan
        x, z = ready.system.reduced.from_point(ready.initial.w)
        values, rates = watched(x[None, :], z[None, :], np.array([time]), ready.inputs.piece(time))
        column = ca.vertcat(*[c.expression for c in self.events.comparisons])
        value = ValuesIn(ready.system, ready.initial.w)
        arguments = {pair: value(pair) for pair in self.flat.scope.symbols_in(column)}
        states = {pair for pair in arguments if plan.alias.resolve(*pair)[1:] in plan.states}
        _, zero = self._compared(arguments, states, time)
        return self.sides(values[0], rates[0], zero, zero / (end - time), before)

    def watched(self, system: SimulatedSystem) -> Watched:
        """Return the comparisons of a system with their rates."""
        last = self.first_comparison + len(self.events.comparisons)
        return Watched(system.reduced, system.reduced.outputs[self.first_comparison : last])

    def sides(self, values: np.ndarray, rates: np.ndarray, zero: Any, slow: Any, before: np.ndarray) -> np.ndarray:
        """Return the truth of the comparisons from now on: from their values, from their rates if the values are within
        `zero`, and as `before` if the rates are within `slow` too; comparisons of discrete variables are exact."""
        truth = np.where(np.abs(values) > zero, values > 0, np.where(np.abs(rates) > slow, rates > 0, before))
        return np.where(self._discrete, np.where(self._strict, values > 0, values >= 0), truth)

    # -- during the run ----------------------------------------------------------------------------

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
        """Return a system for the modes of `systems`, with states and Newton unknowns, from a point of the old system;
        `modes` are the mode values before and after.

        States continue, except reinitialised ones and those changed by an impulse: `struck` has their values by symbols
        of the old system. Raises ModelError if another state would jump, and Ended if the new equations have no
        solution there.
        """
        flat, plan = systems.flat, systems.plan
        before = point.copy()
        old_places = {pair: n for n, pair in enumerate(old.plan.pairs)}
        for pair, number in struck.items():
            point[old_places[pair]] = number
        continuous, later = (differentiated(self.flat_in(values)) for values in modes)
        w = carried_over(plan.pairs, plan.alias, ValuesIn(old, point), continuous, later)
        reset: dict[Pair, float] = {}
        for pair, number in restarted.items():
            sign, index, order = plan.alias.resolve(*pair)
            reset[index, order] = sign * number
        place = {pair: n for n, pair in enumerate(plan.pairs)}
        for pair, number in reset.items():
            if pair in place:
                w[place[pair]] = number
        system, w = self._system_after(systems, settings, w, time, p)
        if system is None:
            raise _ended(f"at {time:.6g} s no choice of states is valid after the event")
        for pair in [] if struck else reset:
            if pair not in system.plan.states:
                name = flat.symbol_name(*pair)
                states = ", ".join(system.states)
                clauses = [(c.where, q) for c in self.events.whens for q, _ in c.reinits]
                raise ModelError(
                    f"'{name}' cannot be reinitialised at {time:.6g} s: it is not a state there but follows from "
                    f"{states}; reinit() one of these, or name the impulsive force, reinit(..., impulse=...)",
                    next((where for where, q in clauses if plan.alias.resolve(*q)[1:] == pair), None),
                )
        x, z = system.reduced.from_point(w)
        if z.size:
            z = self._unknowns(system, x, z, time, p)
        after = system.reduced.point(x[None, :], z[None, :], np.array([[time]]), p)[0][0]
        if not np.all(np.isfinite(after)):
            raise _ended(f"at {time:.6g} s the equations have no solution after the event")
        moved = {*restarted, *struck}
        moved |= {pair for pair in continuous if plan.alias.resolve(*pair)[1:] in reset}
        moved |= {pair for pair in continuous if old.plan.alias.resolve(*pair)[1:] in struck}
        self._refuse_jumps(old, before, continuous, system, after, {*reset, *struck}, moved, time)
        return system, x, z

    def _system_after(
        self, systems: Systems, settings: IntegratorSettings, w: np.ndarray, time: float, p: np.ndarray
    ) -> tuple[SimulatedSystem | None, np.ndarray]:
        """Return the system for a point after an event, and this point. `w` has the states after the event, and the
        other values from before it.

        The old values may make the new equations singular, for example by a denominator of 0, and may select the wrong
        root. Therefore the other values are computed from the states, and only roots are selected by the old values.
        """
        for sample in (w, *systems.samples):
            if (system := systems.at(sample, time, settings)) is not None and (
                np.all(np.isfinite(point := self._computed(system, w, time, p)))
            ):
                break
        else:
            return systems.at(w, time, settings), w
        if sample is not w:
            system = systems.at(point, time, settings)
        if system is None:
            return None, w
        for _ in range(TRIES if any(b.roots for b in system.plan.blocks) else 0):
            point = self._computed(system, w, time, p)
            owner, place = system.plan.flat.scope.owner, {pair: n for n, pair in enumerate(system.plan.pairs)}
            roots = [owner(s) for b in system.plan.blocks if b.roots for s, _ in b.assignments]
            places = [place[pair] for pair in roots if pair in place]
            point[places] = w[places]
            again = systems.at(point, time, settings) if np.all(np.isfinite(point)) else None
            if again is None or again is system:
                break
            system = again
        return system, w

    def _computed(self, system: SimulatedSystem, w: np.ndarray, time: float, p: np.ndarray) -> np.ndarray:
        """Return the point that a system computes from its states in w."""
        x, z = system.reduced.from_point(w)
        z = self._unknowns(system, x, z, time, p) if z.size else z
        return system.reduced.point(x[None, :], z[None, :], np.array([[time]]), p)[0][0].copy()

    def struck(
        self, systems: Systems, system: SimulatedSystem, point: np.ndarray, time: float, changes: Changes
    ) -> tuple[dict[Pair, float], dict[str, float]]:
        """Return the velocities after impulses that set some of them, by symbols of the system; and the impulses.

        The equations of the highest derivatives are integrated over the instant: finite forces vanish, velocities
        change, and the equation that determines the impulsive force between impacts is replaced by one for the required
        velocity.

        Raises ModelError for a force without an equation of its own, and Ended if masses and constraints do not allow
        the change.
        """
        plan, flat = system.plan, self.flat
        matrix = systems.selection.matrix(point, time).copy()
        column = {index: n for n, index in enumerate(plan.structure.unknowns)}
        highest = plan.structure.d
        required = np.zeros(len(matrix))
        value = ValuesIn(system, point)
        forces: dict[str, tuple[int, int]] = {}
        for pair, force in changes.forces.items():
            sign, index, order = plan.alias.resolve(*pair)
            force_sign, force_index, force_order = plan.alias.resolve(*force)
            name, force_name = flat.symbol_name(*pair), flat.symbol_name(*force)
            n, k = column.get(index), column.get(force_index)
            rows = [] if k is None else np.flatnonzero((matrix[:, k] != 0) & (np.count_nonzero(matrix, axis=1) == 1))
            if n is None or order != highest[n] - 1:
                raise ModelError(f"'{name}' is not a velocity; an impulse sets the derivative just below the highest")
            if k is None or force_order or highest[k] or not len(rows):
                raise ModelError(
                    f"'{force_name}' cannot have an impulse: it needs its own equation between impacts, such as "
                    f"{force_name} == 0"
                )
            matrix[rows[0]] = 0.0
            matrix[rows[0], n] = sign
            required[rows[0]] = changes.restarted[pair] - value(pair)
            forces[force_name] = k, force_sign
        try:
            change = np.linalg.solve(matrix, required)
        except np.linalg.LinAlgError:
            change = np.full(len(matrix), np.nan)
        if not np.all(np.isfinite(change)):
            names = ", ".join(forces)
            raise _ended(f"at {time:.6g} s no impulse of {names} gives the required velocities")
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
        """Return the Newton unknowns after an event: a solution close to the old one, else by limited Newton steps."""
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
        reset: set[Pair],
        moved: set[Pair],
        time: float,
    ) -> None:
        """Raises ModelError for a state that jumps without reinit(): `reset` are the reinitialised symbols of the
        systems, and `moved` the names whose values follow from them."""
        value, past = ValuesIn(new, after), ValuesIn(old, before)
        names = names_of(continuous, old.plan.alias)
        highest = dict(zip(old.plan.structure.unknowns, old.plan.structure.d.tolist(), strict=True))
        for state in old.plan.states:
            # velocities may follow from a reinitialised one; positions may not
            below = state[1] < highest.get(state[0], 0) - 1
            if reset and not (below and all(order > 0 for _, order in reset)):
                continue
            for pair in names.get(state, [state]):
                x, x0 = value(pair), past(pair)
                nominal = self.flat.variables[state[0]].nominal
                if pair in moved or not np.isfinite(x) or abs(x - x0) <= JUMPED * max(nominal, abs(x0)):
                    continue
                sign, index, order = new.plan.alias.resolve(*pair)
                aliases = names_of(continuous, new.plan.alias).get((index, order), [])
                others = [
                    f" = {'' if new.plan.alias.resolve(*alias)[0] == sign else '-'}{self.flat.symbol_name(*alias)}"
                    for alias in aliases
                    if alias != pair
                ]
                name = "".join([self.flat.symbol_name(*pair), *others])
                raise ModelError(
                    f"at {time:.6g} s the equations after the event require {name} = {x:.6g}, but it is {x0:.6g}: a "
                    "state does not jump by itself; give its new value with gt.reinit, or switch where both agree"
                )

    def sample_times(self, numbers: np.ndarray) -> list[tuple[Fraction, Fraction] | None]:
        """Return period and offset of each gt.sample [s]; None for gt.initial."""
        result: list[tuple[Fraction, Fraction] | None] = []
        for s in self.events.samples:
            if s.period is None or s.offset is None:
                result.append(None)
                continue
            column = ca.vertcat(s.period, s.offset)
            period, offset = np.asarray(ca.Function("times", [self.flat.p], [column])(numbers)).reshape(-1).tolist()
            if not (period > 0 and np.isfinite(period) and np.isfinite(offset)):
                raise ModelError(f"sample() takes a period above 0; found {period:g} s, offset {offset:g} s", s.where)
            result.append((exact(period), exact(offset)))
        return result

    @cached_property
    def _outputs_of_blocks(self) -> list[list[int]]:
        return [[place for s in b.outputs for place in s.places] for b in self.events.blocks]

    def sources(self, system: SimulatedSystem, immediate: Sequence[bool]) -> list[set[int]]:
        """Return for each block the other blocks whose outputs affect its inputs at the same instant; `immediate`: for
        each block, whether its outputs have no delay."""
        reduced = system.reduced
        result: list[set[int]] = []
        for n, block in enumerate(self.events.blocks):
            inputs = ca.vertcat(*[reduced.outputs[k] for k in self.columns_of(block)])
            sources: set[int] = set()
            for m, places in enumerate(self._outputs_of_blocks):
                symbols = ca.vertcat(*[self._inputs.symbol_of(place) for place in places])
                if m != n and immediate[m] and inputs.numel() and ca.depends_on(inputs, symbols):
                    sources.add(m)
            result.append(sources)
        return result


def _ended(sentence: str) -> Ended:
    return Ended(SolveStatus.FAILED, sentence)


def _recorded(flat: FlatModel, events: FlatEvents, wanted: Wanted, pairs: Sequence[Pair]) -> Recorded:
    """Return the columns of a row: also discrete variables, and after the energy terms the quantities for events."""
    discrete = {s.name for s in events.shown}
    base = Recorded.of(flat, replace(wanted, names=tuple(name for name in wanted.names if name not in discrete)))
    always = [s.name for s in events.shown if s.name.count(".") <= 1 and not s.helper and not wanted.only]
    shown = [s for s in events.shown if s.name in {*always, *wanted.names}]
    entries, symbols = list(base.entries), list(base.expressions[: len(base.expressions) - base.terms])
    for s in shown:
        entries += _quantities(s)
        symbols += [flat.parameters[place].symbol for place in s.places]
    watched = [c.expression for c in events.comparisons]
    read = [flat.scope.symbol(*pair) for pair in pairs]
    expressions = [*symbols, *base.expressions[len(base.expressions) - base.terms :], *watched, *read]
    return Recorded(
        ("with events", wanted), entries, expressions, base.terms, base.has_energy, len(watched) + len(read)
    )


def _quantities(signal: BlockSignal) -> list[RecordedQuantity]:
    unit = signal.unit or "?"
    if len(signal.shape) > 1:
        names = [f"{signal.name}[{','.join(map(str, k))}]" for k in np.ndindex(*signal.shape)]
        return [RecordedQuantity(n, (), ((place, -1),), unit) for n, place in zip(names, signal.places, strict=True)]
    return [RecordedQuantity(signal.name, signal.shape, tuple((place, -1) for place in signal.places), unit)]


def discrete_starts(flat: FlatModel, start: Mapping[str, Any]) -> tuple[dict[int, float], dict[str, Any]]:
    """Return the start values of discrete variables by place in `flat.p`, and the other start values.

    Raises ModelError for a value of the wrong shape.
    """
    events = flat.events
    assert events is not None
    signals = {s.name: s for s in events.shown}
    values: dict[int, float] = {}
    rest: dict[str, Any] = {}
    for name, value in start.items():
        if name not in signals:
            rest[name] = value
            continue
        try:
            array = floats(value)
        except (TypeError, ValueError):
            raise ModelError(f"the start of '{name}' takes numbers; found {value!r}") from None
        if array.shape not in ((), signals[name].shape) or not np.all(np.isfinite(array)):
            raise ModelError(
                f"'{name}' has shape {signals[name].shape}: its start takes finite numbers; found {value!r}"
            )
        numbers = np.broadcast_to(array, signals[name].shape).reshape(-1).tolist()
        values |= dict(zip(signals[name].places, numbers, strict=True))
    return values, rest
