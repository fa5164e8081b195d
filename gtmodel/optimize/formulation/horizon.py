"""The horizon and its instants, constraints as rows low <= expression <= high, and attributes of symbols."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...compiler.alias import AliasResult
from ...compiler.flat import FlatModel
from ...lang.connect import flatten_items
from ...lang.expression import Expr, Relation
from ...lang.scope import Instant, derivative_name
from ...lang.slips import each_of, line_of
from ...lang.source import ModelError, SourceLocation

Pair = tuple[int, int]
HIGHEST = 2  # highest derivative under whose name a guess may contain a state


def names_of(flat: FlatModel, alias: AliasResult, pair: Pair) -> list[tuple[str, int]]:
    """Return all (name, sign) with name == sign * symbol; the symbol's own name first."""
    own_name = flat.symbol_name(*pair)
    return [(own_name, 1)] + [(n, sign) for n, sign in _by_symbol(flat, alias).get(pair, []) if n != own_name]


def declared_name(flat: FlatModel, alias: AliasResult, pair: Pair) -> tuple[str, SourceLocation]:
    """Return the name of a variable that equals a state, else one such as "der(x)", and the line of the declaration."""
    equal = {name for name, sign in names_of(flat, alias, pair) if sign > 0}
    own = flat.variables[pair[0]]
    variable = next((v for v in (own, *flat.variables) if v.name in equal), own)
    name = variable.name if variable.name in equal else flat.symbol_name(*pair)
    return name, variable.where


def _by_symbol(flat: FlatModel, alias: AliasResult) -> dict[Pair, list[tuple[str, int]]]:
    """Return names and signs of all variables and their derivatives by kept variable; cached with alias."""
    cached = alias.names
    if cached is None or cached[0] is not flat or cached[1] != len(alias.removed):
        names: dict[Pair, list[tuple[str, int]]] = {}
        for v in flat.variables:
            for k in range(HIGHEST + 1):
                sign, kept, order = alias.resolve(v.index, k)
                names.setdefault((kept, order), []).append((derivative_name(v.name, k), sign))
        cached = alias.names = flat, len(alias.removed), names
    return cached[2]


def nominal_of(flat: FlatModel, alias: AliasResult, pair: Pair) -> float:
    """Return the nominal of the symbol or of an alias; a derivative without one takes its variable's."""
    nominal = flat.variables[pair[0]].nominal
    declared = [v.nominal for v in flat.variables if v.nominal != 1.0 and alias.resolve(v.index, 0)[1:] == pair]
    if pair[1] == 0 and nominal != 1.0:
        return nominal
    return declared[0] if declared else nominal


def start_of(flat: FlatModel, alias: AliasResult, pair: Pair) -> float:
    """Return the start value of the symbol or of an alias; 0 if none is declared."""
    start = flat.variables[pair[0]].start
    if pair[1] == 0 and start is not None:
        return start
    for v in flat.variables:
        sign, kept, order = alias.resolve(v.index, 0)
        if (kept, order) == pair and v.start is not None:
            return sign * v.start
    return 0.0


@dataclass(eq=False)
class ConstraintRow:
    """One scalar constraint with its label and source line; the solver gets it divided by `scale`.

    ends: whether a path constraint also holds at the start, and at the end, of the horizon.
    """

    expression: ca.SX
    low: float
    high: float
    label: str
    where: SourceLocation | None
    scale: float = 1.0
    ends: tuple[bool, bool] = (True, True)


def relations(source: Iterable[Any] | None, flat: FlatModel) -> list[ConstraintRow]:
    """Return the rows of constraints(). Raises ModelError if it yields anything but relations."""
    line = line_of(getattr(type(flat.root), "constraints", None))
    if source is None:
        raise ModelError(
            f"constraints() of {flat.title} returned nothing; expected 'yield' in front of each relation", line
        )
    if not isinstance(source, Iterable):
        raise ModelError(
            f"constraints() of {flat.title} returned one {type(source).__name__}; expected 'yield' in front of each "
            "relation",
            line,
        )
    return relation_rows(source, f"{flat.title}.constraints()", written=line)


def relation_rows(
    source: Iterable[Any], title: str, word: str = "constraint", *, written: SourceLocation | None = None
) -> list[ConstraintRow]:
    """Return the rows of relations. Raises ModelError for anything else."""
    rows: list[ConstraintRow] = []
    for count, item in enumerate(flatten_items(list(each_of(source, title))), 1):
        if not isinstance(item, Relation):
            raise ModelError(
                f"{title} yielded {type(item).__name__}; expected a relation with '==', '<=', '>=' or gt.between",
                written,
            )
        low, high = {"==": (0.0, 0.0), "<=": (-np.inf, 0.0), ">=": (0.0, np.inf)}[item.op]
        residual = item.residual
        for k in range(residual.numel()):
            if not ca.symvar(residual[k]):
                raise ModelError(f"a {word} contains no variable: {residual[k]} {item.op} 0", item.where)
            suffix = f"[{k}]" if residual.numel() > 1 else ""
            rows.append(ConstraintRow(residual[k], low, high, f"{word} {count}{suffix} ({item.where})", item.where))
    return rows


