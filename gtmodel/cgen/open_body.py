"""The body of a large function with unsolved dense linear systems, and with the numbers of repeated parts as inputs.

In this form the six links of a robot are the same operations on six sets of numbers, so that `loops` can write them
once. C and Python solve the systems by the same elimination in loops instead of a written-out one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..compiler.blocks import Margin
from ..compiler.causal import CausalFunction
from ..compiler.emission import express
from ..compiler.flat import FlatModel
from ..compiler.plan import CausalPlan, make_plan
from ..compiler.rows import map_columns
from .newton_steps import eliminate, pivot_order

FEWEST = 3  # least number of equal parts for a loop
_ELEMENT = re.compile(r"(\w+)\[(\d+)((?:,\d+)*)\]$|(\w+)\[(\d+)\]\.(.+)$")
_PART = re.compile(r"(\w+)\[(\d+)\]\.")


@dataclass(frozen=True, eq=False)
class OpenBody:
    """`function`: (inputs..., unknowns of Newton blocks..., solution of each system..., numbers of the parts) ->
    (targets..., margins, matrix of each system by rows..., right-hand side of each system...).

    arguments, targets: numbers of inputs with Newton's unknowns, and of targets. sizes: of each system. shared: the
    first system with the same matrix. lanes: name and part of each number of the parts. values: these numbers.
    margins: those of the function, then the smallest pivot of each different matrix.
    """

    function: ca.Function
    arguments: int
    targets: int
    sizes: tuple[int, ...]
    shared: tuple[int, ...]
    lanes: tuple[tuple[str, int], ...]
    values: tuple[float, ...]
    margins: tuple[Margin, ...]

    @property
    def different(self) -> list[int]:
        """The systems with a matrix of their own."""
        return [k for k, first in enumerate(self.shared) if k == first]

    @property
    def outputs(self) -> list[int]:
        """Size of each target, and number of margins."""
        return [*[self.function.numel_out(k) for k in range(self.targets)], len(self.margins)]

    def evaluate(self, columns: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return targets and margins as columns, from inputs and Newton's unknowns as columns, as C computes them."""
        n, first = columns[0].shape[1], self.targets + 1
        solutions = [np.full((size, n), np.nan) for size in self.sizes]
        numbers = np.repeat(np.array(self.values)[:, None], n, axis=1)
        pivots = []
        for k, size in enumerate(self.sizes):
            results = map_columns(self.function, [*columns, *solutions, numbers])
            a = results[first + k].T.reshape(n, size, size).copy()
            b = results[first + len(self.sizes) + k].T.copy()
            _, x, smallest, _ = eliminate(a, b, 0.0, skipping=False)
            solutions[k] = x.T
            pivots.append(smallest)
        *targets, margins = map_columns(self.function, [*columns, *solutions, numbers])[:first]
        return [*targets, np.vstack([margins, *[pivots[k] for k in self.different]])]


def part_numbers(flat: FlatModel) -> dict[int, tuple[str, int]]:
    """Return (name, part) by index of each parameter of the most numerous equal parts.

    The parameters are elements of an array of parts, or of an array of the model with a row for each part. A parameter
    with the same value in all parts is not included.
    """
    counts: dict[str, int] = {}
    for v in flat.variables:
        part = _PART.match(v.name)
        if part:
            counts[part[1]] = max(counts.get(part[1], 0), int(part[2]) + 1)
    count = max(counts.values(), default=0)
    rows: dict[str, dict[int, int]] = {}
    for index, q in enumerate(flat.parameters):
        element = _ELEMENT.match(q.name)
        if element:
            name = f"{element[1]}[{element[3]}]" if element[1] else f"{element[4]}.{element[6]}"
            rows.setdefault(name, {})[int(element[2] or element[5])] = index
    return {
        index: (name, lane)
        for name, row in rows.items()
        if count >= FEWEST and sorted(row) == list(range(count))
        and len({flat.parameters[index].value for index in row.values()}) > 1
        for lane, index in row.items()
    }  # fmt: skip


