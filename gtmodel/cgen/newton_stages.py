"""A function with Newton blocks, split into the bodies that C calls: constants and kernels of blocks, then targets."""

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
from .jacobian_function import DerivativeFunction
from .lanes import Lanes, lanes_of, lines_of
from .loops import can_be_written
from .newton_steps import eliminate, newton, pivot_order, run
from .open_body import open_body
from .real import DOUBLE, Real

# least instructions of a body for which loops are tried, and how many times shorter its text must become: the loops
# cost stores and loads, which the elimination in loops outweighs
LARGE, SHORTER = 1000, 3


@dataclass(frozen=True, eq=False)
class NewtonStage:
    """One Newton block in C. `prepare`: (inputs..., unknowns of earlier blocks...) -> (constants, margins); `kernel`:
    (unknowns, constants) -> (residual, Jacobian by rows), rows in the order of partial pivoting at home. `home` solves
    the block at the home pose. `nominal`, `largest` (both inverted) and `least` are the arguments of gt_newton."""

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
        """Number of unknowns of the block."""
        return len(self.home)

    @property
    def constants(self) -> int:
        """Number of constants that the kernel takes beside its unknowns."""
        return self.prepare.size1_out(0)


@dataclass(frozen=True, eq=False)
class Stages:
    """The blocks in order, and `body`: (inputs..., unknowns of all blocks...) -> (targets..., margins). If `loops`
    is not None, C and Python evaluate it instead of `body`, and `margins` are those of `loops`."""

    newton: tuple[NewtonStage, ...]
    body: ca.Function
    margins: tuple[Margin, ...]
    loops: Lanes | None = None


def stages(f: CausalFunction, symbol: str, real: Real = DOUBLE) -> Stages:
    """Split `f` for the C name `symbol`, with the limits of `real`. The result is cached in the function, because
    generating, checking and measuring its C code all need it.

    The expressions of a block that depend only on the inputs are computed once before its steps, and each margin as
    soon as its unknowns are solved.
    """
    if (symbol, real) not in f.kept:
        f.kept[symbol, real] = _stages(f, symbol, real)
    return f.kept[symbol, real]


def _stages(f: CausalFunction, symbol: str, real: Real) -> Stages:
    plan, flat = f.plan, f.flat
    args = [ca.vertcat(*[flat.scope.symbol(*p) for p in s.pairs]) for s in f.inputs]
    args += [flat.scope.time] if plan.uses_time else []
    zs = [ca.vertcat(*b.unknowns) for b in plan.newton]
    targets = [
        ca.vertcat(*[plan.symbol(*p) for p in s.pairs])
        for s in (f.of if isinstance(f, DerivativeFunction) else f).outputs
    ]
    residuals = [ca.vertcat(*b.residuals) for b in plan.newton]
    remaining = iter(express(plan, [*targets, *residuals, *(m.expression for m in f.margins)]))
    targets, residuals = ([next(remaining) for _ in group] for group in (targets, residuals))
    if isinstance(f, DerivativeFunction):
        targets = f.derived(targets, residuals, args[: len(f.inputs)], zs)
    margins = list(remaining)
    due = [_due(e, zs) for e in margins]

    def due_after(k: int) -> tuple[ca.SX, tuple[Margin, ...]]:
        indices = [n for n, d in enumerate(due) if d == k]
        return _column([margins[n] for n in indices]), tuple(f.margins[n] for n in indices)

    blocks = []
    for k, (block, r, z) in enumerate(zip(plan.newton, residuals, zs, strict=True)):
        home = np.array(f.kernels[k].residual(f.kernels[k].z0, f.kernels[k].a0)[1].full())
        order = pivot_order(home)
        r = ca.densify(r)[order]
        r, jacobian = ca.cse([r, ca.densify(ca.jacobian(r, z))])
        inner, constants, outer = _hoisted([r, ca.vec(jacobian.T)], z)
        expressions, stage_margins = due_after(k)
        arguments = [*args, *zs[:k]]
        prepare = ca.Function(f"{symbol}_prepare{k}", arguments, ca.cse([outer, expressions]))
        kernel = ca.Function(f"{symbol}_kernel{k}", [z, constants], ca.cse(inner))
        pairs = [p for p in map(flat.scope.owner, ca.vertsplit(z)) if p is not None]
        blocks.append(
            NewtonStage(
                prepare, kernel, stage_margins, tuple(_signals(plan, pairs)), tuple(samples_of(f, pairs)[0].tolist()),
                tuple(1.0 / float(x) for x in block.scale), *_limits(home[order], block.scale, real),
            )
        )  # fmt: skip
    expressions, stage_margins = due_after(len(zs))
    body = ca.Function(f"{symbol}_body", [*args, *zs], ca.cse([*map(ca.densify, targets), expressions]))
    loops = loops_of(f, symbol, body) if real is DOUBLE else None
    if loops is not None:
        before = {id(m) for block in blocks for m in block.margins}
        stage_margins = tuple(m for m in loops.body.margins if id(m) not in before)
    return Stages(tuple(blocks), body, stage_margins, loops)


def loops_of(f: CausalFunction, symbol: str, body: ca.Function) -> Lanes | None:
    """Return the body as loops over equal parts, if it is large, calls no external function, and the loops have at most
    1 / SHORTER of its lines."""
    if body.n_instructions() < LARGE or f.flat.scope.calls or isinstance(f, DerivativeFunction):
        return None
    opened = open_body(f, symbol)
    lanes = None if opened is None else lanes_of(opened)
    if lanes is None or not can_be_written(lanes) or SHORTER * lines_of(lanes) > body.n_instructions():
        return None
    return lanes


