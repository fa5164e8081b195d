"""Objective and constraints of a whole horizon, shared out to the phases that it falls into."""

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
    """One phase: what it has of the whole, in symbols of the whole's scope."""

    def objective(self) -> Any:
        own: Share = self._share
        own.scope.instants.extend(own.instants)
        return Expr(own.cost, (), None, own.scope)

    def constraints(self) -> Iterable[Any]:
        return list(self._share.rows)


@dataclass(eq=False)
class Share:
    """What a phase has: a summand of the cost, relations, and the values at instants and integrals in both."""

    scope: Scope
    cost: ca.SX
    rows: list[Relation]
    instants: list[Instant]

    def at_end(self, expression: ca.SX, end: ca.SX) -> ca.SX:
        """A symbol for the value of a scalar at the end of the phase."""
        symbol = ca.SX.sym(f"end{len(self.instants)}")
        self.instants.append(Instant(symbol, expression, end))
        return symbol

    def conditions(self) -> list[ca.SX]:
        """What relations between values at an end compare, as expressions that are 0 where they just hold."""
        at = [i for i in self.instants if i.time is not None]
        old, new = stacked([ca.vec(i.symbol) for i in at]), stacked([ca.vec(i.expression) for i in at])
        return [ca.substitute(r.residual, old, new) for r in self.rows if at and ca.depends_on(r.residual, old)]


def phase_root(share: Share, start: ca.SX, end: ca.SX, whole: FlatModel) -> PhaseOfWhole:
    """An Optimization of a share of the whole between two times."""
    root = object.__new__(PhaseOfWhole)
    times = {"start_time": Expr(start, (), None, share.scope), "final_time": Expr(end, (), None, share.scope)}
    root._keep(**times, _share=share, _path="", _values={}, _parent=None, where=getattr(whole.root, "where", None))
    return root


def shares(flat: FlatModel, modes: Sequence[Sequence[bool]]) -> list[Share]:
    """Of each phase, whose gt.If have these values.

    Raises ModelError for what spans several phases and is no sum of what each has.
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
            "gt.If stands in objective() or constraints(); give it a variable of the model there, y == gt.If(...), and "
            "write y here",
            scope.modes[known][1].where,
        )
    if scope.misfits:
        raise ModelError(
            f"{flat.title}: gt.misfit holds instants that no phase can be given beforehand; write gt.Phases yourself",
            line_of(type(root).objective),
        )
    whole = _Whole(flat, list(scope.instants))
    made = [Share(scope, ca.SX(0), [], []) for _ in modes]
    whole.cost(ca.SX(objective.sx), made)
    for row in rows:
        whole.row(row, made)
    for share, values in zip(made, modes, strict=True):
        _in_mode(flat, share, values)
    return made


def _relation(item: Any, flat: FlatModel) -> Relation:
    if not isinstance(item, Relation):
        raise ModelError(
            f"{flat.title}.constraints() yielded {type(item).__name__}, which is no relation; expected '==', '<=', "
            "'>=' or gt.between",
            line_of(type(flat.root).constraints),  # type: ignore[attr-defined]
        )
    return item


class _Whole:
    """Values at instants and integrals of the whole, by the phase that has them."""

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
                    f"{flat.title}: .at({i.time}) lies between the ends, and which phase has that instant is open; use "
                    "self.start_time or self.final_time, or write gt.Phases yourself"
                )

    def _inside(self, expression: ca.SX) -> tuple[list[Instant], list[Instant], list[Instant]]:
        """Integrals, values at the start and values at the end in an expression."""
        keys = {s.element_hash() for s in ca.symvar(expression)}
        held = [
            [i for i in group if keys & {s.element_hash() for s in ca.vertsplit(ca.vec(i.symbol))}]
            for group in (self._integrals, self._first, self._last)
        ]
        return held[0], held[1], held[2]

    def cost(self, expression: ca.SX, made: Sequence[Share]) -> None:
        """Integrals to all phases, values at an end to the phase there."""
        integrals, first, last = self._inside(expression)
        for i in integrals:
            weight = ca.gradient(expression, i.symbol)
            if any(self._inside(weight)):
                raise ModelError(
                    f"{self._flat.title}: the objective is no weighted sum of gt.integral(...), and each phase has its "
                    "own part of them; make the integral a variable whose derivative is the integrand",
                    line_of(type(self._flat.root).objective),  # type: ignore[attr-defined]
                )
            for share in made:
                share.cost = share.cost + weight * i.symbol
                share.instants.append(i)
            expression = ca.substitute(expression, i.symbol, ca.SX(0))
        if first and last:
            column = stacked([ca.vec(i.symbol) for i in first])
            slope = ca.gradient(expression, column)
            if any(self._inside(ca.vertcat(slope))):
                raise ModelError(
                    f"{self._flat.title}: the objective multiplies what is at the start with what is at the end, and "
                    "these are two phases; declare a gt.free for the one and write it as a constraint",
                    line_of(type(self._flat.root).objective),  # type: ignore[attr-defined]
                )
            made[0].cost = made[0].cost + ca.dot(slope, column)
            made[0].instants += first
            expression = ca.substitute(expression, column, ca.SX.zeros(*column.shape))
            first = []
        own = made[0] if first else made[-1]
        own.cost = own.cost + expression
        own.instants += [*first, *last]

    def row(self, row: Relation, made: Sequence[Share]) -> None:
        """Along the path to all phases, at an end to the phase there."""
        for k in range(row.residual.numel()):
            own = _entry(row, k)
            integrals, first, last = self._inside(own.residual)
            if integrals or (first and last):
                what = "an integral over the whole" if integrals else "both ends of the whole"
                raise ModelError(
                    f"this constraint holds {what}, and each phase has a part of it only; make "
                    + ("it a variable whose derivative is the integrand" if integrals else "the one a gt.free"),
                    row.where,
                )
            along = self._flat.scope.symbols_in(own.residual) or ca.depends_on(own.residual, self._flat.scope.time)
            for share in made if along else [made[0] if first else made[-1]]:
                share.rows.append(own)
                known = {id(i) for i in share.instants}
                share.instants += [i for i in (*first, *last) if id(i) not in known]


def _entry(row: Relation, k: int) -> Relation:
    """One scalar of a relation."""
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
