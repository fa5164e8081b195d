"""Phases of a model with events in a prescribed order, with guesses from a simulation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from ...compiler.analysis.events import FlatEvents, Pair
from ...compiler.analysis.switching import in_mode, listing, with_switching_signs
from ...compiler.flat import FlatModel, FlatParameter
from ...compiler.flat_cache import flattened, with_values
from ...compiler.matrices import stacked
from ...compiler.plan import make_plan
from ...lang.expression import Relation
from ...lang.optimization import Optimization
from ...lang.slips import named
from ...lang.source import ModelError, SourceLocation
from ...results.trajectory import Trajectory
from ..formulation.delays import delays_of
from ..formulation.horizon import ConstraintRow, end_of
from ..linking import Joined, PhaseEnd, value_at_end
from ..phases import Phases
from .happened import doubts_about
from .sequence import EventOrder, Piece
from .whole import phase_root, shares

# limit of the simulated time, relative to the guessed horizon
LONGEST = 3.0


def simulated_pieces(
    model: Optimization,
    flat: FlatModel,
    names: Sequence[str],
    pieces: Sequence[Piece],
    horizon: tuple[float, float],
    conditions: Sequence[ca.SX] = (),
) -> list[dict[str, Trajectory]]:
    """Simulate from start values with guessed inputs; return guesses, each a trajectory by name of the phase.

    There are none if the simulated events differ from the order. conditions: scalars that are 0 at the end. If they
    cross 0 at several instants after the last event (a height on the way up and on the way down), further guesses end
    at each of these.
    """
    from ...simulation.run import simulate

    events = flat.events
    assert events is not None
    begin, end = horizon
    try:
        start = _start(flat, pieces[0])
        until = begin + LONGEST * (end - begin)
        run = simulate(model, until, start_time=begin, inputs=_inputs(flat), start=start, throw=False)
    except ModelError:
        return []
    expected = [_causes(events, a, b) for a, b in pairwise(pieces)]
    whole = run.trajectory
    if [set(e.causes) for e in run.events[: len(expected)]] != expected or len(whole.time) < 2:
        return []
    times = [e.time for e in run.events]
    last = times[len(expected) - 1]
    stop = times[len(expected)] if len(times) > len(expected) else float(whole.time[-1])
    ends = _zeros(flat, _part(whole, (whole.time > last) & (whole.time <= stop)), conditions)
    guesses = []
    for last_time in [end if last < end < stop else stop, *(ends if len(ends) > 1 else [])]:
        edges = [-np.inf, *times[: len(expected)], last_time]
        rows = [(whole.time > a) & (whole.time <= b) for a, b in pairwise(edges)]
        if all(np.count_nonzero(r) > 1 for r in rows):
            guesses.append({name: _part(whole, r) for name, r in zip(names, rows, strict=False)})
    return guesses


def _zeros(flat: FlatModel, run: Trajectory, conditions: Sequence[ca.SX]) -> list[float]:
    """Return the times of rows at which one of the conditions has changed sign."""
    pairs = sorted(flat.scope.symbols_in(stacked(list(conditions))))
    names = [flat.symbol_name(*pair) for pair in pairs]
    if not pairs or any(name not in run for name in names):
        return []
    symbols = stacked([flat.scope.symbol(*pair) for pair in pairs])
    f = ca.Function("conditions", [symbols, flat.scope.time, flat.p], [stacked(list(conditions))])
    rows, values = len(run.time), np.array([run[name] for name in names])
    sides = np.sign(f.map(rows)(values, run.time[None], np.tile(flat.p0[:, None], rows)).full())
    return run.time[1:][np.any(sides[:, 1:] * sides[:, :-1] < 0, axis=0)].tolist()


def _part(whole: Trajectory, rows: np.ndarray) -> Trajectory:
    return Trajectory(
        whole.time[rows], {n: whole[n][rows] for n in whole.names}, {n: whole.unit(n) for n in whole.names}
    )


def _causes(events: FlatEvents, before: Piece, after: Piece) -> set[str]:
    """Return the causes that a simulation reports for the event between two pieces."""
    causes = {f"{events.whens[n].name} ({events.whens[n].where})" for n in before.acted()}
    switched = zip(events.modes, before.modes, after.modes, strict=True)
    return causes | {f"{m.name} ({m.where})" for m, a, b in switched if a != b}


def _inputs(flat: FlatModel) -> dict[str, Any]:
    """Return guesses of the inputs: their start value, else 0, clipped to their bounds."""
    inputs: dict[str, Any] = {}
    for name, (shape, indices) in flat.groups.items():
        entries = [flat.variables[i] for i in indices]
        if entries and entries[0].role == "input":
            values = np.clip([v.start or 0.0 for v in entries], [v.min for v in entries], [v.max for v in entries])
            inputs[name] = values.reshape(shape) if shape else float(values[0])
    return inputs


def _start(flat: FlatModel, piece: Piece) -> dict[str, float]:
    """Return guesses of the start values of states that are not fixed."""
    mode = in_mode(flat, piece.modes)
    inputs = [v.index for v in flat.variables if v.role == "input"]
    plan = make_plan(mode, inputs, [(v.index, 0) for v in flat.variables], rates=True)
    fixed = {plan.alias.resolve(v.index, 0)[1:] for v in flat.variables if v.fixed}
    start: dict[str, float] = {}
    for pair in plan.states:
        if pair in fixed:
            continue
        named = [v for v in flat.variables if plan.alias.resolve(v.index, 0)[1:] == pair and v.start is not None]
        sign = plan.alias.resolve(named[0].index, 0)[0] if named else 1
        start[flat.symbol_name(*pair)] = sign * (named[0].start or 0.0) if named else 0.0
    return start


class EventPhases(Phases):
    """Phases of a model with events in a prescribed order, created by `phases_of_events`."""

    def __init__(
        self, model: Optimization, order: EventOrder, pieces: Sequence[Piece], instants: Sequence[float] | None
    ) -> None:
        self.order, self.pieces, self._model = order, list(pieces), model
        self._simulates = instants is None
        names = [f"phase {k + 1}" for k in range(len(pieces))]
        flat = order.flat
        start, end = (end_of(flat, name) for name in ("start_time", "final_time"))
        self._orders = _registered(flat)
        symbols = [flat.scope.new_parameter(f"instant {k}") for k in range(1, len(pieces))]
        ends, times = [start, *symbols, end], _times(flat, len(symbols), instants)
        phases: dict[str, Optimization] = {}
        parts = shares(flat, [p.modes for p in pieces])
        free = stacked([q.symbol for q in flat.parameters if q.free])
        self._conditions = parts[-1].conditions() if ca.depends_on(end, free) else []
        for k, (name, piece, share) in enumerate(zip(names, pieces, parts, strict=True)):
            guesses = [(s, t) for s, t in zip(symbols, times, strict=True) if any(s is e for e in ends[k : k + 2])]
            phase_flat = self._flat_of(piece, guesses, first=k == 0)
            for t, side in piece.ends.items():
                quantity = self.in_modes(order.thresholds.expressions[t], piece)
                share.rows.append(self._relation(share.at_end(quantity, ends[k + 1]), "==", self._where(k)))
                if t not in piece.kept and (rate := self._kinematic(quantity)) is not None:
                    share.rows.append(self._relation(side * share.at_end(rate, ends[k + 1]), ">=", self._where(k)))
            for pair in self._orders:
                share.at_end(flat.scope.symbol(*pair), ends[k + 1])
            for expression in self._looked_at(piece):
                share.at_end(expression, ends[k + 1])
            root = phase_root(share, ends[k], ends[k + 1], flat)
            root._keep(_flat=replace(phase_flat, tree=replace(phase_flat.tree, root=root), cache={}))
            phases[name] = root
        later = list(zip(names[1:], pieces, strict=False))
        super().__init__(
            phases,
            free={n: [flat.symbol_name(*p) for p in piece.jump.restarted] for n, piece in later if piece.jump},
            links={n: self._link(k) for k, n in enumerate(names[1:])},
            shared=[q.name for q in flat.parameters if q.free],
        )
        self.sides = {n: self._sides(piece) for n, piece in zip(names, pieces, strict=True)}

    def in_modes(self, expression: ca.SX, piece: Piece) -> ca.SX:
        """Insert the values of gt.If in a piece."""
        events = self.order.events
        if not events.modes:
            return expression
        symbols = ca.vertcat(*[m.symbol for m in events.modes])
        return ca.substitute(expression, symbols, ca.DM([float(v) for v in piece.modes]))

    def guesses(self) -> list[dict[str, Trajectory]]:
        """Return guesses from a simulation with guessed inputs; none if its events differ from the order.

        There are several if the simulation meets the end conditions more than once after the last event.
        """
        if not self._simulates:
            return []
        flat = self.order.flat
        horizon = _horizon(flat)
        return simulated_pieces(self._model, flat, list(self.phases), self.pieces, horizon, self._conditions)

    def doubts(self, joined: Joined, x: np.ndarray) -> list[str]:
        return doubts_about(self, joined, x)

    def _where(self, k: int) -> SourceLocation | None:
        """Return the line of the first event at the end of phase k."""
        t = next(iter(self.pieces[k].ends))
        return self.order.events.comparisons[self.order.thresholds.first[t]].where

    def _flat_of(self, piece: Piece, times: Sequence[tuple[ca.SX, float]], first: bool) -> FlatModel:
        """Return the flat model of a piece."""
        flat = self.order.mode(piece.modes)
        flat = with_values(flat, {n: v for n, v in piece.numbers.items() if v is not None})
        optimised = {n for n, v in piece.numbers.items() if v is None}
        parameters = [replace(q, free=True) if n in optimised else q for n, q in enumerate(flat.parameters)]
        where = next(iter(self.order.named.values())).where
        parameters += [FlatParameter(s.name(), s, t, "s", False, where, True) for s, t in times]
        if first:
            return replace(flat, parameters=parameters, cache={})
        variables = [replace(v, fixed=False) for v in flat.variables]
        return replace(flat, parameters=parameters, variables=variables, initial=[], cache={})

    def _relation(self, expression: ca.SX, op: str, where: SourceLocation | None) -> Relation:
        return Relation(expression, ca.SX(0), op, None, where, self.order.flat.scope)  # type: ignore[arg-type]

    def _kinematic(self, quantity: ca.SX) -> ca.SX | None:
        """Return the rate of a quantity that does not depend on inputs, else None."""
        flat = self.order.flat
        inputs = {v.index for v in flat.variables if v.role == "input"}
        pairs = flat.scope.symbols_in(quantity)
        return flat.scope.derivative(quantity) if pairs and not inputs & {i for i, _ in pairs} else None

    def _looked_at(self, piece: Piece) -> list[ca.SX]:
        """Return the expressions needed at the end of a piece by the check and the event's actions."""
        thresholds = self.order.thresholds
        moving = [e for t, e in enumerate(thresholds.expressions) if not thresholds.discrete(t)]
        jump = [*piece.jump.assigned.values(), *piece.jump.restarted.values()] if piece.jump else []
        return [self.in_modes(e, piece) for e in [*moving, *jump] if self.order.flat.scope.symbols_in(e)]

    def _sides(self, piece: Piece) -> tuple[ConstraintRow, ...]:
        """Return rows that keep the sides of thresholds within a piece, except at ends where it is at the threshold."""
        thresholds, rows = self.order.thresholds, []
        for t, side in piece.kept.items():
            text = f"no premature event: {thresholds.text(t)}"
            expression = self.in_modes(side * thresholds.expressions[t], piece)
            where = self.order.events.comparisons[thresholds.first[t]].where
            rows.append(ConstraintRow(expression, 0.0, np.inf, text, where, ends=(False, t not in piece.ends)))
        return tuple(rows)

    def _link(self, k: int) -> Any:
        """Return the link between phase k and the next one."""
        piece, after, flat = self.pieces[k], self.pieces[k + 1], self.order.flat
        jump, where = piece.jump, getattr(flat.root, "where", None)

        def link(before: PhaseEnd, then: PhaseEnd) -> Iterable[Relation]:
            relations = []
            restarted = jump.restarted if jump else {}
            assigned = jump.assigned if jump else {}
            for pair, value in restarted.items():
                new, old = value_at_end(then, flat.scope.symbol(*pair)), value_at_end(before, value)
                relations.append(self._relation(new - old, "==", self._where(k)))
            for place, number in after.numbers.items():
                if number is None:
                    symbol = flat.parameters[place].symbol
                    new, old = value_at_end(then, symbol), value_at_end(before, assigned.get(place, symbol))
                    relations.append(self._relation(new - old, "==", where))
            return relations

        return link


