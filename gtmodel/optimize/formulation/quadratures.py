"""Cost states: der(cost) == L with cost.at(final_time) in the objective is the integral of L.

A cost state drives nothing else. As an unknown it would make the solve several times slower, so the objective uses the
integral, and the state's values are computed afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...compiler.flat import FlatModel, FlatVariable
from ...lang.scope import Instant
from ...lang.source import ModelError
from ..mesh import Mesh, basis
from .dynamic import DynamicProblem, Quadrature
from .horizon import ConstraintRow

SAME_TIME = 100  # depth of the comparison of two time expressions
LEFT = 1e-12  # of the horizon: at an edge the element on the left is used


def set_apart(
    flat: FlatModel, objective: ca.SX, constraints: Sequence[ConstraintRow], preferred: Sequence[int], final_time: ca.SX
) -> tuple[ca.SX, list[Quadrature]]:
    """Replace cost states in the objective by integrals, which are added to the scope; return both.

    A cost state occurs in no equation but der(state) == ..., has a fixed start, no bounds and no constraint, and enters
    the objective only as its value at the final time, times a number or parameters.
    """
    candidates = [v for v in flat.variables if v.index not in preferred and _plain(flat, v)]
    if not candidates:
        return objective, []  # saves the search through a large model
    uses = _Uses(flat, constraints)
    selected: list[tuple[FlatVariable, list[Instant], ca.SX]] = []
    for v in candidates:
        instants = uses.instants_of(v.index)
        integrand = uses.integrand(v.index) if instants else None
        weights = [ca.gradient(objective, i.symbol) for i in instants]
        if integrand is not None and all(
            uses.at_end(i, v.index, final_time) and uses.steady(w) for i, w in zip(instants, weights, strict=True)
        ):
            selected.append((v, instants, integrand))
    if not uses.moves(but={v.index for v, _, _ in selected}):
        return objective, []  # at least one state must remain
    quadratures: list[Quadrature] = []
    for v, instants, integrand in selected:
        assert v.start is not None
        total = ca.SX.sym(f"total of {v.name}")
        flat.scope.instants.append(Instant(total, integrand, None))
        flat.scope.instants[:] = [i for i in flat.scope.instants if not any(i is replaced for replaced in instants)]
        old = ca.vertcat(*[i.symbol for i in instants])
        objective = ca.substitute([objective], [old], [ca.repmat(v.start + total, len(instants), 1)])[0]
        quadratures.append(Quadrature(v.index, integrand, v.start))
    return objective, quadratures


def refuse_adrift(flat: FlatModel, objective: ca.SX, constraints: Sequence[ConstraintRow], final_time: ca.SX) -> None:
    """Raise ModelError for a cost state whose start is not fixed: the objective would be unbounded."""
    at_instants = {i for instant in flat.scope.instants for i, _ in flat.scope.symbols_in(instant.expression)}
    candidates = [flat.variables[i] for i in sorted(at_instants)]
    candidates = [v for v in candidates if not v.fixed and _unbounded(flat, v)]
    if not candidates:
        return  # saves the search through a large model
    uses = _Uses(flat, constraints)
    for v in candidates:
        instants = uses.instants_of(v.index)
        if not all(uses.at_end(i, v.index, final_time) for i in instants):
            continue
        weights = [ca.gradient(objective, i.symbol) for i in instants]
        if (
            not ca.simplify(sum(weights, ca.SX(0))).is_zero()
            and uses.integrand(v.index) is not None
            and all(uses.steady(w) for w in weights)
        ):
            raise ModelError(
                f"the objective is unbounded: it uses '{v.name}' at the final time, but '{v.name}' has no fixed start; "
                f"declare it with start={v.start or 0:g}, fixed=True",
                v.where,
            )


def _plain(flat: FlatModel, v: FlatVariable) -> bool:
    """Return whether v is a scalar with a fixed start and no bounds."""
    return v.fixed and v.start is not None and _unbounded(flat, v)


def _unbounded(flat: FlatModel, v: FlatVariable) -> bool:
    scalar = v.name in flat.groups and flat.groups[v.name][0] == ()
    return scalar and not (np.isfinite(v.min) or np.isfinite(v.max))


class _Uses:
    """Occurrences of variables and their derivatives in a model."""

    def __init__(self, flat: FlatModel, constraints: Sequence[ConstraintRow]) -> None:
        self.flat = flat
        scope = flat.scope
        self.equations = [e.residual for e in flat.equations]
        self.inside = [{i for i, _ in scope.symbols_in(e)} for e in self.equations]
        others = [r.expression for r in constraints] + [b.expression for b in flat.branches]
        self.elsewhere = {i for e in others for i, _ in scope.symbols_in(e)}
        constrained = [r.expression for r in constraints] + [m.residual for m in scope.misfits]
        self.held = {s.element_hash() for e in constrained for s in ca.symvar(e)}

    def moves(self, but: set[int]) -> bool:
        """Return whether any other variable has a derivative in the equations."""
        pairs = [p for e in self.equations for p in self.flat.scope.symbols_in(e)]
        return any(order > 0 and index not in but for index, order in pairs)

    def instants_of(self, index: int) -> list[Instant]:
        return [
            i for i in self.flat.scope.instants if any(n == index for n, _ in self.flat.scope.symbols_in(i.expression))
        ]

    def at_end(self, instant: Instant, index: int, final_time: ca.SX) -> bool:
        """Return whether it is the variable's value at the final time, used by no constraint and no misfit."""
        is_value = instant.expression.is_scalar() and ca.is_equal(
            instant.expression, self.flat.scope.symbol(index, 0), 1
        )
        at_end = instant.time is not None and ca.is_equal(instant.time, final_time, SAME_TIME)
        return bool(is_value and at_end and instant.symbol.element_hash() not in self.held)

    def steady(self, weight: ca.SX) -> bool:
        """Return whether the weight consists of numbers and parameters."""
        known = {s.element_hash() for s in ca.vertsplit(self.flat.p)} if self.flat.parameters else set()
        return all(s.element_hash() in known for s in ca.symvar(weight))

    def integrand(self, index: int) -> ca.SX | None:
        """Return the variable's derivative from its only equation; None if it occurs elsewhere."""
        places = [n for n, inside in enumerate(self.inside) if index in inside]
        if len(places) != 1 or index in self.elsewhere:
            return None
        e, scope = self.equations[places[0]], self.flat.scope
        if [k for i, k in scope.symbols_in(e) if i == index] != [1]:
            return None
        rate = scope.symbol(index, 1)
        slope = ca.gradient(e, rate)
        if not slope.is_constant() or float(slope) == 0.0:
            return None
        return -ca.substitute([e], [rate], [ca.SX(0)])[0] / slope


def summed(problem: DynamicProblem, mesh: Mesh, at_points: np.ndarray, s: np.ndarray, duration: float) -> np.ndarray:
    """Return values (len(s), n) of quadratures at fractions s of the horizon, from integrands (elements, points, n) at
    the collocation points: equal to the collocation polynomials of the replaced states."""
    points, K = mesh.table.points, mesh.points
    length = mesh.h * duration
    whole = np.einsum("c,ncq->nq", mesh.table.weights, at_points) * length[:, None]
    before = np.vstack([np.zeros(whole.shape[1]), np.cumsum(whole, axis=0)[:-1]])
    k = np.clip(np.searchsorted(mesh.edges, s - LEFT, side="left") - 1, 0, mesh.elements - 1)
    local = np.clip((s - mesh.edges[k]) / mesh.h[k], 0.0, 1.0)
    nodes, weights = np.polynomial.legendre.leggauss(K)
    along = local[:, None] * (nodes + 1) / 2
    share = np.einsum("g,pgc->pc", weights / 2, basis(points, along.ravel()).reshape(*along.shape, K)) * local[:, None]
    starts = np.array([q.start for q in problem.quadratures])
    return starts + before[k] + np.einsum("pc,pcq->pq", share, at_points[k]) * length[k, None]
