"""Which modes follow each other where the events happen in a given order, what happens at the instant between them,
and on which side of a threshold it goes on."""

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
    """assigned: new values of discrete variables by their places in `flat.p`; restarted: of variables' derivatives;
    forces: those of them that an impulse brings about. Discrete variables stand for their values before."""

    assigned: dict[int, ca.SX]
    restarted: dict[Pair, ca.SX]
    forces: dict[Pair, Pair]

    @property
    def moves(self) -> bool:
        """Does anything change at once?"""
        return bool(self.assigned or self.restarted)


def jump_of(
    flat: FlatModel, events: FlatEvents, rounds: Sequence[Sequence[int]], modes: Sequence[Sequence[bool]]
) -> Jump:
    """Of events that act one round after the other at one instant; modes: of gt.If in each round, from then on.

    Raises ModelError for two that set the same, and for one that reads what another one has just restarted.
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
            own = ca.vertcat(*[symbols[place] for place in events.discrete])
            new = ca.vertcat(*[now[place] for place in events.discrete])
            column = ca.substitute(column, ca.vertcat(own, events.before), ca.vertcat(new, new))
        if jump.restarted and flat.scope.symbols_in(column):
            raise ModelError(
                "this event follows from another one at the same instant and reads what that one restarts; join both",
                whens[0].where,
            )
        _take(flat, whens, ca.vertsplit(column) if column.numel() else [], jump)
        now |= jump.assigned
    return jump


def _take(flat: FlatModel, whens: Sequence[FlatWhen], values: Sequence[ca.SX], jump: Jump) -> None:
    """Add what events of one round do."""
    owner: dict[int | Pair, FlatWhen] = {}
    left = list(values)
    for when in whens:
        own, left = left[: len(values_of(when))], left[len(values_of(when)) :]
        for key, value in zip(keys_of(when), own, strict=False):
            taken: dict[int, ca.SX] | dict[Pair, ca.SX] = jump.restarted if isinstance(key, tuple) else jump.assigned
            if key in owner and not ca.is_equal(taken[key], value, 100):  # type: ignore[index]
                name = flat.symbol_name(*key) if isinstance(key, tuple) else flat.parameters[key].name
                raise ModelError(
                    f"{owner[key].name} ({owner[key].where}) and {when.name} both set '{name}' at one instant; let one "
                    "of them decide",
                    when.where,
                )
            owner[key] = when
            taken[key] = value  # type: ignore[index]
        jump.forces.update(when.forces)


# states at which the event could happen; all of them have to agree
PLACES, NEWTON_STEPS = 400, 6
# of the largest value among them: a smaller one has no sign
ZERO = 1e-9


def side_after(
    before: FlatModel, after: FlatModel, numbers: Mapping[int, float | None], quantity: ca.SX, side: int, jump: Jump
) -> int | None:
    """The side on which a quantity goes on that has reached its threshold from the other one, by the equations of both
    modes and what the event changes: 1 or -1; None where it depends on where the event happens.

    It goes on to where it went, unless its value or its rate jumps. numbers: discrete variables before the event, None
    for what the optimisation chooses; side: the one it reaches.
    """
    if not jump.moves:
        return side
    if jump.forces:
        return None
    rate = before.scope.derivative(quantity)
    new_plan, (g_new, rate_new) = _explicit(after, [quantity, rate])
    anew: dict[Pair, ca.SX] = {}
    for pair, value in jump.restarted.items():
        sign, kept, order = new_plan.alias.resolve(*pair)
        anew[kept, order] = sign * value
    states = new_plan.states
    started = [anew.get(pair, before.scope.symbol(*pair)) for pair in states]
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
    drawn = _numbers(before, old_plan, numbers, [*values[:2], *jumped])
    g, slope, value, new_rate = drawn
    happens = np.isfinite(drawn).all(axis=0) & (side * slope > 0)
    if not happens.any():
        return None
    size = float(np.max(np.abs(value[happens])))
    moved = np.abs(value) > np.maximum(ZERO * size, 10 * np.abs(g))
    signs = np.where(moved, np.sign(value), np.where(np.abs(new_rate) > ZERO * np.abs(slope), np.sign(new_rate), 0.0))
    chosen = np.unique(signs[happens])
    return int(chosen[0]) if len(chosen) == 1 and chosen[0] else None


def _explicit(flat: FlatModel, expressions: list[ca.SX]) -> tuple[CausalPlan, list[ca.SX]]:
    """Expressions in states, inputs, parameters and time of a mode."""
    inputs = [v.index for v in flat.variables if v.role == "input"]
    asked = {(v.index, 0) for v in flat.variables} | set(flat.scope.symbols_in(ca.vertcat(*expressions)))
    plan = make_plan(flat, inputs, sorted(asked), rates=True)
    return plan, substituted(plan, plan.alias.rewrite_all(flat, expressions), [])


def _numbers(
    flat: FlatModel, plan: CausalPlan, numbers: Mapping[int, float | None], expressions: list[ca.SX]
) -> np.ndarray:
    """Values (expressions, PLACES) at drawn states where the first of them is zero."""
    states = [flat.scope.symbol(*p) for p in plan.states]
    known = {s.element_hash() for s in [*states, *(q.symbol for q in flat.parameters)]}
    others = [s for s in ca.symvar(ca.vertcat(*expressions)) if s.element_hash() not in known]
    x, u = stacked(states), stacked(others)
    slope = ca.gradient(expressions[0], x) if states else ca.SX(0, 1)
    rng = np.random.default_rng(0)
    p = np.array([_drawn(rng, q.value, q.free) for q in flat.parameters]).reshape(len(flat.parameters), PLACES)
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


def _drawn(rng: np.random.Generator, value: float, free: bool) -> np.ndarray:
    """A parameter's value, a chosen one's about its guess."""
    return value * (rng.uniform(0.5, 1.5, PLACES) if free else np.ones(PLACES))


def _same(a: ca.SX, b: ca.SX) -> bool:
    return bool(ca.is_equal(ca.simplify(a), ca.simplify(b), 100))


ROUNDS = 30


@dataclass(eq=False)
class Piece:
    """What holds between two events.

    modes: values of gt.If. numbers: of discrete variables by their places in `flat.p`, None for those that the
    optimisation finds. sides: of the thresholds that are known; `kept`: those of them that may not be left, as this
    would be an event. waits: of each gt.when, then of each gt.If. ends: the thresholds that are reached at its end, and
    the side that they are reached from the other one. acts: rounds of gt.when that act then; jump: what they change.
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
        """Numbers of gt.when that act at its end."""
        return {n for fired in self.acts for n in fired}