def as_bound(
    e: ca.SX, row: ConstraintRow, flat: FlatModel, parameters: ca.SX
) -> tuple[tuple[int, int], float, float] | None:
    """Return (variable and derivative order, low, high) of a row a*s + b with numeric a and b, else None."""
    if flat.parameters:
        e = ca.substitute([e], [flat.p], [parameters])[0]
    symbols = ca.symvar(e)
    if len(symbols) != 1:
        return None
    pair = flat.scope.owner(symbols[0])
    slope = ca.gradient(e, symbols[0])
    if pair is None or not slope.is_constant() or float(slope) == 0.0:
        return None
    a = float(slope)
    b = float(ca.substitute([e], [symbols[0]], [ca.SX(0)])[0])
    ends = sorted([(row.low - b) / a, (row.high - b) / a])
    return pair, ends[0], ends[1]


ROUND_OFF = 1e-12  # of times on a horizon of length 1
# lower bound, relative to the guess, of a free horizon without bounds: avoids division by zero. A solution at this
# bound has failed
SHORTEST = 1e-3


@dataclass(eq=False)
class PointValue:
    """An expression needed at one instant, the fraction s in [0, 1] of the horizon; `symbol` stands for its value.

    `off`: the expression by the model's equations, if it contains rates of states or algebraic variables: between
    collocation points the polynomials do not satisfy the equations.
    """

    symbol: ca.SX
    expression: ca.SX
    s: float
    off: ca.SX | None = None


@dataclass(frozen=True, eq=False)
class Horizon:
    """Start and final time [s] in the free constants P."""

    t0: ca.SX
    tf: ca.SX
    P: ca.SX

    @property
    def length(self) -> ca.SX:
        return self.tf - self.t0


def horizon(flat: FlatModel, P: ca.SX, parameters: ca.SX) -> Horizon:
    """Return both ends of the model's horizon. Raises ModelError for an invalid end or a non-positive length."""
    t0, tf = (end_of(flat, name) for name in ("start_time", "final_time"))
    if flat.parameters:
        t0, tf = ca.substitute([t0, tf], [flat.p], [parameters])
    known = {s.element_hash() for s in ca.vertsplit(P)}
    for name, end in (("start_time", t0), ("final_time", tf)):
        if strange := [s.name() for s in ca.symvar(end) if s.element_hash() not in known]:
            raise ModelError(
                f"{flat.title}: {name} may depend on numbers, parameters and free constants only; found "
                f"{', '.join(strange)}"
            )
    require_order(flat.title, t0, tf)
    return Horizon(t0, tf, P)


def require_order(title: str, t0: ca.SX, tf: ca.SX) -> None:
    """Raise ModelError for a fixed horizon that does not end after its start."""
    if t0.is_constant() and tf.is_constant() and not float(tf) > float(t0):
        raise ModelError(f"{title}: the horizon ends at {float(tf):g} s, but starts at {float(t0):g} s")


def end_of(flat: FlatModel, name: str) -> ca.SX:
    """Return start_time or final_time as an expression. Raises ModelError for anything but a scalar."""
    value = getattr(flat.root, name)
    if isinstance(value, Expr) and value.shape == ():
        return value.sx
    if isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and np.isfinite(value):
        return ca.SX(float(value))
    raise ModelError(f"{flat.title}: {name} must be a number [s], a gt.parameter or gt.free(...); found {value!r}")


def initial_rows(flat: FlatModel) -> list[ConstraintRow]:
    """Return initial_equations() of all components as constraints at the start of the horizon."""
    rows = []
    for e in flat.initial:
        symbol = ca.SX.sym(f"initial{len(flat.scope.instants)}")
        flat.scope.instants.append(Instant(symbol, e.residual, end_of(flat, "start_time")))
        rows.append(ConstraintRow(symbol, 0.0, 0.0, f"{e.label} ({e.where})", e.where))
    return rows