def samples_of(f: CausalFunction, pairs: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return the values (samples, pairs) of chain symbols at the consistent points of a function; 0 if unknown."""
    position = {pair: n for n, pair in enumerate(f.plan.pairs)}
    values = np.zeros((len(f.plan.samples), len(pairs)))
    for column, pair in enumerate(pairs):
        if pair in position:
            # six digits: round-off of another linear algebra library must not change the generated text
            values[:, column] = [float(f"{x:.6g}") for x in f.plan.samples[:, position[pair]]]
        elif f.flat.variables[pair[0]].role == "parameter":  # kept as an input, at its own value
            values[:, column] = f.flat.variables[pair[0]].start or 0.0
    return values


def _due(expression: ca.SX, zs: Sequence[ca.SX]) -> int:
    """Return how many blocks must be solved before the expression can be computed."""
    symbols = {s.element_hash() for s in ca.symvar(expression)}
    return max([k + 1 for k, z in enumerate(zs) if symbols & {s.element_hash() for s in ca.vertsplit(z)}], default=0)


def _column(expressions: list[ca.SX]) -> ca.SX:
    return ca.densify(ca.vertcat(*expressions)) if expressions else ca.SX(0, 1)


def _hoisted(expressions: list[ca.SX], z: ca.SX) -> tuple[list[ca.SX], ca.SX, ca.SX]:
    """Return the expressions in z and in new symbols, the column of these symbols, and their expressions."""
    unknown = {s.element_hash() for s in ca.vertsplit(z)}
    column = ca.vertcat(*expressions)
    inputs = [s for s in ca.symvar(column) if s.element_hash() not in unknown]
    if not inputs:
        return expressions, ca.SX(0, 1), ca.SX(0, 1)
    inner, symbols, outer = ca.extract_parametric(column, ca.vertcat(*inputs), {"extract_trivial": True})
    rows = np.cumsum([0, *[e.numel() for e in expressions]])
    parts = [inner[int(a) : int(b)] for a, b in pairwise(rows)]
    return [ca.densify(p) for p in parts], ca.vertcat(*symbols), ca.densify(ca.vertcat(*outer))


def _limits(jacobian: np.ndarray, nominal: np.ndarray, real: Real) -> tuple[tuple[float, ...], float]:
    """Return the limits of residuals, inverted, and of pivots, from the Jacobian at the home pose."""
    rows = np.abs(jacobian) @ nominal
    _, _, smallest, _ = eliminate(jacobian[None].copy(), np.zeros((1, len(rows))), 0.0)
    largest = tuple(float(f"{1.0 / (real.residual * x):.3g}") for x in rows)
    return largest, float(f"{real.pivot * float(smallest[0]):.3g}")


def _signals(plan: CausalPlan, pairs: Sequence[tuple[int, int]]) -> list[CausalSignal]:
    """Return the unknowns in their order, as declared vectors if all elements follow one another."""
    flat, remaining = plan.flat, list(pairs)
    vectors = [(name, shape, list(indices)) for name, (shape, indices) in flat.groups.items() if shape]
    result = []
    while remaining:
        order = remaining[0][1]
        name, shape, size = flat.variables[remaining[0][0]].name, (), 1
        for vector, vector_shape, indices in vectors:
            if remaining[: len(indices)] == [(i, order) for i in indices] and len(indices) > size:
                name, shape, size = vector, vector_shape, len(indices)
        head, remaining = remaining[:size], remaining[size:]
        result.append(CausalSignal(derivative_name(name, order), shape, flat.unit_of(head[0][0], order), tuple(head)))
    return result


def evaluate_stages(
    cut: Stages, inputs: Sequence[np.ndarray], start: np.ndarray, sizes: Sizes, real: Real = DOUBLE
) -> tuple[np.ndarray, np.ndarray]:
    """Return targets and new states side by side (rows, m), NaN without a solution, and the statuses (rows,) of C.

    inputs: rows of each input; start: (rows, unknowns of all blocks); both of the number type `real`. sizes: limits of
    the inputs.
    """
    evaluated = map_columns if real is DOUBLE else run
    rows = len(start)
    finite = np.all([np.isfinite(x).all(axis=1) for x in [*inputs, start]], axis=0)
    small = sizes.within([x.T for x in inputs]) if inputs else True
    status = np.where(finite, np.where(small, 0, Status.OUT_OF_RANGE), Status.NOT_FINITE)
    columns, first = [x.T for x in inputs], 0
    for stage in cut.newton:
        constants, margins = evaluated(stage.prepare, columns)
        status = np.where(status == 0, status_codes(stage.margins, [], [margins], None, real.pivot), status)
        live = np.flatnonzero(status == 0)
        z = np.full((rows, stage.size), np.nan, real.dtype)
        live_constants = constants[:, live]

        def kernel(z: np.ndarray, chosen: np.ndarray, stage: NewtonStage = stage, fixed: np.ndarray = live_constants):
            r, jacobian = evaluated(stage.kernel, [z.T, fixed[:, chosen]])
            return r.T.copy(), jacobian.T.reshape(len(z), stage.size, stage.size).copy()

        begin = start[live, first : first + stage.size]
        nominal, largest = real.array(stage.nominal), real.array(stage.largest)
        root, verdict = newton(kernel, begin, nominal, largest, real.dtype(stage.least), real.round_off)
        z[live], status[live] = root, verdict
        columns, first = [*columns, z.T], first + stage.size
    results = evaluated(cut.body, columns) if cut.loops is None else cut.loops.body.evaluate(columns)
    status = np.where(status == 0, status_codes(cut.margins, [], results, None, real.pivot), status)
    values = np.vstack([*results[:-1], *columns[len(inputs) :]]).T.copy()
    values[status != Status.OK] = np.nan
    return values, status
