"""A dynamic problem put together: limits, dynamics, cost, and the sizes of all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from ...lang.expression import Expr
from .builder import ProblemBuilder
from .cost import cost_of
from .dynamic import Bounds, DynamicProblem, Quadrature
from .horizon import PointValue, horizon, point_values, shortest_length
from .limits import TrajectoryBounds, bounded_end, check_bounds, limits_of, rows_at_start
from .relations import ConstraintRow
from .row_scaling import Jacobians, of_constants, scale_of, within


def assembled(
    b: ProblemBuilder,
    objective: Expr,
    constraints: list[ConstraintRow],
    quadratures: Sequence[Quadrature],
    branches: dict[str, int],
) -> DynamicProblem:
    """The problem of an objective and constraints, in the form that the builder writes. Raises ModelError."""
    ends = horizon(b.flat, b.P, b.parameters)
    instants = point_values(b.flat, ends, b.flat.scope.instants, b.parameters)
    limits = limits_of(b, constraints, instants, {q.index for q in quadratures})
    written = limits.path
    path = _expressed(b, limits, instants)
    names, bounds_P, guess = _constants(b)
    shortest = shortest_length(b.flat, ends, constraints, guess, b.P[b.n_free :])
    if shortest and not bounded_end(b, ends, shortest, bounds_P):
        limits.points.append(ConstraintRow(ends.length, shortest, np.inf, "the horizon's shortest length", None))
    check_bounds(b, limits.x, limits.u, bounds_P, limits.start, limits.end)
    rates, algebraic, labels = b.dynamics()
    integrands = b.express([q.integrand for q in quadratures]) if quadratures else []
    sizes = zip(names, of_constants(guess, bounds_P.low, bounds_P.high), strict=True)
    scale_P = np.array([b.sizes.get(n, s) for n, s in sizes])
    x_scale = within(b.nominals(b.states), limits.x.low, limits.x.high)
    u_scale = within(b.nominals(b.input_pairs), limits.u.low, limits.u.high)
    jacobian = b.jacobian(x_scale, u_scale, guess)
    _size(path, jacobian)
    at_start = rows_at_start(b, written, path, limits.x, limits.u, limits.start, ends.t0)
    scale = jacobian.at_one(algebraic)
    if b.kind == "inverse":
        scale[: len(b.controls)] = u_scale[: len(b.controls)]
    cost = cost_of(
        b, objective, [*limits.points, *(row for _, row in at_start)], [*instants, *(value for value, _ in at_start)],
        jacobian, ends, guess, scale_P,
    )  # fmt: skip
    more = cost.states
    for bounds, reach in ((limits.x, np.inf), (limits.start, 0.0), (limits.end, np.inf)):
        bounds.low = np.append(bounds.low, [-reach] * len(more))
        bounds.high = np.append(bounds.high, [reach] * len(more))
    return DynamicProblem(
        flat=b.flat, plan=b.plan, formulation=b.kind, state_pairs=b.states, control_indices=b.controls,
        x=ca.vertcat(b.x, *[q for q, _, _ in more]),
        xd=ca.vertcat(b.xd, *[ca.SX.sym("rate_integral") for _ in more]),
        u=b.u, P=b.P, t=b.flat.scope.time, t0=ends.t0, tf=ends.tf, rates=[*rates, *(e for _, e, _ in more)],
        algebraic=algebraic, algebraic_labels=labels, algebraic_scale=scale, path=path, x_bounds=limits.x,
        u_bounds=limits.u, P_bounds=bounds_P, P_guess=guess, start_bounds=limits.start,
        end_bounds=limits.end, integrals=cost.integrals, instants=cost.instants, mayer=cost.mayer, points=cost.points,
        builder=b, base=b.base, x_scale=np.append(x_scale, [size for _, _, size in more]), u_scale=u_scale,
        P_scale=scale_P, delayed=list(b.delayed.values()), delayed_indices=list(b.delayed), z_pairs=b.z_pairs,
        tunable=b.tunable, branches=branches, misfits=cost.misfits, shortest=shortest,
        quadratures=[Quadrature(q.index, e, q.start) for q, e in zip(quadratures, integrands, strict=True)],
    )  # fmt: skip


def _expressed(b: ProblemBuilder, limits: TrajectoryBounds, instants: list[PointValue]) -> list[ConstraintRow]:
    """The rows along the path, and the instants, in states, inputs and constants."""
    asked = [i.expression for i in instants]
    values = b.express(asked + [r.expression for r in limits.path])
    for i, e, off in zip(instants, values, b.off_points(asked, values[: len(instants)]), strict=False):
        i.expression, i.off = e, off
    return [replace(r, expression=e) for r, e in zip(limits.path, values[len(instants) :], strict=True)]


def _constants(b: ProblemBuilder) -> tuple[list[str], Bounds, np.ndarray]:
    """Free constants and, behind them, the parameters that may change: names, bounds, guess."""
    value = {q.name: q.value for q in b.flat.parameters}
    held = [value[n] for n in b.tunable]
    free = [q for q in b.flat.parameters if q.free]
    bounds = Bounds(np.array([q.min for q in free] + held), np.array([q.max for q in free] + held))
    return [*(q.name for q in free), *b.tunable], bounds, np.array([q.value for q in free] + held)


def _size(path: list[ConstraintRow], jacobian: Jacobians) -> None:
    """Give each row its size: its own bounds' where these tell one."""
    for row, size in zip(path, jacobian.typical([r.expression for r in path]), strict=True):
        nominal = float(within(np.array(row.scale), np.array(row.low), np.array(row.high)))
        row.scale = scale_of(nominal if nominal != 1.0 else float(size))
