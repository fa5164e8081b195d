"""The primal-dual interior point method of a horizon, with the operations of C in their order (gt_stage_qp.h).

Predictor and corrector of Mehrotra (1992), from products of distance and multiplier whose sum is a multiple of the
cost: far from the limits' scale, that is what spares iterations. States and inputs change by steps that obey the
dynamics, so that these always hold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from ..cgen.newton_steps import run
from ..cgen.real import DOUBLE, Real
from ..results.status import Status
from .kernels import loops
from .stage import HorizonStage

FIRST, AGAIN = 300.0, 1.0  # first products: their sum over 1 + |cost|, without and with a start
COLD = 1.0  # least distance at the beginning
TO_BOUNDARY = 0.995
# the gap is not made smaller than this share of its tolerance: weights beyond only round off, in float to lost pivots
ENOUGH = {"double": 0.1, "float": 0.5}
GRADIENT = 10.0  # tolerances: the gradient, over that of the gap

Columns = list[np.ndarray]
Chain = Callable[..., list[Any]]  # of the call of a function by name, then what is carried, then the arguments


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
                use(k, a.data)  # pyrefly: ignore[missing-argument]

    def __call__(self, *arguments: Any) -> Columns:
        for own, given in zip(self.arguments, arguments, strict=True):
            if own.size:
                own[...] = given
        self._run()
        return [r.copy() for r in self.results]


class StageEvaluator:
    """Functions of a stage on the columns of all stages.

    `chains`: name -> operations of a stage in terms of the functions. CasADi must not simplify what one function does
    with the results of another: C does not either.
    """

    def __init__(
        self, functions: dict[str, ca.Function], count: int, real: Real, chains: Mapping[str, Chain] | None = None
    ) -> None:
        self.functions, self.count, self.real, self.chains = functions, count, real, chains or {}
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

    def along(self, name: str, carried: np.ndarray, *arguments: Any) -> Columns:
        """Evaluate a chain stage after stage: the first result goes into the first argument of the next stage. Returns
        the results of every stage."""
        chain = self.chains[name]
        if self.real is DOUBLE:
            if name not in self._built:
                f = self._chained(name, chain, [len(a) for a in (carried, *arguments)])
                self._built[name] = _Called(f.mapaccum(name, self.count))
            return self._built[name](carried, *arguments)
        now, results = np.reshape(carried, (-1, 1)), []
        for k in range(self.count):
            evaluated = chain(self._run, now, *[a[:, k : k + 1] for a in arguments])
            now = evaluated[0]
            results.append(evaluated)
        return [np.concatenate(r, axis=1) for r in zip(*results, strict=True)]

    def _run(self, name: str, *arguments: np.ndarray) -> Columns:
        return run(self.functions[name], arguments)

    def _chained(self, name: str, chain: Chain, sizes: Sequence[int]) -> ca.Function:
        given = [ca.MX.sym("a", size) for size in sizes]
        return ca.Function(name, given, chain(lambda of, *a: self.functions[of].call(list(a)), *given))


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


class _Limits:
    """Limits of the stages as columns, exact ones first: as gt_stage_qp_limits.h and gt_stage_qp_sides.h."""

    def __init__(self, stage: HorizonStage, count: int, real: Real) -> None:
        self.real, self.count = real, count
        self.row, self.rows = [d.row for d in stage.sides], len(stage.rows)
        self.sign = real.array([d.sign for d in stage.sides]).reshape(-1, 1)
        prices = [d.price for d in stage.sides if d.price is not None]
        self.a, self.b = real.array(prices).reshape(-1, 2, 1).transpose(1, 0, 2)
        self.n, self.m = len(stage.sides), len(prices)
        self.hard = self.n - self.m

    def begun(self, y: np.ndarray, bound: np.ndarray, centre: Any) -> None:
        self.bound = bound
        self.t = _larger(self.sign * y[self.row] - bound, self.real.dtype(COLD))
        self.l = centre / self.t
        self.v = np.repeat(self.a + self.b, self.count, axis=1)
        self.e = centre / self.v

    def pushed(self, bound: np.ndarray, s: np.ndarray, centre: Any) -> None:
        self.bound, n, m = bound, self.n, self.m
        self.t = self._centred(s[:n] - s[n : 2 * n] / centre)
        self.l = centre / self.t
        self.e = self._centred(s[2 * n : 2 * n + m] - s[2 * n + m :] / centre)
        self.v = centre / self.e

    def _centred(self, d: np.ndarray) -> np.ndarray:
        root = np.sqrt(d * d + self.real.dtype(4.0))
        return np.where(d > 0, self.real.dtype(0.5) * (root + d), self.real.dtype(2.0) / (root - d))

    def measured(self, y: np.ndarray) -> tuple[np.ndarray, ...]:
        """Terms of gap, residual, gradient of the excesses and price, in the order in which C adds them."""
        self.residual = self.sign * y[self.row] - self.bound - self.t
        self.residual[self.hard :] += self.e
        rise = self.b * self.e
        gap = self._beside(self.e * self.v, self.t * self.l)
        gradient = np.abs(self.a + rise - self.l[self.hard :] - self.v)
        return gap, np.abs(self.residual), gradient, (self.a + self.real.dtype(0.5) * rise) * self.e

    def _beside(self, of_excess: np.ndarray, of_limit: np.ndarray) -> np.ndarray:
        """Each excess before its limit."""
        pairs = np.stack([of_excess, of_limit[self.hard :]], axis=1).reshape(2 * self.m, self.count)
        return np.concatenate([of_limit[: self.hard], pairs])

    def weighed(self) -> tuple[np.ndarray, np.ndarray]:
        soft, one = slice(self.hard, None), self.real.dtype(1.0)
        self.over_t, self.over_e = one / self.t, one / self.e
        self.ratio = self.l * self.over_t
        self.fall = -self.a - self.b * self.e
        self.own = self.b + self.v * self.over_e
        self.over = one / (self.ratio[soft] + self.own)
        weight, steep = self.ratio.copy(), self.ratio * self.residual
        share = self.ratio[soft] * self.over
        weight[soft] = share * self.own
        steep[soft] = share * (self.own * self.residual[soft] + self.fall)
        return self._by_row(weight), self._by_row(self.sign * steep)

    def _by_row(self, values: np.ndarray) -> np.ndarray:
        total = np.zeros((self.rows, self.count), self.real.dtype)
        for i, value in zip(self.row, values, strict=True):
            total[i] += value
        return total

    def _distances(self, dy: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Changes of distances and excesses."""
        dt = self.sign * dy[self.row] + self.residual
        before = dt[self.hard :]
        de = (rest - self.ratio[self.hard :] * before) * self.over
        return np.concatenate([dt[: self.hard], (self.own * before + rest) * self.over]), de

    def tried(self, dy: np.ndarray) -> tuple[np.ndarray, Any, Any]:
        """Minus the products of the changes, in the order in which C adds them; least and largest share."""
        one = self.real.dtype(1.0)
        dt, de = self._distances(dy, self.fall)
        share, share_e = dt * self.over_t, de * self.over_e
        self.aim_e = de * (self.v * (one + share_e))
        self.aim = dt * (self.l * (one + share))
        return self._beside(self.aim_e, self.aim), _least(share, share_e), -_least(-share, -share_e)

    def aimed(self, centre: Any) -> np.ndarray:
        soft = slice(self.hard, None)
        self.aim = (centre + self.aim) * self.over_t
        self.aim_e = (centre + self.aim_e) * self.over_e
        steep = self.ratio * self.residual
        rest = self.aim[soft] + self.aim_e + self.fall
        steep[soft] = self.ratio[soft] * self.over * (self.own * self.residual[soft] + rest)
        return self._by_row(self.sign * (steep - self.aim))

    def changed(self, dy: np.ndarray) -> Any:
        """Least change over the number that changes."""
        rest = self.aim[self.hard :] + self.aim_e + self.fall
        self.dt, self.de = self._distances(dy, rest)
        self.dl = self.aim - self.ratio * self.dt - self.l
        self.dv = self.aim_e - self.v * self.over_e * self.de - self.v
        return _least(self.dt * self.over_t, self.dl / self.l, self.de * self.over_e, self.dv / self.v)

    def advanced(self, length: Any) -> None:
        self.t, self.l = self.t + length * self.dt, self.l + length * self.dl
        self.e, self.v = self.e + length * self.de, self.v + length * self.dv

    def multiplied(self) -> np.ndarray:
        """Slopes of the rows by the multipliers as they are."""
        return self._by_row(-(self.sign * self.l))

    @property
    def sides(self) -> np.ndarray:
        return np.concatenate([self.t, self.l, self.e, self.v])