def _registered(flat: FlatModel) -> list[Pair]:
    """Return derivatives that may be states in some mode."""
    highest: dict[int, int] = {}
    for i, k in flat.scope.symbols_in(ca.vertcat(*[e.residual for e in flat.equations])):
        highest[i] = max(highest.get(i, 0), k)
    return [(i, k) for i, top in highest.items() for k in range(1, top)]


@named
def phases_of_events(
    model: Optimization,
    order: Iterable[str | Iterable[str]],
    *,
    held: Iterable[str] | None = None,
    instants: Iterable[float] | None = None,
) -> EventPhases:
    """Split an optimisation with events, in a prescribed order, into phases for `gt.solve_phases`.

    Args:
        model: a configured Optimization with `gt.when` or `gt.If` in its equations.
        order: names of the events in order: "event 1" for the first gt.when, "If 1" for a switch of the first gt.If,
            "part.event 1" in a part, "sign() 1" for a sign() that switches exactly; simultaneous events as a tuple.
            The error for a wrong name lists all names with their lines.
        held: names of all conditions that hold at the start. By default fixed start values decide; if they do not, the
            start of a gt.when is undetermined, and that of a gt.If must be listed here.
        instants: guesses of the instants [s]. By default a simulation with guessed inputs provides them, and a guess of
            the motion, if its events come in this order; else they are evenly spaced. If the simulation meets the
            conditions of a free end several times (on the way up and on the way down), each is used as a start.

    Phase k, named "phase k", has the equations of its mode. It ends at event k, whose instant is optimised. Links to
    the next phase apply the event's actions (`gt.reinit`, new values of discrete variables); all other states are
    continuous. Integrals in the objective and path constraints apply to all phases, values at an end to the phase
    there. Free constants are shared.

    No other event may happen. Constraints keep conditions that do not hold from becoming true within a phase, and the
    solution is also checked between its points: if another event happens or touches its threshold, or a prescribed one
    does not happen, the status is CHECK_FAILED and the message names it. A solved result is therefore a local optimum
    among the motions with this order of events; after several starts the message says how many ended there.

    Raises ModelError for an impossible order, for conditions on several continuous quantities, impulses, sampled blocks
    and delays, and for objectives or constraints that couple several phases and are not sums.

    >>> class Throw(gt.Optimization):  # a ball, to be in 3 m distance at 0.2 m height after one bounce
    ...     h = gt.variable(unit="m", start=1.0, fixed=True)
    ...     d = gt.variable(unit="m", start=0.0, fixed=True)
    ...     v = gt.variable(unit="m/s", start=0.0)
    ...     speed = gt.free(1.0, unit="m/s")
    ...     final_time = gt.free(1.0, min=0.1, unit="s")
    ...     def equations(self):
    ...         yield gt.der(self.h) == self.v
    ...         yield gt.der(self.v) == -9.81
    ...         yield gt.der(self.d) == self.speed
    ...         yield gt.when(self.h <= 0.0, gt.reinit(self.v, -0.8 * self.v))
    ...     def objective(self):  # square of the speed of the throw
    ...         return self.v.at(self.start_time) ** 2 + self.speed**2
    ...     def constraints(self):
    ...         yield self.d.at(self.final_time) == 3.0
    ...         yield self.h.at(self.final_time) == 0.2
    >>> throw = gt.solve_phases(gt.phases_of_events(Throw(), ["event 1"]), gt.Mesh(3))
    >>> throw.status.ok, round(throw.objective, 3), round(float(throw["phase 1"].trajectory.time[-1]), 3)
    (True, 6.746, 0.536)
    """
    if not isinstance(model, Optimization):
        raise ModelError(f"gt.phases_of_events takes a configured Optimization; found {model!r}")
    names: list[Any] = list(order) if isinstance(order, Iterable) and not isinstance(order, str) else [order]
    groups = [list(item) if isinstance(item, (list, tuple)) else [item] for item in names]
    flat = flattened(model)
    if any("sign()" in str(name) for group in groups for name in group):
        flat = with_switching_signs(flat)
    events = flat.events
    if events is None:
        raise ModelError(f"{flat.title} has no events; use gt.solve")
    if events.blocks or events.samples:
        what = "a sampled block" if events.blocks else "gt.sample() or gt.initial()"
        where = events.samples[0].where if events.samples else getattr(events.blocks[0].model, "where", None)
        raise ModelError(
            f"{flat.title} has {what}, which phases do not support; optimise the continuous model and test the result "
            "with gt.simulate",
            where,
        )
    if delayed := [flat.variables[i].name for i in delays_of(flat)]:
        raise ModelError(f"'{delayed[0]}' is a delayed input, which would span several phases; use gt.Phases directly")
    if not groups or not all(groups) or not all(isinstance(n, str) for g in groups for n in g):
        raise ModelError(
            f"order must be a non-empty list of event names, simultaneous events as a tuple; found {order!r}; "
            f"events are {listing(events)}"
        )
    if isinstance(held, str):
        raise ModelError(f"held takes a list of names; found '{held}'")
    sequence = EventOrder(flat)
    pieces = sequence.pieces(groups, None if held is None else list(held))
    for piece in pieces:
        if ends := [events.whens[n] for n in sorted(piece.acted()) if events.whens[n].end is not None]:
            raise ModelError(
                f"{ends[0].name} ends the motion, so no phase can follow; write it as a constraint at the final time",
                ends[0].where,
            )
        if piece.jump is not None and piece.jump.forces:
            acting = events.whens[piece.acts[0][0]]
            raise ModelError(
                f"{acting.name} acts by a force impulse, which phases do not support; write gt.reinit() for each "
                "velocity that changes, without impulse=...",
                acting.where,
            )
    return EventPhases(model, sequence, pieces, None if instants is None else list(instants))


def _times(flat: FlatModel, count: int, instants: Sequence[float] | None) -> list[float]:
    """Return the guessed instants of the events, by default evenly spaced over the guessed horizon."""
    start, end = _horizon(flat)
    if instants is None:
        return np.linspace(start, end, count + 2)[1:-1].tolist()
    times = [float(t) for t in instants]
    if len(times) != count or not np.all(np.diff([start, *times, end]) > 0):
        raise ModelError(
            f"instants must be {count} increasing times between {start:g} and {end:g} s, one guess per event; found "
            f"{times}"
        )
    return times


def _horizon(flat: FlatModel) -> tuple[float, float]:
    """Return start and end of the horizon at the guess of the free constants."""
    ends = [end_of(flat, name) for name in ("start_time", "final_time")]
    start, end = ca.Function("ends", [flat.p], ends)(flat.p0)
    return float(start), float(end)
