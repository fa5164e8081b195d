"""Which modes follow each other where the events happen in a given order."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ...compiler.analysis.events import acting
from ...compiler.analysis.switching import NamedEvent, in_mode, listing, named_events
from ...compiler.flat import FlatModel
from ...lang.source import ModelError
from .jump import Jump, jump_of
from .rebound import side_after
from .thresholds import Thresholds, Waits, decided

# of a quantity's parts: nearer to zero at the start, its side is round-off
ZERO = 1e-9
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