def open_body(f: CausalFunction, symbol: str) -> OpenBody | None:
    """Return the body for the C name `symbol`; None if the model has no equal parts, or if it is solved differently
    when the numbers of the parts are symbols."""
    flat, lanes = f.flat, part_numbers(f.flat)
    if not lanes or f.plan.numbers is not None:  # numbers of parts may be inputs
        return None
    numbers = [q.symbol if index in lanes else ca.SX(q.value) for index, q in enumerate(flat.parameters)]
    known = [i for _, _, indices in f.groups for i in indices]
    pairs = [p for s in f.outputs for p in s.pairs]
    plan = make_plan(flat, known, pairs, f.preferred, f.branches, fold=ca.vertcat(*numbers))
    if plan.inputs != f.plan.inputs or _unknowns(plan) != _unknowns(f.plan) or plan.uses_time != f.plan.uses_time:
        return None
    solved = [b for b in plan.blocks if b.core is not None]
    cores = [b.core for b in solved if b.core is not None]
    solutions = [ca.SX.sym(f"x{k}", len(core.unknowns)) for k, core in enumerate(cores)]
    replaced = [
        pair
        for core, x in zip(cores, solutions, strict=True)
        for pair in zip(core.unknowns, ca.vertsplit(x), strict=True)
    ]
    inside = {id(m) for b in solved for m in b.margins}
    margins = [m for m in plan.margins if id(m) not in inside]
    targets = [ca.vertcat(*[plan.symbol(*p) for p in s.pairs]) for s in f.outputs]
    expressions = [
        *targets,
        ca.vertcat(*[m.expression for m in margins]) if margins else ca.SX(0, 1),
        *[core.matrix.T for core in cores],
        *[core.right for core in cores],
    ]
    results = ca.cse([ca.vec(ca.densify(e)) for e in express(plan, expressions, replaced)])
    signals = [s.pairs for s in f.inputs]
    arguments = [ca.vertcat(*[flat.scope.symbol(*p) for p in s]) for s in signals]
    arguments += [flat.scope.time] if plan.uses_time else []
    arguments += [ca.vertcat(*b.unknowns) for b in plan.newton]
    parts = ca.vertcat(*[flat.parameters[index].symbol for index in lanes])
    values = tuple(flat.parameters[index].value for index in lanes)
    sizes = [len(core.unknowns) for core in cores]
    first = len(targets) + 1

    def as_function(results: list[ca.SX]) -> ca.Function:
        return ca.Function(f"{symbol}_body", [*arguments, *solutions, parts], results)

    # rows in the order of partial pivoting at home, system after system
    home_values = [_home(plan, ca.vertsplit(column)) for column in arguments]
    solution = [np.zeros(size) for size in sizes]
    pivots, matrices = [], list[str]()
    for k, size in enumerate(sizes):
        numeric = as_function(results).call([*map(ca.DM, home_values), *map(ca.DM, solution), ca.DM(values)])
        a = np.array(numeric[first + k].full()).reshape(size, size)
        b = np.array(numeric[first + len(sizes) + k].full()).ravel()
        order = pivot_order(a)
        rows = ca.reshape(results[first + k], size, size)  # a column for each row of the matrix
        results[first + k] = ca.vec(rows[:, order])
        results[first + len(sizes) + k] = results[first + len(sizes) + k][order]
        _, x, smallest, regular = eliminate(a[None, order].copy(), b[None, order].copy(), 0.0)
        if not regular[0]:
            return None
        solution[k] = x[0]
        pivots.append(float(f"{float(smallest[0]):.6g}"))
        matrices.append(" ".join(str(e.element_hash()) for e in ca.vertsplit(results[first + k])))
    shared = tuple(matrices.index(m) for m in matrices)
    labels = [b.margins[0].label.rpartition(" (")[0] for b in solved]
    different = [k for k in range(len(sizes)) if shared[k] == k]
    pivot_margins = [Margin("pivot", ca.SX.sym(f"pivot{k}"), labels[k], pivots[k]) for k in different]
    return OpenBody(
        as_function(results), len(arguments), len(targets), tuple(sizes), shared, tuple(lanes.values()), values,
        (*margins, *pivot_margins),
    )  # fmt: skip


def _unknowns(plan: CausalPlan) -> list[list[int]]:
    return [[u.element_hash() for u in b.unknowns] for b in plan.newton]


def _home(plan: CausalPlan, symbols: Sequence[ca.SX]) -> list[float]:
    """Return the values of chain symbols at the home pose, and the start time."""
    positions = {pair: n for n, pair in enumerate(plan.pairs)}
    owners = [plan.flat.scope.owner(s) for s in symbols]
    home = plan.samples[0]
    return [float(home[positions[p]]) if p in positions else plan.sampler.time if p is None else 0.0 for p in owners]
