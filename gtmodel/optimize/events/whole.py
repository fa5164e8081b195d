"""Objective and constraints of the whole horizon, distributed over its phases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from ...compiler.flat import FlatModel
from ...compiler.matrices import stacked
from ...lang.connect import flatten_items
from ...lang.expression import Expr, Relation
from ...lang.optimization import Optimization
from ...lang.scope import Instant, Scope
from ...lang.slips import line_of
from ...lang.source import ModelError
from ..formulation.horizon import end_of


class PhaseOfWhole(Optimization):
    """One phase with its share of the objective and constraints, in symbols of the whole's scope."""

    def objective(self) -> Any:
        share: Share = self._share
        share.scope.instants.extend(share.instants)
        return Expr(share.cost, (), None, share.scope)

    def constraints(self) -> Iterable[Any]:
        return list(self._share.rows)


@dataclass(eq=False)
class Share:
    """A phase's share: a summand of the cost, relations, and the instants and integrals in both."""

    scope: Scope
    cost: ca.SX
    rows: list[Relation]
    instants: list[Instant]

    def at_end(self, expression: ca.SX, end: ca.SX) -> ca.SX:
        """Return a symbol for the value of a scalar at the end of the phase."""
        symbol = ca.SX.sym(f"end{len(self.instants)}")
        self.instants.append(Instant(symbol, expression, end))
        return symbol

    def conditions(self) -> list[ca.SX]:
        """Return the residuals of relations between values at an end; 0 if the relation just holds."""
        values = [i for i in self.instants if i.time is not None]
        old, new = stacked([ca.vec(i.symbol) for i in values]), stacked([ca.vec(i.expression) for i in values])
        return [ca.substitute(r.residual, old, new) for r in self.rows if values and ca.depends_on(r.residual, old)]


def phase_root(share: Share, start: ca.SX, end: ca.SX, whole: FlatModel) -> PhaseOfWhole:
    """Return an Optimization of a share between two times."""
    root = object.__new__(PhaseOfWhole)
    times = {"start_time": Expr(start, (), None, share.scope), "final_time": Expr(end, (), None, share.scope)}
    root._keep(**times, _share=share, _path="", _values={}, _parent=None, where=getattr(whole.root, "where", None))
    return root


def shares(flat: FlatModel, modes: Sequence[Sequence[bool]]) -> list[Share]:
    """Distribute objective and constraints over phases; modes: values of gt.If in each phase.

    Raises ModelError for terms that couple several phases and are not a sum over phases.
    """
    root, scope = flat.root, flat.scope
    assert isinstance(root, Optimization)
    scope.instants.clear()
    scope.misfits.clear()
    known = len(scope.modes)
    objective = root.objective()
    if not isinstance(objective, Expr) or objective.shape != ():
        raise ModelError(
            f"{flat.title}.objective() must return a scalar expression; found {objective!r}",
            line_of(type(root).objective),
        )
    rows = [_relation(item, flat) for item in flatten_items(list(root.constraints()))]
    if len(scope.modes) > known:
        raise ModelError(
            "gt.If is not allowed in objective() or constraints(); declare a variable y, write y == gt.If(...) in "
            "equations(), and use y here",
            scope.modes[known][1].where,
        )
    if scope.misfits:
        raise ModelError(
            f"{flat.title}: a model with events has phases of unknown length, so gt.misfit cannot tell which phase a "
            "measurement belongs to; build the problem with gt.Phases",
            line_of(type(root).objective),
        )
    whole = _Whole(flat, list(scope.instants))
    result = [Share(scope, ca.SX(0), [], []) for _ in modes]
    whole.cost(ca.SX(objective.sx), result)
    for row in rows:
        whole.row(row, result)
    for share, values in zip(result, modes, strict=True):
        _in_mode(flat, share, values)
    return result


def _relation(item: Any, flat: FlatModel) -> Relation:
    if not isinstance(item, Relation):
        raise ModelError(
            f"{flat.title}.constraints() yielded {type(item).__name__}; expected a relation with '==', '<=', "
            "'>=' or gt.between",
            line_of(type(flat.root).constraints),  # type: ignore[attr-defined]
        )
    return item