class EventOrder:
    """A flat model with events, and what is known of it while discrete variables and modes change."""

    def __init__(self, flat: FlatModel) -> None:
        assert flat.events is not None
        self.flat, self.events = flat, flat.events
        self.thresholds = Thresholds(flat, flat.events)
        self.named = named_events(flat.events)

    def mode(self, values: Sequence[bool]) -> FlatModel:
        return in_mode(self.flat, values)

    def pieces(self, order: Sequence[Sequence[str]], held: Collection[str] | None) -> list[Piece]:
        """The pieces between the events. Raises ModelError, with the event's line, where this order cannot be."""
        numbers: dict[int, float | None] = {n: self.flat.parameters[n].value for n in self.events.discrete}
        piece = self._piece(numbers, self._at_start(numbers, held), None)
        pieces = [piece]
        for k, names in enumerate(order, 1):
            piece = self._after(piece, [self._event(name) for name in names], k)
            pieces.append(piece)
        return pieces

    def _event(self, name: str) -> NamedEvent:
        if name not in self.named:
            raise ModelError(f"there is no event '{name}' in {self.flat.title}; events are {listing(self.events)}")
        return self.named[name]

    # -- what is known -----------------------------------------------------------------------------

    def _waits(self, numbers: Mapping[int, float | None]) -> tuple[list[Waits | bool], list[Waits | bool]]:
        """What each gt.when and each gt.If waits for while discrete variables have these values."""
        truth = self.thresholds.discrete_truth(numbers)
        whens = [self.thresholds.waits(w.logic, truth, w.where) for w in self.events.whens]
        return whens, [self.thresholds.waits(m.logic, truth, m.where) for m in self.events.modes]

    def _piece(self, numbers: dict[int, float | None], sides: dict[int, int], before: Piece | None) -> Piece:
        """Raises ModelError where the side of a gt.If is not known."""
        waits, mode_waits = self._waits(numbers)
        modes = []
        for mode, own in zip(self.events.modes, mode_waits, strict=True):
            if isinstance(own, Waits) and own.threshold not in sides:
                when = "at the start" if before is None else "after an event"
                remedy = "say it by held=[...]" if before is None else "write the phases yourself as gt.Phases"
                names = [n for n, e in self.named.items() if e.mode is not None and e.logic == mode.logic]
                raise ModelError(
                    f"it is open whether {' and '.join(names)} holds {when}; {remedy}: names of all that hold",
                    mode.where,
                )
            modes.append(own if isinstance(own, bool) else sides[own.threshold] == own.side)
        kept = {t: s for t, s in sides.items() if -s in watched(t, waits, mode_waits)}
        return Piece(tuple(modes), numbers, dict(sides), kept, waits, mode_waits)

    def _at_start(self, numbers: Mapping[int, float | None], held: Collection[str] | None) -> dict[int, int]:
        """Sides of thresholds at the start: of what is fixed there, and of what is said to hold."""
        sides = self._fixed()
        if held is None:
            return sides
        unknown = [name for name in held if name not in self.named]
        if unknown:
            raise ModelError(f"held names no event '{unknown[0]}'; events are {listing(self.events)}")
        waits, mode_waits = self._waits(numbers)
        for name, event in self.named.items():
            own = waits[event.when] if event.when is not None else mode_waits[event.mode or 0]
            holds = name in held
            if isinstance(own, bool):
                contrary = own != holds
            else:
                contrary = sides.setdefault(own.threshold, own.side if holds else -own.side) != (
                    own.side if holds else -own.side
                )
            if contrary:
                word = "does not hold" if holds else "holds"
                raise ModelError(
                    f"held says otherwise, but {event.shown(self.events)} {word} at the start", event.where
                )
        return sides

    def _fixed(self) -> dict[int, int]:
        """Sides of the thresholds that fixed start values and numbers decide on."""
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
        """The piece after events that happen together at the end of phase k."""
        for n, event in enumerate(events):
            if event in events[:n]:
                raise ModelError(
                    f"{event.shown(self.events)} is named twice for the end of phase {k}, where it happens once; name "
                    "it once in this tuple, or as an item of its own for each time that it happens",
                    event.where,
                )
            own = piece.waits[event.when] if event.when is not None else piece.mode_waits[event.mode or 0]
            shown = event.shown(self.events)
            if isinstance(own, bool):
                word = "holds" if own else "does not hold"
                raise ModelError(
                    f"{shown} {word} all through phase {k}, whatever moves, so it does not happen at its end",
                    event.where,
                )
            side = own.side if event.when is not None else -piece.sides[own.threshold]
            if piece.kept.get(own.threshold) == side:
                raise ModelError(
                    f"{shown} holds already in phase {k} and may not cease there without another event, so it does not "
                    "begin to hold at its end",
                    event.where,
                )
            if piece.ends.setdefault(own.threshold, side) != side:
                raise ModelError(f"{shown} and another event of phase {k} exclude each other", event.where)
        truth = self.thresholds.discrete_truth(piece.numbers)
        sides = {t: s for t, s in piece.sides.items() if t in piece.kept}
        was = self.thresholds.sided(truth, sides | {t: -s for t, s in piece.ends.items()})
        now_sides = sides | piece.ends
        held = [decided(w.logic, was) for w in self.events.whens]
        numbers, modes = dict(piece.numbers), list[list[bool]]()
        for _ in range(ROUNDS):
            truth = self.thresholds.sided(self.thresholds.discrete_truth(numbers), now_sides)
            now = [decided(w.logic, truth) for w in self.events.whens]
            became = [n for n, (a, b) in enumerate(zip(held, now, strict=True)) if a is False and b]
            fired = acting(self.events.whens, became)
            if not fired:
                break
            held = now
            piece.acts.append(fired)
            sides = [decided(m.logic, truth) for m in self.events.modes]
            modes.append([old if new is None else new for old, new in zip(piece.modes, sides, strict=True)])
            piece.jump = jump_of(self.flat, self.events, piece.acts, modes)
            numbers = piece.numbers | self._numbers(piece.jump, piece.numbers)
        else:
            raise ModelError(f"the events at the end of phase {k} never settle", events[0].where)
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
        """New values of discrete variables; None where what the optimisation finds decides on them."""
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
    """The sides of a threshold that are an event to reach."""
    both = any(isinstance(w, Waits) and w.threshold == threshold for w in mode_waits)
    return {1, -1} if both else {w.side for w in waits if isinstance(w, Waits) and w.threshold == threshold}
