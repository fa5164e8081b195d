"""Guesses of each phase by a simulation with events."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from ...compiler.analysis.events import FlatEvents
from ...compiler.analysis.switching import in_mode
from ...compiler.flat import FlatModel
from ...compiler.matrices import stacked
from ...compiler.plan import make_plan
from ...lang.optimization import Optimization
from ...lang.source import ModelError
from ...results.trajectory import Trajectory
from .sequence import Piece

# of the guessed horizon: so long is simulated until all events have happened
LONGEST = 3.0


def simulated_pieces(
    model: Optimization,
    flat: FlatModel,
    names: Sequence[str],
    pieces: Sequence[Piece],
    horizon: tuple[float, float],
    conditions: Sequence[ca.SX] = (),
) -> list[dict[str, Trajectory]]:
    """By the names of the phases, the pieces of a simulation from start values under guessed inputs; none where its
    events are others, or in another order.

    conditions: scalars that are 0 at the end. If they become 0 at several instants after the last event, as a height is
    reached on the way up and on the way down, then further guesses end at each of these.
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
    wanted = [_causes(events, a, b) for a, b in pairwise(pieces)]
    whole = run.trajectory
    if [set(e.causes) for e in run.events[: len(wanted)]] != wanted or len(whole.time) < 2:
        return []
    times = [e.time for e in run.events]
    last = times[len(wanted) - 1]
    stop = times[len(wanted)] if len(times) > len(wanted) else float(whole.time[-1])
    ends = _zeros(flat, _part(whole, (whole.time > last) & (whole.time <= stop)), conditions)
    made = []
    for one in [end if last < end < stop else stop, *(ends if len(ends) > 1 else [])]:
        edges = [-np.inf, *times[: len(wanted)], one]
        rows = [(whole.time > a) & (whole.time <= b) for a, b in pairwise(edges)]
        if all(np.count_nonzero(r) > 1 for r in rows):
            made.append({name: _part(whole, r) for name, r in zip(names, rows, strict=False)})
    return made


def _zeros(flat: FlatModel, run: Trajectory, conditions: Sequence[ca.SX]) -> list[float]:
    """First rows at which one of the conditions has another sign than in the row before."""
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
    """What a simulation says of the event between two pieces."""
    causes = {f"{events.whens[n].name} ({events.whens[n].where})" for n in before.acted()}
    switched = zip(events.modes, before.modes, after.modes, strict=True)
    return causes | {f"{m.name} ({m.where})" for m, a, b in switched if a != b}


def _inputs(flat: FlatModel) -> dict[str, Any]:
    """Guessed values of the inputs: their start, else 0, within their bounds."""
    given: dict[str, Any] = {}
    for name, (shape, indices) in flat.groups.items():
        own = [flat.variables[i] for i in indices]
        if own and own[0].role == "input":
            values = np.clip([v.start or 0.0 for v in own], [v.min for v in own], [v.max for v in own])
            given[name] = values.reshape(shape) if shape else float(values[0])
    return given


def _start(flat: FlatModel, piece: Piece) -> dict[str, float]:
    """Guessed start values of the states that no attribute fixes."""
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
