"""A function with Newton blocks, cut into what C calls: constants and kernel of each block, then the targets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from ..compiler.analysis.sizes import Sizes
from ..compiler.blocks import Margin
from ..compiler.causal import CausalFunction, CausalSignal
from ..compiler.emission import express
from ..compiler.plan import CausalPlan
from ..compiler.rows import map_columns, status_codes
from ..lang.scope import derivative_name
from ..results.status import Status
from .lanes import Lanes, lanes_of, lines_of
from .loops import can_be_written
from .newton_steps import eliminate, newton, pivot_order, run
from .open_body import open_body
from .real import DOUBLE, Real

# instructions of a body that is worth a look, and how many times shorter the text must become: what a loop stores and
# loads again is paid by the elimination that it goes with
LARGE, SHORTER = 1000, 3


@dataclass(frozen=True, eq=False)
class NewtonStage:
    """One Newton block in C. `prepare`: (inputs..., unknowns of earlier blocks...) -> (constants, margins); `kernel`:
    (unknowns, constants) -> (residual, Jacobian by rows), rows as partial pivoting takes them at home. `home` solves
    the block at the home pose; `nominal`, `largest` (both inverted) and `least` are what gt_newton wants."""

    prepare: ca.Function
    kernel: ca.Function
    margins: tuple[Margin, ...]
    unknowns: tuple[CausalSignal, ...]
    home: tuple[float, ...]
    nominal: tuple[float, ...]
    largest: tuple[float, ...]
    least: float

    @property
    def size(self) -> int:
        """How many unknowns the block has."""
        return len(self.home)

    @property
    def constants(self) -> int:
        """How many numbers the kernel needs beside its unknowns."""
        return self.prepare.size1_out(0)


@dataclass(frozen=True, eq=False)
class Stages:
    """The blocks in order, and `body`: (inputs..., unknowns of all blocks...) -> (targets..., margins). Where `loops`
    are given, C computes and Python evaluates these in its place, and `margins` are theirs."""

    newton: tuple[NewtonStage, ...]
    body: ca.Function
    margins: tuple[Margin, ...]
    loops: Lanes | None = None


def stages(f: CausalFunction, symbol: str, real: Real = DOUBLE) -> Stages:
    """Cut `f` for the C name `symbol`; limits are those of `real`. The function keeps the answer: generating its C,
    checking and measuring it each ask for it.

    What a block needs of the inputs is computed once before its steps, and a margin as soon as it can be.
    """
    if (symbol, real) not in f.kept:
        f.kept[symbol, real] = _stages(f, symbol, real)
    return f.kept[symbol, real]


def _stages(f: CausalFunction, symbol: str, real: Real) -> Stages:
    plan, flat = f.plan, f.flat
    args = [ca.vertcat(*[flat.scope.symbol(*p) for p in s.pairs]) for s in f.inputs]
    args += [flat.scope.time] if plan.uses_time else []
    zs = [ca.vertcat(*b.unknowns) for b in plan.newton]
    targets = [ca.vertcat(*[plan.symbol(*p) for p in s.pairs]) for s in f.outputs]
    residuals = [ca.vertcat(*b.residuals) for b in plan.newton]
    remaining = iter(express(plan, [*targets, *residuals, *(m.expression for m in f.margins)]))
    targets, residuals = ([next(remaining) for _ in wanted] for wanted in (targets, residuals))
    margins = list(remaining)
    due = [_due(e, zs) for e in margins]

    def at(k: int) -> tuple[ca.SX, tuple[Margin, ...]]:
        here = [n for n, d in enumerate(due) if d == k]
        return _column([margins[n] for n in here]), tuple(f.margins[n] for n in here)

    blocks = []
    for k, (block, r, z) in enumerate(zip(plan.newton, residuals, zs, strict=True)):
        home = np.array(f.kernels[k].residual(f.kernels[k].z0, f.kernels[k].a0)[1].full())
        order = pivot_order(home)
        r = ca.densify(r)[order]
        r, jacobian = ca.cse([r, ca.densify(ca.jacobian(r, z))])
        inner, constants, outer = _hoisted([r, ca.vec(jacobian.T)], z)
        expressions, here = at(k)
        given = [*args, *zs[:k]]
        prepare = ca.Function(f"{symbol}_prepare{k}", given, ca.cse([outer, expressions]))
        kernel = ca.Function(f"{symbol}_kernel{k}", [z, constants], ca.cse(inner))
        pairs = [p for p in map(flat.scope.owner, ca.vertsplit(z)) if p is not None]
        blocks.append(
            NewtonStage(
                prepare, kernel, here, tuple(_signals(plan, pairs)), tuple(samples_of(f, pairs)[0].tolist()),
                tuple(1.0 / float(x) for x in block.scale), *_limits(home[order], block.scale, real),
            )
        )  # fmt: skip
    expressions, here = at(len(zs))
    body = ca.Function(f"{symbol}_body", [*args, *zs], ca.cse([*map(ca.densify, targets), expressions]))
    loops = loops_of(f, symbol, body) if real is DOUBLE else None
    if loops is not None:
        before = {id(m) for block in blocks for m in block.margins}
        here = tuple(m for m in loops.body.margins if id(m) not in before)
    return Stages(tuple(blocks), body, here, loops)


def loops_of(f: CausalFunction, symbol: str, body: ca.Function) -> Lanes | None:
    """The body with loops over equal parts, where it is large and these make less than 1 / SHORTER of it."""
    if body.n_instructions() < LARGE:
        return None
    opened = open_body(f, symbol)
    lanes = None if opened is None else lanes_of(opened)
    if lanes is None or not can_be_written(lanes) or SHORTER * lines_of(lanes) > body.n_instructions():
        return None
    return lanes


def samples_of(f: CausalFunction, pairs: Sequence[tuple[int, int]]) -> np.ndarray:
    """Values (samples, pairs) of chain symbols at the consistent points of a function; 0 where none is known."""
    position = {pair: n for n, pair in enumerate(f.plan.pairs)}
    values = np.zeros((len(f.plan.samples), len(pairs)))
    for column, pair in enumerate(pairs):
        if pair in position:
            # six digits: the noise of another linear algebra library must not reach the generated text
            values[:, column] = [float(f"{x:.6g}") for x in f.plan.samples[:, position[pair]]]
        elif f.flat.variables[pair[0]].role == "parameter":  # kept as an input, at its own value
            values[:, column] = f.flat.variables[pair[0]].start or 0.0
    return values


def _due(expression: ca.SX, zs: Sequence[ca.SX]) -> int:
    """How many blocks must be solved before the expression can be computed."""
    symbols = {s.element_hash() for s in ca.symvar(expression)}
    return max([k + 1 for k, z in enumerate(zs) if symbols & {s.element_hash() for s in ca.vertsplit(z)}], default=0)


def _column(expressions: list[ca.SX]) -> ca.SX:
    return ca.densify(ca.vertcat(*expressions)) if expressions else ca.SX(0, 1)


def _hoisted(expressions: list[ca.SX], z: ca.SX) -> tuple[list[ca.SX], ca.SX, ca.SX]:
    """The expressions of z and of new symbols, the column of these symbols, and what they stand for."""
    unknown = {s.element_hash() for s in ca.vertsplit(z)}
    column = ca.vertcat(*expressions)
    known = [s for s in ca.symvar(column) if s.element_hash() not in unknown]
    if not known:
        return expressions, ca.SX(0, 1), ca.SX(0, 1)
    inner, symbols, outer = ca.extract_parametric(column, ca.vertcat(*known), {"extract_trivial": True})
    rows = np.cumsum([0, *[e.numel() for e in expressions]])
    parts = [inner[int(a) : int(b)] for a, b in pairwise(rows)]
    return [ca.densify(p) for p in parts], ca.vertcat(*symbols), ca.densify(ca.vertcat(*outer))


def _limits(jacobian: np.ndarray, nominal: np.ndarray, real: Real) -> tuple[tuple[float, ...], float]:
    """Of residuals, inverted, and of pivots, by what they are with the Jacobian at home."""
    rows = np.abs(jacobian) @ nominal
    _, _, smallest, _ = eliminate(jacobian[None].copy(), np.zeros((1, len(rows))), 0.0)
    largest = tuple(float(f"{1.0 / (real.residual * x):.3g}") for x in rows)
    return largest, float(f"{real.pivot * float(smallest[0]):.3g}")


def _signals(plan: CausalPlan, pairs: Sequence[tuple[int, int]]) -> list[CausalSignal]:
    """The unknowns in their order, gathered into declared vectors where these are complete and in line."""
    flat, left = plan.flat, list(pairs)
    vectors = [(name, shape, list(indices)) for name, (shape, indices) in flat.groups.items() if shape]
    result = []
    while left:
        order = left[0][1]
        name, shape, size = flat.variables[left[0][0]].name, (), 1
        for vector, vector_shape, indices in vectors:
            if left[: len(indices)] == [(i, order) for i in indices] and len(indices) > size:
                name, shape, size = vector, vector_shape, len(indices)
        head, left = left[:size], left[size:]
        result.append(CausalSignal(derivative_name(name, order), shape, flat.unit_of(head[0][0], order), tuple(head)))
    return result


def evaluate_stages(
    cut: Stages, inputs: Sequence[np.ndarray], start: np.ndarray, sizes: Sizes, real: Real = DOUBLE
) -> tuple[np.ndarray, np.ndarray]:
    """Targets and new states side by side (rows, m), NaN without a solution, and statuses (rows,), as C decides them.

    inputs: rows of each input; start (rows, unknowns of all blocks); both of the numbers `real`. sizes: how large the
    inputs may be.
    """
    evaluated = map_columns if real is DOUBLE else run
    rows = len(start)
    finite = np.all([np.isfinite(x).all(axis=1) for x in [*inputs, start]], axis=0)
    small = sizes.within([x.T for x in inputs]) if inputs else True
    status = np.where(finite, np.where(small, 0, Status.OUT_OF_RANGE), Status.NOT_FINITE)
    given, first = [x.T for x in inputs], 0
    for stage in cut.newton:
        constants, margins = evaluated(stage.prepare, given)
        status = np.where(status == 0, status_codes(stage.margins, [], [margins], None, real.pivot), status)
        live = np.flatnonzero(status == 0)
        z = np.full((rows, stage.size), np.nan, real.dtype)
        here = constants[:, live]

        def kernel(z: np.ndarray, chosen: np.ndarray, stage: NewtonStage = stage, here: np.ndarray = here):
            r, jacobian = evaluated(stage.kernel, [z.T, here[:, chosen]])
            return r.T.copy(), jacobian.T.reshape(len(z), stage.size, stage.size).copy()

        begin = start[live, first : first + stage.size]
        nominal, largest = real.array(stage.nominal), real.array(stage.largest)
        root, verdict = newton(kernel, begin, nominal, largest, real.dtype(stage.least), real.round_off)
        z[live], status[live] = root, verdict
        given, first = [*given, z.T], first + stage.size
    results = evaluated(cut.body, given) if cut.loops is None else cut.loops.body.evaluate(given)
    status = np.where(status == 0, status_codes(cut.margins, [], results, None, real.pivot), status)
    values = np.vstack([*results[:-1], *given[len(inputs) :]]).T.copy()
    values[status != Status.OK] = np.nan
    return values, status