def _larger(a: Any, b: Any) -> Any:
    return np.where(a > b, a, b)


def _least(*shares: np.ndarray) -> Any:
    """The least number below zero, or zero; NaN counts nothing."""
    flat = np.concatenate([s.ravel() for s in shares])
    return np.fmin.reduce(flat, initial=flat.dtype.type(0.0))


def _sum(start: Any, *parts: np.ndarray) -> Any:
    """Sum in order, as a loop over the stages adds up."""
    return np.add.accumulate(np.concatenate([[start], *[p.ravel(order="F") for p in parts]]))[-1]


class InteriorPoint:
    """The method for one shape of problem. `real`: number type of all operations."""

    def __init__(
        self, stage: HorizonStage, count: int, last: HorizonStage, tolerance: float, max_iterations: int,
        functions: tuple[dict[str, ca.Function], dict[str, ca.Function]], real: Real = DOUBLE,
    ) -> None:  # fmt: skip
        self.real, self.count, self.stage, self.last = real, count, stage, last
        self.tolerance, self.max_iterations = real.dtype(tolerance), max_iterations
        self.enough = real.dtype(enough(tolerance, real))
        self.of = StageEvaluator(functions[0] | loops(stage), count, real, _chains(stage.inputs))
        self.end = StageEvaluator(functions[1] | loops(last), 1, real)
        products = count * stage.positives // 2 + last.positives // 2
        self.products = real.dtype(max(products, 1))

    def solve(self, x: np.ndarray, p: np.ndarray, q: np.ndarray, start: tuple[np.ndarray, ...] | None) -> LastIterate:
        """Return the solution from the state x with data p (numbers, count) and q (numbers, 1) from the inputs `start`,
        and its sides if it holds them."""
        with np.errstate(all="ignore"):
            return self._solved(x.reshape(-1, 1), p, q, start)

    def _solved(self, x: np.ndarray, p: np.ndarray, q: np.ndarray, start: tuple[np.ndarray, ...] | None) -> LastIterate:
        of, end, one, zero = self.of, self.end, self.real.dtype(1.0), self.real.dtype(0.0)
        u = np.zeros((self.stage.inputs, self.count), self.real.dtype) if start is None else start[0]
        (bound, entries, b), (bound_end, entries_end) = of.each("given", p), end.each("given", q)
        after, y = of.along("follow", x, p, u, b)
        states = np.column_stack([x, after])
        (y_end,) = end.each("move", q, states[:, -1:])
        cost, by_x, by_u, by_end = self._graded(p, q, states, u)
        at, at_end = _Limits(self.stage, self.count, self.real), _Limits(self.last, 1, self.real)
        centre = self.real.dtype(FIRST if start is None else AGAIN) * (one + abs(cost)) / self.products
        if start is None:
            at.begun(y, bound, centre)
            at_end.begun(y_end, bound_end, centre)
        else:
            at.pushed(bound, start[1], centre)
            at_end.pushed(bound_end, start[2], centre)
        iteration = 0
        while True:
            terms = zip(at.measured(y), at_end.measured(y_end), strict=True)
            gap, residual, gradient, total = (
                _sum(first, *pair) for first, pair in zip((zero, zero, zero, cost), terms, strict=True)
            )
            status = self._judged(gap, residual, gradient, total)
            if status == Status.OK or iteration == self.max_iterations:
                (g,) = end.each("pull", q, at_end.multiplied(), by_end)
                h = of.along("pulled", g, _back(p), _back(at.multiplied()), _back(by_x), _back(by_u))[1]
                gradient = gradient + _sum(zero, np.abs(h))
                status = self._judged(gap, residual, gradient, total)
            if status != Status.NOT_CONVERGED or iteration == self.max_iterations:
                break
            iteration += 1
            (weight, slope), (weight_end, slope_end) = at.weighed(), at_end.weighed()
            (P,) = end.each("thickened", *end.each("factor", q), entries_end, weight_end)
            *gains, pivot = of.along("factored", P, _back(p), _back(entries), _back(weight))[1:]
            if not np.all(pivot > 0):
                status = Status.SINGULAR
                break
            _, du, dy, dy_end = self._stepped(p, q, slope, slope_end, by_x, by_u, by_end, gains)
            (minus, least, most), (minus_end, least_end, most_end) = at.tried(dy), at_end.tried(dy_end)
            reach = _larger(-min(least, least_end), one + max(most, most_end))
            length = one / _larger(reach, one)
            ratio = _larger(one - length - length * (length * (_sum(zero, minus, minus_end) / gap)), zero)
            least = self.enough * (one + abs(total))
            centre = _larger(ratio * (ratio * (ratio * gap)), least) / self.products
            slope, slope_end = at.aimed(centre), at_end.aimed(centre)
            dx, du, dy, dy_end = self._stepped(p, q, slope, slope_end, by_x, by_u, by_end, gains)
            reach, boundary = -min(at.changed(dy), at_end.changed(dy_end)), self.real.dtype(TO_BOUNDARY)
            length = boundary / _larger(reach, boundary)
            states, u, y, y_end = (a + length * b for a, b in ((states, dx), (u, du), (y, dy), (y_end, dy_end)))
            at.advanced(length)
            at_end.advanced(length)
            cost, by_x, by_u, by_end = self._graded(p, q, states, u)
        return LastIterate(
            status, states, u, float(total), iteration, float(gap), float(residual), float(gradient), at.sides,
            at_end.sides,
        )  # fmt: skip

    def _judged(self, gap: Any, residual: Any, gradient: Any, total: Any) -> Status:
        if not all(np.isfinite(value) for value in (gap, residual, gradient, total)):
            return Status.NOT_FINITE
        one, most = self.real.dtype(1.0), self.real.dtype(GRADIENT)
        allowed = self.tolerance * (one + abs(total))
        met = gap <= allowed and residual <= self.tolerance and gradient <= most * allowed
        return Status.OK if met else Status.NOT_CONVERGED

    def _graded(self, p: Any, q: Any, states: np.ndarray, u: np.ndarray) -> tuple[Any, ...]:
        """Cost without prices, and its derivatives."""
        cost, by_x, by_u = self.of.each("grade", p, states[:, :-1], u)
        cost_end, by_end = self.end.each("grade", q, states[:, -1:])
        return _sum(self.real.dtype(0.0), cost, cost_end), by_x, by_u, by_end

    def _stepped(
        self, p: Any, q: Any, slope: Any, slope_end: Any, by_x: Any, by_u: Any, by_end: Any, gains: Columns
    ) -> Columns:
        """Steps of states, inputs and rows; `gains`: with the inverse pivots, the last stage first."""
        gain, inverse = gains
        (g,) = self.end.each("pull", q, slope_end, by_end)
        k = self.of.along("backward", g, _back(p), _back(slope), _back(by_x), _back(by_u), gain, inverse)[1]
        still = np.zeros((self.stage.states, 1), self.real.dtype)
        after, du, dy = self.of.along("forward", still, p, _back(gain), _back(k))
        return [np.column_stack([still, after]), du, dy, *self.end.each("move", q, after[:, -1:])]


