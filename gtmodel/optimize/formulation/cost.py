"""The objective as constant weights of integrals and a part at instants."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from ...lang.expression import Expr
from ...lang.scope import Misfit
from ...lang.source import ModelError
from .builder import ProblemBuilder
from .horizon import Horizon, PointValue
from .relations import ConstraintRow
from .row_scaling import Jacobians, scale_of


@dataclass(eq=False)
class CostTerms:
    """integrals: (symbol, integrand, constant coefficient); mayer: what is left, in values at `instants`; points: the
    rows at instants in these. states: integrals that became states, with their integrands and sizes."""

    mayer: ca.SX
    misfits: list[Misfit]
    instants: list[PointValue]
    integrals: list[tuple[ca.SX, ca.SX, float]] = field(default_factory=list)
    points: list[ConstraintRow] = field(default_factory=list)
    states: list[tuple[ca.SX, ca.SX, float]] = field(default_factory=list)


def cost_of(
    b: ProblemBuilder, objective: Expr, points: list[ConstraintRow], instants: list[PointValue], jacobian: Jacobians,
    ends: Horizon, guess: np.ndarray, scale: np.ndarray,
) -> CostTerms:  # fmt: skip
    """Split the objective; guess, scale: of the free constants. Raises ModelError for an objective or a row that holds
    what is no value at an instant."""
    terms = CostTerms(ca.SX(0), [], list(instants))
    integrals = [i for i in b.flat.scope.instants if i.time is None]
    cost = b.numbers(objective.sx)
    used_in_points = {s.element_hash() for r in points for s in ca.symvar(r.expression)}
    integrands = b.express([i.expression for i in integrals]) if integrals else []
    along = [b.x, b.xd, b.u, b.P, b.flat.scope.time]
    length = abs(float(ca.Function("length", [b.P], [ends.tf - ends.t0])(guess)))
    sizes_of = {i.symbol.element_hash(): i.expression for i in instants}
    for instant, integrand in zip(integrals, integrands, strict=True):
        b.require(integrand, along, "the argument of gt.integral() holds a value at an instant or an integral")
        weight = ca.gradient(cost, instant.symbol)
        if weight.is_constant() and instant.symbol.element_hash() not in used_in_points:
            terms.integrals.append((instant.symbol, integrand, float(weight)))
            cost = ca.substitute([cost], [instant.symbol], [ca.SX(0)])[0]
            continue
        q = ca.SX.sym(f"integral_{b.x.numel() + len(terms.states)}")
        terms.states.append((q, integrand, scale_of(float(jacobian.typical([length * integrand])[0]))))
        terms.instants.append(PointValue(instant.symbol, q, 1.0))
        sizes_of[instant.symbol.element_hash()] = length * integrand
    at_points = [b.P, *(i.symbol for i in terms.instants)]
    b.require(cost, at_points, "objective() holds", "; take a value with .at(...) or gt.integral(...)")
    terms.mayer = cost
    terms.misfits = [Misfit(b.numbers(m.residual), m.known) for m in b.flat.scope.misfits]
    for r in points:
        e = b.numbers(r.expression)
        b.require(e, at_points, f"{r.label} holds", ", beside a value at an instant or an integral")
        if not ca.symvar(e):
            raise ModelError(f"{r.label} holds no variable and nothing to choose: {r.low:g} <= {e} <= {r.high:g}")
        terms.points.append(replace(r, expression=e))
    values = [sizes_of[i.symbol.element_hash()] for i in terms.instants]
    symbols = ca.vertcat(*[i.symbol for i in terms.instants])
    sizes = jacobian.of_points([r.expression for r in terms.points], symbols, values, b.P, scale)
    for r, size in zip(terms.points, sizes, strict=True):
        r.scale = scale_of(float(size)) if r.scale == 1.0 else r.scale
    return terms