class _Whole:
    """Integrals and values at instants of the whole, assigned to phases."""

    def __init__(self, flat: FlatModel, instants: Sequence[Instant]) -> None:
        self._flat = flat
        self._integrals = [i for i in instants if i.time is None]
        start, end = (end_of(flat, name) for name in ("start_time", "final_time"))
        self._first: list[Instant] = []
        self._last: list[Instant] = []
        for i in instants:
            if i.time is None:
                continue
            if ca.is_equal(i.time, start, 10):
                self._first.append(i)
            elif ca.is_equal(i.time, end, 10):
                self._last.append(i)
            else:
                raise ModelError(
                    f"{flat.title}: .at({i.time}) lies between the ends, so its phase is not known in advance; use "
                    "self.start_time or self.final_time, or use gt.Phases directly"
                )

    def _inside(self, expression: ca.SX) -> tuple[list[Instant], list[Instant], list[Instant]]:
        """Return the integrals, values at the start and values at the end in an expression."""
        keys = {s.element_hash() for s in ca.symvar(expression)}
        groups = [
            [i for i in group if keys & {s.element_hash() for s in ca.vertsplit(ca.vec(i.symbol))}]
            for group in (self._integrals, self._first, self._last)
        ]
        return groups[0], groups[1], groups[2]

    def cost(self, expression: ca.SX, shares: Sequence[Share]) -> None:
        """Assign integrals to all phases and values at an end to the phase there."""
        integrals, first, last = self._inside(expression)
        for i in integrals:
            weight = ca.gradient(expression, i.symbol)
            if any(self._inside(weight)):
                raise ModelError(
                    f"{self._flat.title}: the objective must be a weighted sum of gt.integral(...) to be split into "
                    "phases; replace the integral by a variable whose derivative is the integrand",
                    line_of(type(self._flat.root).objective),  # type: ignore[attr-defined]
                )
            for share in shares:
                share.cost = share.cost + weight * i.symbol
                share.instants.append(i)
            expression = ca.substitute(expression, i.symbol, ca.SX(0))
        if first and last:
            column = stacked([ca.vec(i.symbol) for i in first])
            slope = ca.gradient(expression, column)
            if any(self._inside(ca.vertcat(slope))):
                raise ModelError(
                    f"{self._flat.title}: the objective multiplies values at the start and at the end, which belong to "
                    "two phases; declare a gt.free for one of them and equate it in constraints()",
                    line_of(type(self._flat.root).objective),  # type: ignore[attr-defined]
                )
            shares[0].cost = shares[0].cost + ca.dot(slope, column)
            shares[0].instants += first
            expression = ca.substitute(expression, column, ca.SX.zeros(*column.shape))
            first = []
        share_at_end = shares[0] if first else shares[-1]
        share_at_end.cost = share_at_end.cost + expression
        share_at_end.instants += [*first, *last]

    def row(self, row: Relation, shares: Sequence[Share]) -> None:
        """Assign a path constraint to all phases and a constraint at an end to the phase there."""
        for k in range(row.residual.numel()):
            entry = _entry(row, k)
            integrals, first, last = self._inside(entry.residual)
            if integrals or (first and last):
                what = "an integral over the whole horizon" if integrals else "values at both ends of the horizon"
                raise ModelError(
                    f"this constraint contains {what}, which spans several phases; replace "
                    + ("it by a variable whose derivative is the integrand" if integrals else "one by a gt.free"),
                    row.where,
                )
            along = self._flat.scope.symbols_in(entry.residual) or ca.depends_on(entry.residual, self._flat.scope.time)
            for share in shares if along else [shares[0] if first else shares[-1]]:
                share.rows.append(entry)
                known = {id(i) for i in share.instants}
                share.instants += [i for i in (*first, *last) if id(i) not in known]


def _entry(row: Relation, k: int) -> Relation:
    """Return one scalar of a relation."""
    if row.residual.numel() == 1:
        return row
    return replace(row, lhs=row.residual[k], rhs=ca.SX(0))


def _in_mode(flat: FlatModel, share: Share, values: Sequence[bool]) -> None:
    events = flat.events
    if events is None or not events.modes:
        return
    old, new = ca.vertcat(*[m.symbol for m in events.modes]), ca.DM([float(v) for v in values])
    share.rows = [
        replace(r, lhs=ca.substitute(r.lhs, old, new), rhs=ca.substitute(r.rhs, old, new)) for r in share.rows
    ]
    share.instants = [replace(i, expression=ca.substitute(i.expression, old, new)) for i in share.instants]
