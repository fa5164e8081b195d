"""Quadratic programs with the structure of a horizon, by a primal-dual interior point method with Riccati recursion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..cgen.real import DOUBLE, Real
from ..results.refusal import ArgumentError
from ..results.status import Status
from .interior_point import InteriorPoint
from .kernels import kernels
from .stage import HorizonStage

MAX_ITERATIONS = 30
TOLERANCE = 1e-8
IN_FLOAT = 1e-4  # least tolerance in float


@dataclass(frozen=True, eq=False)
class StageSolution:
    """Solution of a `StageQP`.

    status: OK only if gap, residuals and gradient are below their tolerances; NOT_CONVERGED also if no input meets the
    exact limits; SINGULAR if the cost is not strictly convex in an input; NOT_FINITE if a number is not. With another
    status than OK, x and u are the last iterate.
    x: states, (stages + 1, n). u: inputs, (stages, m). cost: with prices. iterations: of the interior point.
    gap: sum of distance times multiplier over all limits, which bounds the cost above the optimum. residual: sum of
    what the limits lack. gradient: sum of the absolute derivatives by the inputs.
    sides, last_sides: distances t and multipliers l of the limits (`HorizonStage.sides`), then excesses and their
    multipliers, by stage.

    >>> import casadi as ca
    >>> x, u, none = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX(0, 1)
    >>> stage = gt.predictive.HorizonStage(x, u, none, x + 0.1 * u, x**2 + u**2, [gt.predictive.LimitedRow(u, -1, 1)])
    >>> qp = gt.predictive.StageQP(stage, 20, gt.predictive.HorizonStage(x, None, none, None, x**2))
    >>> cold = qp.solve([3.0])
    >>> next_cycle = qp.solve(cold.x[1], start=cold.shifted())
    >>> next_cycle.iterations < cold.iterations
    True
    """

    status: Status
    x: np.ndarray
    u: np.ndarray
    cost: float
    iterations: int
    gap: float
    residual: float
    gradient: float
    sides: np.ndarray = field(repr=False)
    last_sides: np.ndarray = field(repr=False)

    def shifted(self) -> StageSolution:
        """Return the solution moved on by one stage, its last one repeated: a start for the next cycle."""
        on = lambda a: np.concatenate([a[1:], a[-1:]])  # noqa: E731
        return replace(self, x=on(self.x), u=on(self.u), sides=on(self.sides))


class StageQP(Portable):
    """Least cost over `count` stages from a given state, within the limits of the rows.

    The work grows linearly with `count`. A limit of the state at the first stage cannot be influenced; make it soft.

    Args:
        stage: all stages but the last.
        count: number of them.
        last: cost and rows of the final state; its symbols are its own.
        tolerance: of gap, residuals and gradient, relative to 1 + |cost|, in the units of the cost.
        max_iterations: with each at most the same number of operations.

    Raises ArgumentError if the numbers of states differ, or a stage does not fit its place.

    >>> import casadi as ca
    >>> x, u, none = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX(0, 1)
    >>> after = ca.vertcat(x[0] + 0.1 * x[1] + 0.005 * u, x[1] + 0.1 * u)
    >>> rows = [gt.predictive.LimitedRow(u, -1, 1)]
    >>> stage = gt.predictive.HorizonStage(x, u, none, after, ca.sumsqr(x) + 0.01 * u**2, rows)
    >>> end = gt.predictive.HorizonStage(x, None, none, None, 10 * ca.sumsqr(x))
    >>> s = gt.predictive.StageQP(stage, 20, end).solve([1.0, 0.0])
    >>> s.status.name, s.u[0].round(6)
    ('OK', array([-1.]))
    """

    def __init__(
        self,
        stage: HorizonStage,
        count: int,
        last: HorizonStage,
        *,
        tolerance: float = TOLERANCE,
        max_iterations: int = MAX_ITERATIONS,
    ) -> None:
        if stage.u is None or stage.after is None:
            raise ArgumentError("expected a stage with input and state after it; found one without", "stage")
        if last.u is not None or last.after is not None:
            raise ArgumentError("expected a stage without input and state after it; found one with", "last")
        for states, name in ((stage.after.numel(), "stage"), (last.states, "last")):
            if states != stage.states:
                raise ArgumentError(f"expected {stage.states} states; found {states}", name)
        if count < 1 or max_iterations < 1:
            raise ArgumentError(
                f"expected at least 1; found {min(count, max_iterations)}", "count" if count < 1 else "max_iterations"
            )
        self.stage, self.count, self.last = stage, count, last
        self.tolerance, self.max_iterations = tolerance, max_iterations

    def tolerance_in(self, real: Real) -> float:
        """Return the tolerance in this number type: that of float is wider, since a distance times its multiplier,
        summed over all limits, must stay far above round-off."""
        return self.tolerance if real is DOUBLE else max(self.tolerance, IN_FLOAT)

    @cached_property
    def kernels(self) -> tuple[dict[str, ca.Function], dict[str, ca.Function]]:
        """Operations of a stage, and of the last one."""
        return kernels(self.stage), kernels(self.last)

    @cached_property
    def _method(self) -> InteriorPoint:
        return InteriorPoint(self.stage, self.count, self.last, self.tolerance, self.max_iterations, self.kernels)

    def solve(self, x: Any, data: Any = (), last_data: Any = (), start: StageSolution | None = None) -> StageSolution:
        """Return the solution from the state x.

        Args:
            x: first state, (n,).
            data: of the stages, (count, numbers), or (numbers,) for all of them.
            last_data: of the last stage.
            start: solution of a problem nearby, such as that of the last cycle: about a sixth fewer iterations.

        Raises ArgumentError for a wrong size; numbers that are not finite give a status.
        """
        of, n = self.stage, self.count
        first = _sized(x, (of.states,), "x")
        numbers = np.asarray(data, float)
        numbers = _sized(np.tile(numbers, (n, 1)) if numbers.ndim == 1 else numbers, (n, of.numbers), "data")
        end = _sized(last_data, (self.last.numbers,), "last_data")
        if start is not None:
            _sized(start.u, (n, of.inputs), "start.u")
            _sized(start.sides, (n, of.positives), "start.sides")
        at = None if start is None else (start.u.T, start.sides.T, start.last_sides.reshape(-1, 1))
        o = self._method.solve(first, numbers.T, end.reshape(-1, 1), at)
        return StageSolution(
            o.status, o.x.T, o.u.T, o.cost, o.iterations, o.gap, o.residual, o.gradient, o.sides.T, o.last_sides[:, 0]
        )


def _sized(value: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    array = np.asarray(value, float)
    if array.shape != shape:
        raise ArgumentError(f"expected an array of shape {shape}; found {array.shape}", name)
    return array
