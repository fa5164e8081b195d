"""The primal-dual interior point method of a horizon, with the operations of C in their order (gt_stage_qp.h).

Predictor and corrector of Mehrotra (1992). Inputs and sides are iterates; the states follow from the inputs, so that
the dynamics always hold exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..cgen.newton_steps import run
from ..cgen.real import DOUBLE, Real
from ..results.status import Status
from .stage import HorizonStage

GRADIENT = 10.0  # tolerances: the gradient, over 1 + |cost|
TO_BOUNDARY = 0.995

Columns = list[np.ndarray]


class _Called:
    """A function on arrays of fixed sizes, without copies by CasADi: a tenth of the time of a call."""

    def __init__(self, f: ca.Function) -> None:
        buffer: Any
        buffer, self._run = f.buffer()
        inputs, outputs = range(f.n_in()), range(f.n_out())
        numbers = [f.numel_in(k) for k in inputs], [f.numel_out(k) for k in outputs]
        self._flat, self._buffer = [[np.zeros(max(1, n)) for n in side] for side in numbers], buffer  # both stay alive
        shapes = [f.size_in(k) for k in inputs], [f.size_out(k) for k in outputs]
        self.arguments, self.results = (
            [a[: s[0] * s[1]].reshape(s, order="F") for a, s in zip(flat, sizes, strict=True)]
            for flat, sizes in zip(self._flat, shapes, strict=True)
        )
        for flat, use in zip(self._flat, (buffer.set_arg, buffer.set_res), strict=True):
            for k, a in enumerate(flat):
                use(k, a.data)

    def __call__(self, *arguments: Any) -> Columns:
        for own, given in zip(self.arguments, arguments, strict=True):
            if own.size:
                own[...] = given
        self._run()
        return [r.copy() for r in self.results]


class StageEvaluator:
    """Functions of a stage on the columns of all stages."""

    def __init__(self, functions: dict[str, ca.Function], count: int, real: Real) -> None:
        self.functions, self.count, self.real = functions, count, real
        self._built: dict[str, _Called] = {}

    def each(self, name: str, *arguments: Any) -> Columns:
        """Evaluate at every stage."""
        f = self.functions[name]
        if self.real is not DOUBLE:
            return run(f, [
                np.broadcast_to(np.asarray(a, self.real.dtype), (f.numel_in(k), self.count))
                for k, a in enumerate(arguments)
            ])  # fmt: skip
        if name not in self._built:
            self._built[name] = _Called(f.map(self.count))
        return self._built[name](*arguments)

    def along(self, name: str, carried: Sequence[Any], *arguments: Any) -> Columns:
        """Evaluate stage after stage: the first results go into the first arguments of the next stage. Returns the
        results of every stage; matrices of several columns lie side by side."""
        f, size = self.functions[name], len(carried)
        if self.real is DOUBLE:
            if name not in self._built:
                self._built[name] = _Called(f.mapaccum(name, self.count, size))
            return self._built[name](*carried, *arguments)
        now, results = [np.reshape(c, (-1, 1)) for c in carried], []
        for k in range(self.count):
            own = [_part(a, f.size2_in(size + i), k) for i, a in enumerate(arguments)]
            evaluated = run(f, [*now, *own])
            now = evaluated[:size]
            results.append([r.reshape(f.size_out(i), order="F") for i, r in enumerate(evaluated)])
        return [np.concatenate(r, axis=1) for r in zip(*results, strict=True)]


def _part(argument: np.ndarray, width: int, k: int) -> np.ndarray:
    return argument[:, width * k : width * (k + 1)].reshape(-1, 1, order="F")


@dataclass(frozen=True)
class LastIterate:
    """As `StageSolution`, with stages as columns."""

    status: Status
    x: np.ndarray
    u: np.ndarray
    cost: float
    iterations: int
    gap: float
    residual: float
    gradient: float
    sides: np.ndarray
    last_sides: np.ndarray


class InteriorPoint:
    """The method for one shape of problem. `real`: number type of all operations."""

    def __init__(
        self, stage: HorizonStage, count: int, last: HorizonStage, tolerance: float, max_iterations: int,
        functions: tuple[dict[str, ca.Function], dict[str, ca.Function]], real: Real = DOUBLE,
    ) -> None:  # fmt: skip
        self.real, self.count, self.stage = real, count, stage
        self.tolerance, self.max_iterations = real.dtype(tolerance), max_iterations
        self.of, self.end = StageEvaluator(functions[0], count, real), StageEvaluator(functions[1], 1, real)
        own, at_end = (s.positives // 2 for s in (stage, last))
        self.limits = real.dtype(max(count * own + at_end, 1))
        self.none, self.none_end = np.zeros((own, count), real.dtype), np.zeros((at_end, 1), real.dtype)

    def solve(self, x: np.ndarray, p: np.ndarray, q: np.ndarray, start: tuple[np.ndarray, ...] | None) -> LastIterate:
        """Return the solution from the state x with data p (numbers, count) and q (numbers, 1) from the inputs `start`,
        and its sides if it holds them."""
        with np.errstate(all="ignore"):
            return self._solved(x.reshape(-1, 1), p, q, start)

    def _solved(self, x: np.ndarray, p: np.ndarray, q: np.ndarray, start: tuple[np.ndarray, ...] | None) -> LastIterate:
        of, end, one = self.of, self.end, self.real.dtype(1.0)
        u = np.zeros((self.stage.inputs, self.count), self.real.dtype) if start is None else start[0]
        states, y, after, y_end, cost = self._followed(x, p, q, u)
        if start is None or len(start) == 1:
            s, s_end = of.each("begin", p, y)[0], end.each("begin", q, y_end)[0]
        else:
            s, s_end = of.each("push", start[1])[0], end.each("push", start[2])[0]
        iteration = 0
        while True:
            judged = zip(of.each("judge", p, y, s), end.each("judge", q, y_end, s_end), strict=True)
            gap, residual, excess, price = (self._sum(a, b) for a, b in judged)
            (g,) = end.each("adjoint", q, after, s_end)
            gradient = excess + self._sum(of.along("adjoint", [g], _back(p), _back(states), _back(u), _back(s))[1])
            total = cost + price
            status = self._judged(gap, residual, gradient, total)
            if status != Status.NOT_CONVERGED or iteration == self.max_iterations:
                break
            iteration += 1
            weight, slope = of.each("weigh", p, y, s, 0.0, self.none)
            weight_end, slope_end = end.each("weigh", q, y_end, s_end, 0.0, self.none_end)
            P, g = end.each("factor", q, after, weight_end, slope_end)
            factor = of.along("factor", [P, g], _back(p), _back(states), _back(u), _back(weight), _back(slope))
            K, k, lower, inverse, pivot = factor[2:]
            if not np.all(pivot > 0):
                status = Status.SINGULAR
                break
            gains = _blocks_back(K, self.count)
            aim = (self.real.dtype(0.0), self.none, self.none_end)
            du, ds, ds_end, product, product_end = self._changed(p, q, y, y_end, s, s_end, gains, _back(k), *aim)
            length = one / max(_reach(s, ds), _reach(s_end, ds_end), one)
            ahead = self._sum(of.each("ahead", s, ds, length)[0], end.each("ahead", s_end, ds_end, length)[0])
            ratio = ahead / gap
            centre = ratio * ratio * ratio * gap / self.limits
            slope = of.each("weigh", p, y, s, centre, product)[1]
            slope_end = end.each("weigh", q, y_end, s_end, centre, product_end)[1]
            (g,) = end.each("vector", q, after, slope_end)
            k = of.along("vector", [g], _back(p), _back(states), _back(u), _back(slope), K, lower, inverse)[1]
            aim = (centre, product, product_end)
            du, ds, ds_end, _, _ = self._changed(p, q, y, y_end, s, s_end, gains, _back(k), *aim)
            most = self.real.dtype(TO_BOUNDARY)
            length = most / max(_reach(s, ds), _reach(s_end, ds_end), most)
            u, s, s_end = u + length * du, s + length * ds, s_end + length * ds_end
            states, y, after, y_end, cost = self._followed(x, p, q, u)
        states = np.column_stack([states, after])
        return LastIterate(
            status, states, u, float(total), iteration, float(gap), float(residual), float(gradient), s, s_end
        )

    def _judged(self, gap: Any, residual: Any, gradient: Any, total: Any) -> Status:
        if not all(np.isfinite(value) for value in (gap, residual, gradient, total)):
            return Status.NOT_FINITE
        one, most = self.real.dtype(1.0), self.real.dtype(GRADIENT)
        allowed = self.tolerance * (one + abs(total))
        met = gap <= allowed and residual <= self.tolerance and gradient <= most * allowed
        return Status.OK if met else Status.NOT_CONVERGED

    def _followed(self, x: np.ndarray, p: np.ndarray, q: np.ndarray, u: np.ndarray) -> tuple[Any, ...]:
        """States before the stages, rows, last state, its rows, cost without prices."""
        after, y, cost = self.of.along("follow", [x], p, u)
        y_end, cost_end = self.end.each("follow", q, after[:, -1:])
        return np.column_stack([x, after[:, :-1]]), y, after[:, -1:], y_end, self._sum(cost, cost_end)

    def _changed(
        self, p: Any, q: Any, y: Any, y_end: Any, s: Any, s_end: Any, K: Any, k: Any, centre: Any, product: Any,
        product_end: Any,
    ) -> tuple[Any, ...]:  # fmt: skip
        """Steps of the inputs and the sides, and the products of these."""
        still = np.zeros((self.stage.states, 1), self.real.dtype)
        dx, du, dy = self.of.along("move", [still], p, K, k)
        ds, new = self.of.each("change", p, y, s, centre, product, dy)
        (dy_end,) = self.end.each("move", q, dx[:, -1:])
        ds_end, new_end = self.end.each("change", q, y_end, s_end, centre, product_end, dy_end)
        return du, ds, ds_end, new, new_end

    def _sum(self, *values: Any) -> Any:
        """Sum in order, as a loop in C adds up."""
        total = self.real.dtype(0.0)
        for value in np.concatenate([np.ravel(v) for v in values]):
            total = total + value
        return total


def _reach(s: np.ndarray, ds: np.ndarray) -> Any:
    """Largest decrease over the number that decreases."""
    return np.max(-ds / s, initial=s.dtype.type(0.0))


def _back(columns: np.ndarray) -> np.ndarray:
    return columns[:, ::-1]


def _blocks_back(K: np.ndarray, count: int) -> np.ndarray:
    return np.concatenate(np.split(K, count, axis=1)[::-1], axis=1)
