"""The optimum that a predictive controller approaches: its quadratic programs repeated in one place until they rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._lazy import hint
from ..results.status import Status
from .interior_point import InteriorPoint

if TYPE_CHECKING:
    from .controller import Controller
else:
    Controller = hint("gtmodel.predictive.controller", "Controller")

TOLERANCE, ITERATIONS = 1e-11, 60  # of the programs: a plan is asked for to many digits
NEARLY = 1e-7  # of a program that stops before this tolerance, for round-off
HALVINGS = 12
PRICE = 10.0  # of an exact limit in the descent, in multiples of the largest multiplier
DESCENT = 1e-4  # least share of the descent that the program predicts
SHARE = 0.5  # of the descent that closing the gaps between stages brings
NEAR = 1e-5  # a step below this is taken in full: rounding hides its descent


@dataclass(frozen=True, eq=False)
class ConvergedPlan:
    """A plan that solves the nonlinear problem of a horizon; `Controller.converge`.

    status: OK, or NOT_CONVERGED with the best plan so far. time: of the stages [s]. x: states, (stages + 1, n).
    v: inputs of the stages; inputs: those of the model, (stages, m). cost: with prices. iterations: programs solved.
    step: largest last change of an input, relative to 1. notes: soft limits whose price is below their multiplier.

    >>> class Tank(gt.Model):
    ...     level = gt.variable()
    ...     flow = gt.input(max=0.1)
    ...     def equations(self):
    ...         yield gt.der(self.level) == self.flow
    >>> horizon = gt.predictive.ControlHorizon(period=0.1, stages=10)
    >>> law = gt.predictive.controller(
    ...     Tank(), horizon, tolerances={"level": 0.01, "flow": 1.0}, targets={"level": 0.5}
    ... )
    >>> plan = law.converge({"level": 0.0})
    >>> plan.status.name, plan.x[-1].round(3), float(plan.time[-1])
    ('OK', array([0.1]), 1.0)
    """

    status: Status
    time: np.ndarray
    x: np.ndarray
    v: np.ndarray
    inputs: np.ndarray
    cost: float
    iterations: int
    step: float
    notes: list[str]


class _Problem:
    def __init__(self, law: Controller, p: np.ndarray, d: np.ndarray) -> None:
        program = law.program
        self.program, self.p, self.d = program, p, d
        qp = program.qp
        self.method = InteriorPoint(qp.stage, qp.count, qp.last, TOLERANCE, ITERATIONS, qp.kernels)
        self.prepare = program.prepare.map(qp.count)
        self.step = program.step.map(qp.count)
        self.cost, self.rows = program.cost.map(qp.count), program.rows.map(qp.count)
        self.exact = 0.0
        self.size = np.array([r.size for r in program.statement.rows])
        self.bounds = [(r.low, r.high) for r in program.statement.rows]
        self.prices = [self._price(r.name, k) for k, r in enumerate(program.statement.rows)]
        self.soft = [k for k, r in enumerate(program.statement.rows) if r.soft]

    def _price(self, name: str, k: int) -> tuple[float, float] | None:
        return self.program.qp.stage.rows[k].price

    def shift(self, v: np.ndarray) -> np.ndarray:
        """Input with the disturbance."""
        return v + (self.d[:, None] if self.d.size else 0.0)

    def gaps(self, x: np.ndarray, v: np.ndarray) -> float:
        """Sum of what the states miss the ends of the stages before them, each in units of its typical size."""
        after = np.asarray(self.step(x[:, :-1], self.shift(v), self.p[:, :-1]).full())
        return float(np.sum(np.abs(after - x[:, 1:])))

    def value(self, x: np.ndarray, v: np.ndarray) -> float:
        """Cost with prices, also of exact limits that do not hold."""
        w = self.shift(v)
        total = float(np.sum(self.cost(x[:, :-1], w, self.p[:, :-1]).full()))
        total += float(self.program.final_cost(x[:, -1], self.p[:, -1]))
        if not self.size.size:
            return total
        rows = np.asarray(self.rows(x[:, :-1], v, w, self.p[:, :-1]).full())
        end = np.asarray(self.program.rows(x[:, -1], v[:, -1], w[:, -1], self.p[:, -1]).full())
        for k, (low, high) in enumerate(self.bounds):
            values = np.append(rows[k], end[k]) if k in self.soft else rows[k]
            beyond = np.maximum(0.0, np.maximum(values - high, low - values)) / self.size[k]
            price = self.prices[k]
            if price is None:
                total += self.exact * float(np.sum(beyond))
            else:
                total += float(np.sum(price[0] * beyond + price[1] * beyond**2 / 2))
        return total


def converged(
    law: Controller,
    x0: np.ndarray,
    goals: Mapping[str, Any],
    d: Any,
    start: ConvergedPlan | None,
    max_iterations: int,
    tolerance: float,
) -> ConvergedPlan:
    """See `Controller.converge`."""
    program, horizon = law.program, law.program.horizon
    qp, count = program.qp, program.qp.count
    problem = _Problem(law, law.references_of(goals), np.asarray(d, float).reshape(-1))
    v = np.repeat(law.first[:, None], count, axis=1) if start is None else start.v.T
    along = np.linspace(0.0, 1.0, count + 1)
    x = x0[:, None] + along * (program.standstill.x - x0)[:, None] if start is None else start.x.T
    o, step, iteration, status, dear = None, np.inf, 0, Status.NOT_CONVERGED, 0.0
    wide = np.repeat(problem.d[:, None], count, axis=1)
    while iteration < max_iterations:
        iteration += 1
        data = np.asarray(problem.prepare(x[:, :-1], v, wide, problem.p[:, :-1], x[:, 1:]).full())
        last = np.asarray(program.finish(x[:, -1], problem.d, problem.p[:, -1]).full())
        o = problem.method.solve(x0 - x[:, 0], data, last, None)
        if not (o.status == Status.OK or max(o.gap, o.residual) <= NEARLY * (1 + abs(o.cost))):
            status = o.status
            break
        step = float(max(np.max(np.abs(b) / (1 + np.abs(a))) for a, b in ((v, o.u), (x, o.x))))
        problem.exact = max(problem.exact, PRICE * _largest_multiplier(qp, o))
        now, gaps, length = problem.value(x, v), problem.gaps(x, v), 1.0
        # the price of a gap makes the step a descent of cost and gaps together (Nocedal, Wright 2006, eq. (18.36))
        rise = o.cost - now
        if gaps > 0:
            dear = max(dear, rise / (SHARE * gaps))
        descent = rise - dear * gaps
        while step > NEAR and length > 0.5**HALVINGS:
            ahead_x, ahead_v = x + length * o.x, v + length * o.u
            merit = problem.value(ahead_x, ahead_v) + dear * problem.gaps(ahead_x, ahead_v)
            if merit <= now + dear * gaps + DESCENT * length * descent:
                break
            length /= 2
        x, v = x + length * o.x, v + length * o.u
        if step <= tolerance:
            status = Status.OK
            break
    forces = [np.asarray(program.command(x[:, k], v[:, k], problem.d, problem.p[:, k])[0].full())[:, 0]
              for k in range(count)]  # fmt: skip
    time = horizon.stage * np.arange(count + 1)
    return ConvergedPlan(status, time, x.T, v.T, np.array(forces), problem.value(x, v), iteration, step, _notes(law, o))


def _largest_multiplier(qp: Any, o: Any) -> float:
    """Of the exact limits."""
    sides = qp.stage.sides
    chosen = [j for j, side in enumerate(sides) if side.price is None]
    return float(np.max(o.sides[[len(sides) + j for j in chosen]], initial=0.0))


def _notes(law: Controller, o: Any) -> list[str]:
    """Soft limits that are exceeded because their price is low."""
    if o is None:
        return []
    qp, rows = law.program.qp, law.program.statement.rows
    sides, exceeded = qp.stage.sides, []
    for j, side in enumerate(sides):
        if side.price is None:
            continue
        excess = o.sides[2 * len(sides) + qp.stage.soft.index(j), 1:]
        if np.max(excess, initial=0.0) > 1e-4:
            exceeded.append(
                f"'{rows[side.row].name}' exceeds its limit by {100 * np.max(excess):.2g} % of its size: there is no "
                f"other plan, or its price {side.price[0]:g} is below the multiplier of the exact limit"
            )
    return exceeded