def shortest_length(
    flat: FlatModel, h: Horizon, constraints: Sequence[ConstraintRow], guess: np.ndarray, tunable: ca.SX | None = None
) -> float:
    """Return the lower bound of a free horizon's length [s]: 0 if bounds or a constraint already keep it positive, else
    a small share of its guessed length. Raises ModelError if the guessed length is not positive.

    tunable: parameters whose values are the last entries of `guess`.
    """
    length = float(ca.Function("length", [h.P], [h.length])(guess))
    if tunable is not None and tunable.numel():
        values = ca.SX(guess[len(guess) - tunable.numel() :])
        t0, tf, *rows = ca.substitute([h.t0, h.tf, *[r.expression for r in constraints]], [tunable], [values])
        h = Horizon(t0, tf, h.P[: h.P.numel() - tunable.numel()])
        constraints = [
            ConstraintRow(e, r.low, r.high, r.label, r.where) for e, r in zip(rows, constraints, strict=True)
        ]
    free = {q.symbol.element_hash(): q for q in flat.parameters if q.free}

    def limits(end: ca.SX) -> tuple[float, float]:
        if end.is_constant():
            return float(end), float(end)
        # extremes of an affine expression of free constants
        symbols = ca.symvar(end)
        jacobian = ca.gradient(end, ca.vertcat(*symbols))
        if not jacobian.is_constant():
            raise ModelError(
                f"{flat.title}: an end of the horizon must be affine in the free constants; found {end}; declare it as "
                "gt.free(...) and write the relation in constraints()"
            )
        low = high = float(ca.substitute([end], [ca.vertcat(*symbols)], [ca.SX.zeros(len(symbols))])[0])
        for s, a in zip(symbols, np.asarray(ca.DM(jacobian)).reshape(-1).tolist(), strict=True):
            q = free[s.element_hash()]
            reach = sorted([a * q.min, a * q.max]) if a else [0.0, 0.0]
            low, high = low + reach[0], high + reach[1]
        return low, high

    high0, lowf = limits(h.t0)[1], limits(h.tf)[0]
    if lowf > high0 or h.length.is_constant() or any(_shortest(row, h) > 0 for row in constraints):
        return 0.0
    if length > 0:
        return SHORTEST * length
    first, last = (next((free.get(s.element_hash()) for s in ca.symvar(end)), None) for end in (h.t0, h.tf))
    end = last or first
    where = end.where if end is not None else None
    raise ModelError(
        f"{flat.title}: the free horizon is {length:g} s long at its guess; guess an end after the "
        "start, or bound it: gt.free(guess=..., min=0.1)",
        where,
    )


def _shortest(row: ConstraintRow, h: Horizon) -> float:
    """Return the lower bound of the horizon's length from a constraint a * length + b; -inf if there is none."""
    jacobian = ca.vertcat(ca.gradient(row.expression, h.P), ca.gradient(h.length, h.P))
    known = {s.element_hash() for s in ca.vertsplit(h.P)}
    if not jacobian.is_constant() or not {s.element_hash() for s in ca.symvar(row.expression)} <= known:
        return -np.inf
    row_slope, length_slope = np.array(ca.DM(jacobian)).reshape(2, -1)
    a = float(row_slope @ length_slope / (length_slope @ length_slope))
    if a == 0.0 or np.max(np.abs(row_slope - a * length_slope)) > ROUND_OFF:
        return -np.inf
    b = float(ca.substitute([row.expression - a * h.length], [h.P], [ca.SX.zeros(*h.P.shape)])[0])
    return (row.low - b) / a if a > 0 else (row.high - b) / a


def point_values(flat: FlatModel, h: Horizon, instants: Sequence[Instant], parameters: ca.SX) -> list[PointValue]:
    """Return the values of .at() with their fraction s in [0, 1], which must not depend on free constants."""
    result = []
    for instant in instants:
        if instant.time is None:
            continue
        time = ca.substitute([instant.time], [flat.p], [parameters])[0] if flat.parameters else instant.time
        s = ca.Function("s", [h.P], [(time - h.t0) / h.length])
        first, second = (float(s(v)) for v in np.random.default_rng(0).uniform(0.5, 1.5, (2, h.P.numel())))
        if abs(first - second) > ROUND_OFF:
            free = {q.name for q in flat.parameters if q.free}
            tuned = sorted({v.name() for v in ca.symvar((time - h.t0) / h.length)} - free)
            hint = f", or leave {', '.join(tuned)} out of transcribe(parameters=...)" if tuned else ""
            if getattr(type(flat.root), "_counts_from_one", False):  # of Modelica
                raise ModelError(
                    f"{flat.title}: a value of {instant.expression} is asked for at the time {time}, but startTime or "
                    f"finalTime is free; use {instant.expression}(finalTime), or a fraction such as "
                    f"{instant.expression}(0.5*(startTime + finalTime))"
                )
            raise ModelError(f"{flat.title}: an instant of .at() is not fixed in the horizon; use its ends{hint}")
        if not -ROUND_OFF <= first <= 1 + ROUND_OFF:
            name = f"the instant {float(time):g} s" if time.is_constant() else "an instant"
            raise ModelError(f"{flat.title}: {name} of .at() lies outside the horizon")
        place = min(1.0, max(0.0, first))
        for k in range(instant.symbol.numel()):
            result.append(PointValue(instant.symbol[k], instant.expression[k], place))
    return result