def enough(tolerance: float, real: Real) -> float:
    """Return the gap that is aimed at where it is already below its tolerance, relative to 1 + |cost|."""
    return ENOUGH[real.name] * tolerance


def _follow(call: Any, x: Any, p: Any, u: Any, b: Any) -> list[Any]:
    y, after = call("move", p, x, u)
    return [after + b, y]


def _pulled(call: Any, g: Any, p: Any, slope: Any, by_x: Any, by_u: Any) -> list[Any]:
    return call("pull", p, slope, by_x, by_u, g)


def _factored(inputs: int, call: Any, P: Any, p: Any, entries: Any, weight: Any) -> list[Any]:
    (H,) = call("thickened", *call("factor", p, P), entries, weight)
    (least,) = call("least", H)
    results = []
    for j in reversed(range(inputs)):
        inverse, room = call(f"pivot_{j}", H, least)
        H, gain = call(f"left_{j}", H, inverse)
        results.insert(0, (gain, inverse, room))
    return [H, *map(_stacked, zip(*results, strict=True))]


def _stacked(parts: Sequence[Any]) -> Any:
    return np.concatenate(parts) if isinstance(parts[0], np.ndarray) else ca.vertcat(*parts)


def _backward(call: Any, g: Any, p: Any, slope: Any, by_x: Any, by_u: Any, gain: Any, inverse: Any) -> list[Any]:
    return call("offset", *call("pull", p, slope, by_x, by_u, g), gain, inverse)


def _forward(call: Any, dx: Any, p: Any, gain: Any, offset: Any) -> list[Any]:
    (du,) = call("fed", dx, gain, offset)
    dy, after = call("move", p, dx, du)
    return [after, du, dy]


def _chains(inputs: int) -> dict[str, Chain]:
    return {"follow": _follow, "pulled": _pulled, "factored": partial(_factored, inputs), "backward": _backward,
            "forward": _forward}  # fmt: skip


def _back(columns: np.ndarray) -> np.ndarray:
    return columns[:, ::-1]
