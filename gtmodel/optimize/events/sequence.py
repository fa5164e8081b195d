"""The sequence of modes for a prescribed order of events, the jumps between them, and the sides of thresholds after."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ...compiler.analysis.events import FlatEvents, FlatWhen, Pair, acting
from ...compiler.analysis.switching import (
    NamedEvent,
    acting_together,
    in_mode,
    keys_of,
    listing,
    named_events,
    values_of,
)
from ...compiler.emission import substituted
from ...compiler.flat import FlatModel
from ...compiler.matrices import stacked
from ...compiler.plan import CausalPlan, make_plan
from ...lang.source import ModelError
from .thresholds import Thresholds, Waits, decided


@dataclass(frozen=True, eq=False)
class Jump:
    """Changes at an event; discrete variables in the expressions have their values before it.

    assigned: new values of discrete variables by index in `flat.p`; restarted: new values of variables or derivatives;
    forces: those changed by an impulse.
    """

    assigned: dict[int, ca.SX]
    restarted: dict[Pair, ca.SX]
    forces: dict[Pair, Pair]

    @property
    def moves(self) -> bool:
        """Whether the event changes anything."""
        return bool(self.assigned or self.restarted)


def jump_of(
    flat: FlatModel, events: FlatEvents, rounds: Sequence[Sequence[int]], modes: Sequence[Sequence[bool]]
) -> Jump:
    """Return the jump of events that act in successive rounds at one instant; modes: of gt.If from each round on.

    Raises ModelError if two events set the same variable, or one reads a variable that another has just restarted.
    """
    symbols = {place: flat.parameters[place].symbol for place in events.discrete}
    now: dict[int, ca.SX] = dict(symbols)
    jump = Jump({}, {}, {})
    for fired, sides in zip(rounds, modes, strict=True):
        whens = [events.whens[n] for n in fired]
        column = ca.SX(acting_together(flat, whens))
        if events.modes:
            numbers = ca.DM([float(v) for v in sides])
            column = ca.substitute(column, ca.vertcat(*[m.symbol for m in events.modes]), numbers)
        if events.discrete:
            discrete = ca.vertcat(*[symbols[place] for place in events.discrete])
            new = ca.vertcat(*[now[place] for place in events.discrete])
            column = ca.substitute(column, ca.vertcat(discrete, events.before), ca.vertcat(new, new))
        if jump.restarted and flat.scope.symbols_in(column):
            raise ModelError(
                "this event follows another one at the same instant and reads a variable it restarts; combine both",
                whens[0].where,
            )
        _take(flat, whens, ca.vertsplit(column) if column.numel() else [], jump)
        now |= jump.assigned
    return jump


def _take(flat: FlatModel, whens: Sequence[FlatWhen], values: Sequence[ca.SX], jump: Jump) -> None:
    """Add the actions of the events of one round."""
    owner: dict[int | Pair, FlatWhen] = {}
    remaining = list(values)
    for when in whens:
        when_values, remaining = remaining[: len(values_of(when))], remaining[len(values_of(when)) :]
        for key, value in zip(keys_of(when), when_values, strict=False):
            changes: dict[int, ca.SX] | dict[Pair, ca.SX] = jump.restarted if isinstance(key, tuple) else jump.assigned
            if key in owner and not ca.is_equal(changes[key], value, 100):  # type: ignore[index]
                name = flat.symbol_name(*key) if isinstance(key, tuple) else flat.parameters[key].name
                raise ModelError(
                    f"{owner[key].name} ({owner[key].where}) and {when.name} both set '{name}' at one instant; let one "
                    "of them decide",
                    when.where,
                )
            owner[key] = when
            changes[key] = value  # type: ignore[index]
        jump.forces.update(when.forces)


# random states at which the event could happen; all of them must agree
PLACES, NEWTON_STEPS = 400, 6
# relative to the largest value: smaller values count as zero
ZERO = 1e-9


def side_after(
    before: FlatModel, after: FlatModel, numbers: Mapping[int, float | None], quantity: ca.SX, side: int, jump: Jump
) -> int | None:
    """Return the side (1 or -1) of a quantity after it has crossed its threshold and the event has acted.

    The quantity stays on the side it crossed to, unless its value or rate jumps; the equations of both modes decide.
    None if the side depends on the state at the event. numbers: discrete variables before the event, None for optimised
    ones; side: the side that the quantity crosses to.
    """
    if not jump.moves:
        return side
    if jump.forces:
        return None
    rate = before.scope.derivative(quantity)
    new_plan, (g_new, rate_new) = _explicit(after, [quantity, rate])
    restarted: dict[Pair, ca.SX] = {}
    for pair, value in jump.restarted.items():
        sign, kept, order = new_plan.alias.resolve(*pair)
        restarted[kept, order] = sign * value
    states = new_plan.states
    started = [restarted.get(pair, before.scope.symbol(*pair)) for pair in states]
    old_plan, values = _explicit(before, [quantity, rate, *started])
    if old_plan.newton or new_plan.newton:
        return None
    old = [before.scope.symbol(*p) for p in states] + [before.parameters[place].symbol for place in jump.assigned]
    new = [*values[2:], *[ca.SX(value) for value in jump.assigned.values()]]
    jumped = ca.substitute([g_new, rate_new], [stacked(old)], [stacked(new)]) if old else [g_new, rate_new]
    if _same(jumped[0], values[0]) and _same(jumped[1], values[1]):
        return side
    # inputs may jump at the event
    inputs = [before.scope.symbol(*p) for p in new_plan.inputs if p not in states]
    if inputs:
        others = [ca.SX.sym(f"input{n}") for n in range(len(inputs))]
        changed = ca.substitute([g_new, rate_new], [stacked(inputs)], [stacked(others)])
        jumped = ca.substitute(changed, [stacked(old)], [stacked(new)]) if old else changed
    samples = _numbers(before, old_plan, numbers, [*values[:2], *jumped])
    g, slope, value, new_rate = samples
    happens = np.isfinite(samples).all(axis=0) & (side * slope > 0)
    if not happens.any():
        return None
    size = float(np.max(np.abs(value[happens])))
    nonzero = np.abs(value) > np.maximum(ZERO * size, 10 * np.abs(g))
    signs = np.where(nonzero, np.sign(value), np.where(np.abs(new_rate) > ZERO * np.abs(slope), np.sign(new_rate), 0.0))
    sides = np.unique(signs[happens])
    return int(sides[0]) if len(sides) == 1 and sides[0] else None


def _explicit(flat: FlatModel, expressions: list[ca.SX]) -> tuple[CausalPlan, list[ca.SX]]:
    """Express quantities in states, inputs, parameters and time of a mode; return the plan too."""
    inputs = [v.index for v in flat.variables if v.role == "input"]
    pairs = {(v.index, 0) for v in flat.variables} | set(flat.scope.symbols_in(ca.vertcat(*expressions)))
    plan = make_plan(flat, inputs, sorted(pairs), rates=True)
    return plan, substituted(plan, plan.alias.rewrite_all(flat, expressions), [])


def _numbers(
    flat: FlatModel, plan: CausalPlan, numbers: Mapping[int, float | None], expressions: list[ca.SX]
) -> np.ndarray:
    """Return values (expressions, PLACES) at random states where the first expression is zero."""
    states = [flat.scope.symbol(*p) for p in plan.states]
    known = {s.element_hash() for s in [*states, *(q.symbol for q in flat.parameters)]}
    others = [s for s in ca.symvar(ca.vertcat(*expressions)) if s.element_hash() not in known]
    x, u = stacked(states), stacked(others)
    slope = ca.gradient(expressions[0], x) if states else ca.SX(0, 1)
    rng = np.random.default_rng(0)
    p = np.array([_samples(rng, q.value, q.free) for q in flat.parameters]).reshape(len(flat.parameters), PLACES)
    for place, number in numbers.items():
        p[place] = rng.normal(size=PLACES) if number is None else number
    start = np.array([flat.variables[i].start or 0.0 if k == 0 else 0.0 for i, k in plan.states])
    nominal = np.array([flat.variables[i].nominal for i, _ in plan.states])
    xs = start[:, None] + nominal[:, None] * 3.0 * rng.normal(size=(len(states), PLACES))
    us = np.array([3.0 * rng.normal(size=PLACES) for _ in others]).reshape(len(others), PLACES)
    f = ca.Function("places", [x, u, flat.p], [ca.densify(ca.vertcat(*expressions)), ca.densify(slope)]).map(PLACES)
    for _ in range(NEWTON_STEPS):
        values, normal = (np.asarray(v.full()) for v in f(xs, us, p))
        length = np.sum(normal**2, axis=0)
        xs = xs - np.where(length > 0, values[0] / np.where(length > 0, length, 1.0), 0.0) * normal
    return np.asarray(f(xs, us, p)[0].full())


def _samples(rng: np.random.Generator, value: float, free: bool) -> np.ndarray:
    """Return samples of a parameter: its value, or random values around the guess of a free one."""
    return value * (rng.uniform(0.5, 1.5, PLACES) if free else np.ones(PLACES))


def _same(a: ca.SX, b: ca.SX) -> bool:
    return bool(ca.is_equal(ca.simplify(a), ca.simplify(b), 100))


ROUNDS = 30


@dataclass(eq=False)
class Piece:
    """The model between two events.

    modes: values of gt.If. numbers: values of discrete variables by index in `flat.p`, None for optimised ones.
    sides: known sides of thresholds; kept: those that must not be left, since leaving them would be an event. waits,
    mode_waits: of each gt.when and each gt.If. ends: the thresholds crossed at the end, each with the side it
    reaches. acts: rounds of gt.when that act at the end; jump: their changes.
    """

    modes: tuple[bool, ...]
    numbers: dict[int, float | None]
    sides: dict[int, int]
    kept: dict[int, int]
    waits: list[Waits | bool]
    mode_waits: list[Waits | bool]
    ends: dict[int, int] = field(default_factory=dict)
    acts: list[list[int]] = field(default_factory=list)
    jump: Jump | None = None

    def acted(self) -> set[int]:
        """Return the numbers of the gt.when that act at the end."""
        return {n for fired in self.acts for n in fired}


class EventOrder:
    """Derives the pieces between events of a flat model from an order of events."""

    def __init__(self, flat: FlatModel) -> None:
        assert flat.events is not None
        self.flat, self.events = flat, flat.events
        self.thresholds = Thresholds(flat, flat.events)
        self.named = named_events(flat.events)

    def mode(self, values: Sequence[bool]) -> FlatModel:
        return in_mode(self.flat, values)

    def pieces(self, order: Sequence[Sequence[str]], held: Collection[str] | None) -> list[Piece]:
        """Return the pieces between the events. Raises ModelError, with the event's line, for an impossible order."""
        numbers: dict[int, float | None] = {n: self.flat.parameters[n].value for n in self.events.discrete}
        piece = self._piece(numbers, self._at_start(numbers, held), None)
        pieces = [piece]
        for k, names in enumerate(order, 1):
            piece = self._after(piece, [self._event(name) for name in names], k)
            pieces.append(piece)
        return pieces

    def _event(self, name: str) -> NamedEvent:
        if name not in self.named:
            raise ModelError(f"{self.flat.title} has no event '{name}'; events are {listing(self.events)}")
        return self.named[name]

    # -- sides and modes ---------------------------------------------------------------------------

    def _waits(self, numbers: Mapping[int, float | None]) -> tuple[list[Waits | bool], list[Waits | bool]]:
        """Return the conditions of each gt.when and each gt.If for these values of discrete variables."""
        truth = self.thresholds.discrete_truth(numbers)
        whens = [self.thresholds.waits(w.logic, truth, w.where) for w in self.events.whens]
        return whens, [self.thresholds.waits(m.logic, truth, m.where) for m in self.events.modes]

    def _piece(self, numbers: dict[int, float | None], sides: dict[int, int], before: Piece | None) -> Piece:
        """Build a piece. Raises ModelError if the side of a gt.If is unknown."""
        waits, mode_waits = self._waits(numbers)
        modes = []
        for mode, condition in zip(self.events.modes, mode_waits, strict=True):
            if isinstance(condition, Waits) and condition.threshold not in sides:
                when = "at the start" if before is None else "after an event"
                remedy = "list all conditions that hold in held=[...]" if before is None else "use gt.Phases directly"
                names = [n for n, e in self.named.items() if e.mode is not None and e.logic == mode.logic]
                raise ModelError(
                    f"it is not determined whether {' and '.join(names)} holds {when}; {remedy}",
                    mode.where,
                )
            modes.append(condition if isinstance(condition, bool) else sides[condition.threshold] == condition.side)
        kept = {t: s for t, s in sides.items() if -s in watched(t, waits, mode_waits)}
        return Piece(tuple(modes), numbers, dict(sides), kept, waits, mode_waits)

    def _at_start(self, numbers: Mapping[int, float | None], held: Collection[str] | None) -> dict[int, int]:
        """Return the sides of thresholds at the start, from fixed values and from `held`."""
        sides = self._fixed()
        if held is None:
            return sides
        unknown = [name for name in held if name not in self.named]
        if unknown:
            raise ModelError(f"held contains the unknown event '{unknown[0]}'; events are {listing(self.events)}")
        waits, mode_waits = self._waits(numbers)
        for name, event in self.named.items():
            condition = waits[event.when] if event.when is not None else mode_waits[event.mode or 0]
            holds = name in held
            if isinstance(condition, bool):
                contradicts = condition != holds
            else:
                contradicts = sides.setdefault(condition.threshold, condition.side if holds else -condition.side) != (
                    condition.side if holds else -condition.side
                )
            if contradicts:
                word = "does not hold" if holds else "holds"
                raise ModelError(f"held is inconsistent: {event.shown(self.events)} {word} at the start", event.where)
        return sides

    def _fixed(self) -> dict[int, int]:
        """Return the sides of thresholds that follow from fixed start values and numbers."""
        flat = self.flat
        known: dict[int, tuple[ca.SX, float]] = {}
        for v in flat.variables:
            if v.fixed and v.start is not None and v.role != "input":
                s = flat.scope.symbol(v.index, 0)
                known[s.element_hash()] = s, v.start
        for q in flat.parameters:
            if not q.free:
                known[q.symbol.element_hash()] = q.symbol, q.value
        start = getattr(flat.root, "start_time", 0.0)
        if isinstance(start, (int, float)):
            known[flat.scope.time.element_hash()] = flat.scope.time, float(start)
        sides: dict[int, int] = {}
        for t, expression in enumerate(self.thresholds.expressions):
            symbols = ca.symvar(expression)
            if self.thresholds.discrete(t) or any(s.element_hash() not in known for s in symbols):
                continue
            column, numbers = ca.vertcat(*symbols), np.array([known[s.element_hash()][1] for s in symbols])
            f = ca.Function("start", [column], [expression, ca.densify(ca.gradient(expression, column))])
            value, slope = f(numbers)
            parts = float(np.abs(np.asarray(slope.full()).reshape(-1)) @ np.abs(numbers))
            if abs(float(value)) > ZERO * max(parts, ZERO):
                sides[t] = 1 if float(value) > 0 else -1
        return sides

    # -- from one piece to the next ----------------------------------------------------------------

    def _after(self, piece: Piece, events: Sequence[NamedEvent], k: int) -> Piece:
        """Return the piece after events that happen together at the end of phase k."""
        for n, event in enumerate(events):
            if event in events[:n]:
                raise ModelError(
                    f"{event.shown(self.events)} is named twice at the end of phase {k}; name it once in this tuple, "
                    "or as a separate item each time it happens",
                    event.where,
                )
            condition = piece.waits[event.when] if event.when is not None else piece.mode_waits[event.mode or 0]
            event_text = event.shown(self.events)
            if isinstance(condition, bool):
                word = "holds" if condition else "does not hold"
                raise ModelError(
                    f"{event_text} {word} throughout phase {k}, whatever the motion, so it cannot happen at its end",
                    event.where,
                )
            side = condition.side if event.when is not None else -piece.sides[condition.threshold]
            if piece.kept.get(condition.threshold) == side:
                raise ModelError(
                    f"{event_text} already holds in phase {k} and cannot end there without another event, so it cannot "
                    "happen at its end",
                    event.where,
                )
            if piece.ends.setdefault(condition.threshold, side) != side:
                raise ModelError(f"{event_text} and another event of phase {k} exclude each other", event.where)
        truth = self.thresholds.discrete_truth(piece.numbers)
        sides = {t: s for t, s in piece.sides.items() if t in piece.kept}
        truth_before = self.thresholds.sided(truth, sides | {t: -s for t, s in piece.ends.items()})
        now_sides = sides | piece.ends
        holds = [decided(w.logic, truth_before) for w in self.events.whens]
        numbers, modes = dict(piece.numbers), list[list[bool]]()
        for _ in range(ROUNDS):
            truth = self.thresholds.sided(self.thresholds.discrete_truth(numbers), now_sides)
            holds_now = [decided(w.logic, truth) for w in self.events.whens]
            risen = [n for n, (a, b) in enumerate(zip(holds, holds_now, strict=True)) if a is False and b]
            fired = acting(self.events.whens, risen)
            if not fired:
                break
            holds = holds_now
            piece.acts.append(fired)
            sides = [decided(m.logic, truth) for m in self.events.modes]
            modes.append([old if new is None else new for old, new in zip(piece.modes, sides, strict=True)])
            piece.jump = jump_of(self.flat, self.events, piece.acts, modes)
            numbers = piece.numbers | self._numbers(piece.jump, piece.numbers)
        else:
            raise ModelError(f"the events at the end of phase {k} trigger each other without end", events[0].where)
        for t, side in piece.ends.items():
            after = self._side_after(piece, numbers, now_sides, t, side)
            if after is None:
                del now_sides[t]
            else:
                now_sides[t] = after
        return self._piece(numbers, now_sides, piece)

    def _side_after(
        self, piece: Piece, numbers: dict[int, float | None], sides: dict[int, int], threshold: int, side: int
    ) -> int | None:
        if piece.jump is None:
            return side
        after = self._piece(numbers, sides, piece)
        quantity = self.thresholds.expressions[threshold]
        if self.events.modes:
            symbols = ca.vertcat(*[m.symbol for m in self.events.modes])
            quantity = ca.substitute(quantity, symbols, ca.DM([float(v) for v in piece.modes]))
        before, then = self.mode(piece.modes), self.mode(after.modes)
        return side_after(before, then, piece.numbers, quantity, side, piece.jump)

    def _numbers(self, jump: Jump, before: Mapping[int, float | None]) -> dict[int, float | None]:
        """Return new values of discrete variables; None if they depend on optimised quantities."""
        flat = self.flat
        known = {q.symbol.element_hash(): q.value for q in flat.parameters if not q.free}
        for place, number in before.items():
            key = flat.parameters[place].symbol.element_hash()
            known.pop(key, None)
            if number is not None:
                known[key] = number
        result: dict[int, float | None] = {}
        for place, value in jump.assigned.items():
            symbols = ca.symvar(value)
            if all(s.element_hash() in known for s in symbols):
                column = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
                f = ca.Function("value", [column], [value])
                result[place] = float(f([known[s.element_hash()] for s in symbols]))
            else:
                result[place] = None
        return result


def watched(threshold: int, waits: Sequence[Waits | bool], mode_waits: Sequence[Waits | bool]) -> set[int]:
    """Return the sides of a threshold whose reaching is an event."""
    both = any(isinstance(w, Waits) and w.threshold == threshold for w in mode_waits)
    return {1, -1} if both else {w.side for w in waits if isinstance(w, Waits) and w.threshold == threshold}
