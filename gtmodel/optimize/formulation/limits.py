"""Bounds of variables, and rows along the path, at instants and at the start."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from ...lang.source import ModelError, SourceLocation
from .builder import ProblemBuilder
from .dynamic import Bounds
from .horizon import ConstraintRow, Horizon, Pair, PointValue, as_bound, declared_name

# tolerance, relative to the row's scale, for constraints on values fixed at the start: as in IPOPT
START_SLACK = 1e-6


@dataclass(eq=False)
class TrajectoryBounds:
    """Bounds of states, inputs, and of states at both ends; rows along the path and at instants, in original names."""

    x: Bounds
    u: Bounds
    start: Bounds
    end: Bounds
    path: list[ConstraintRow] = field(default_factory=list)
    points: list[ConstraintRow] = field(default_factory=list)


def limits_of(
    builder: ProblemBuilder, constraints: list[ConstraintRow], instants: list[PointValue], apart: Collection[int]
) -> TrajectoryBounds:
    """Collect declared bounds and constraints; a constraint becomes a bound of a variable if possible, else a row.

    apart: variables whose fixed start is handled elsewhere. Raises ModelError for a fixed start of a non-state.
    """
    b, flat = builder, builder.flat
    position = {p: n for n, p in enumerate(b.states)}
    place = dict(b.control_symbols) | {p: (b.given.numel() + n, 1) for n, p in enumerate(b.z_pairs)}
    n = len(b.states)
    bounds = TrajectoryBounds(Bounds.free(n), Bounds.free(b.u.numel()), Bounds.free(n), Bounds.free(n))

    def bounded(pair: Pair, low: float, high: float, origin: str = "") -> bool:
        if pair in position:
            bounds.x.tighten(position[pair], low, high, origin)
        elif pair in place:
            n, sign = place[pair]
            bounds.u.tighten(n, *((low, high) if sign > 0 else (-high, -low)), origin)
        return pair in position or pair in place

    for v in flat.variables:
        if np.isnan(v.min) or np.isnan(v.max):
            raise ModelError(
                f"{flat.title}: {'min' if np.isnan(v.min) else 'max'} of '{v.name}' is not a number", v.where
            )
        if not (np.isfinite(v.min) or np.isfinite(v.max)):
            continue
        sign, kept, order = b.plan.alias.resolve(v.index, 0)
        if not bounded((kept, order), *((v.min, v.max) if sign > 0 else (-v.max, -v.min))):
            symbol, nominal = flat.scope.symbol(v.index, 0), b.nominal((v.index, 0))
            bounds.path.append(ConstraintRow(symbol, v.min, v.max, f"bounds of {v.name}", v.where, nominal))
    constant = {q.symbol.element_hash() for q in flat.parameters}
    of_instants = {s.element_hash() for i in flat.scope.instants for s in ca.vertsplit(ca.vec(i.symbol))}
    for row in constraints:
        inside = {s.element_hash() for s in ca.symvar(row.expression)}
        if inside & of_instants or inside <= constant:
            if not _end_bound(b, row, instants, position, bounds.start, bounds.end):
                bounds.points.append(row)
            continue
        # a bound of a variable applies at both ends
        rewritten = b.plan.alias.rewrite(flat, row.expression)
        bound = as_bound(rewritten, row, flat, b.parameters) if all(row.ends) else None
        if bound is not None and np.any(np.isnan(bound[1:])):
            raise ModelError(f"{flat.title}: the bound of {row.label} is not a number", row.where)
        if bound is None or not bounded(*bound, row.label):
            bounds.path.append(row)
    _initial(b, position, bounds.start, apart)
    return bounds


def _end_bound(
    b: ProblemBuilder,
    row: ConstraintRow,
    instants: list[PointValue],
    position: dict[Pair, int],
    start: Bounds,
    end: Bounds,
) -> bool:
    """Turn a point constraint on one state at one end into a bound; return whether that was possible."""
    constant = {q.symbol.element_hash() for q in b.flat.parameters}
    unknowns = [s for s in ca.symvar(row.expression) if s.element_hash() not in constant]
    if len(unknowns) != 1:
        return False
    value = next((i for i in instants if i.symbol.element_hash() == unknowns[0].element_hash()), None)
    if value is None or value.s not in (0.0, 1.0):
        return False
    chain = b.plan.alias.rewrite(b.flat, value.expression)
    inner = ca.substitute([row.expression], [unknowns[0]], [chain])[0]
    bound = as_bound(inner, row, b.flat, b.parameters)
    if bound is None or bound[0] not in position:
        return False
    (start if value.s == 0.0 else end).tighten(position[bound[0]], bound[1], bound[2], row.label)
    return True


def _initial(b: ProblemBuilder, position: dict[Pair, int], start: Bounds, apart: Collection[int]) -> None:
    """Turn fixed start attributes into initial conditions, except for the variables `apart`."""
    for v in b.flat.variables:
        if not v.fixed or v.start is None or v.index in apart:
            continue
        sign, kept, order = b.plan.alias.resolve(v.index, 0)
        if (kept, order) not in position:
            raise ModelError(
                f"'{v.name}' has a fixed start but is not a state; states are "
                f"{', '.join(b.flat.symbol_name(*p) for p in b.states)}",
                v.where,
            )
        origin = f"the fixed start of '{v.name}' ({v.where})"
        start.tighten(position[(kept, order)], sign * v.start, sign * v.start, origin)


def check_bounds(b: ProblemBuilder, x: Bounds, u: Bounds, P: Bounds, start: Bounds, end: Bounds) -> None:
    states = [declared_name(b.flat, b.plan.alias, p) for p in b.states]
    controls = [(b.flat.symbol_name(*p), b.flat.variables[p[0]].where) for p in b.input_pairs]
    free = [(q.name, q.where) for q in b.flat.parameters if q.free]
    groups: list[tuple[str, list[tuple[str, SourceLocation]], tuple[Bounds, ...]]] = [
        ("", states, (x,)), ("", controls, (u,)), ("", free, (P,)),
        (" at the start", states, (x, start)), (" at the end", states, (x, end)),
    ]  # fmt: skip
    for place, names, bounds in groups:
        for n, (name, where) in enumerate(names):
            low, high = max(c.low[n] for c in bounds), min(c.high[n] for c in bounds)
            if low > high:
                by = " and ".join(dict.fromkeys(o for c in bounds for o in c.origins.get(n, ())))
                raise ModelError(
                    f"{b.flat.title}: the bounds of '{name}' contradict each other{place}: at least {low:g} and at "
                    f"most {high:g}{f', from {by}' if by else ''}",
                    where,
                )


def bounded_end(b: ProblemBuilder, ends: Horizon, shortest: float, P: Bounds) -> bool:
    """Impose a shortest length as a bound of one end, if that is a free constant and the other end a number."""
    for end, opposite, sign in ((ends.tf, ends.t0, 1.0), (ends.t0, ends.tf, -1.0)):
        if end.is_symbolic() and opposite.is_constant():
            n = [s.element_hash() for s in ca.vertsplit(b.P)].index(end.element_hash())
            limit = float(opposite) + sign * shortest
            P.tighten(n, *((limit, np.inf) if sign > 0 else (-np.inf, limit)))
            return True
    return False


def rows_at_start(
    b: ProblemBuilder,
    written: list[ConstraintRow],
    path: list[ConstraintRow],
    x: Bounds,
    u: Bounds,
    start: Bounds,
    t0: ca.SX,
) -> list[tuple[PointValue, ConstraintRow]]:
    """Return the path rows in states, constants and time at the start of the horizon, which is no collocation point.

    Raises ModelError if fixed start values violate one.
    """
    rows = list(path)
    if b.kind == "dae":
        # the unknowns that are free at each point follow from the states
        offset = b.given.numel()
        for n, pair in enumerate(b.z_pairs):
            low, high = float(u.low[offset + n]), float(u.high[offset + n])
            if np.isfinite(low) or np.isfinite(high):
                name, size = b.flat.symbol_name(*pair), b.nominal(pair)
                row = ConstraintRow(b.flat.scope.symbol(*pair), low, high, f"bounds of {name}", None, size)
                written, rows = [*written, row], [*rows, row]
        if rows:
            expressions = b.other().express([r.expression for r in written])
            rows = [replace(r, expression=e) for r, e in zip(rows, expressions, strict=True)]
    low, high = np.maximum(x.low, start.low), np.minimum(x.high, start.high)
    states = {s.element_hash(): n for n, s in enumerate(ca.vertsplit(b.x))}
    constants = {s.element_hash(): n for n, s in enumerate(ca.vertsplit(b.P))}
    time = b.flat.scope.time.element_hash()
    result = []
    for row in rows:
        keys = {s.element_hash() for s in ca.symvar(row.expression)}
        if not row.ends[0] or not keys & set(states) or not keys <= {*states, *constants, time}:
            continue
        fixed = all(low[states[k]] == high[states[k]] for k in keys if k in states)
        bounds, label = (row.low, row.high), f"at the start: {row.label}"
        optimised = keys & set(constants) or (time in keys and not t0.is_constant())
        if fixed and not optimised:
            start_value = ca.substitute([row.expression], [ca.vertcat(b.x, b.flat.scope.time)],
                               [ca.vertcat(ca.SX(np.where(np.isfinite(low), low, 0.0)), t0)])[0]  # fmt: skip
            value = float(start_value)
            miss = max(row.low - value, value - row.high)
            if miss > START_SLACK * row.scale:
                raise ModelError(
                    f"{b.flat.title}: the fixed start values violate '{row.label}' by {miss:g}; change the "
                    "start values or the constraint",
                    row.where,
                )
            continue
        free = any(constants[k] < b.n_free for k in keys if k in constants) or any(
            s.element_hash() in constants and constants[s.element_hash()] < b.n_free for s in ca.symvar(t0)
        )
        if fixed and not free and row.low == row.high:
            # an equation without a free unknown would make the problem overdetermined
            bounds = (row.low - START_SLACK * row.scale, row.high + START_SLACK * row.scale)
        symbol = ca.SX.sym(f"start{len(result)}")
        point = ConstraintRow(symbol, *bounds, label, row.where, row.scale)
        result.append((PointValue(symbol, row.expression, 0.0), point))
    return result
