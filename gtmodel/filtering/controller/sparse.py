"""Sparse matrices by their nonzero entries, their products as sums over terms, and simplified expressions of the
kernels of a filter."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from typing import Any

import casadi as ca
import numpy as np

from ...cgen.real import GenerationError
from ..system import System

Place = tuple[int, int]


@dataclass(frozen=True, eq=False)
class EntryMatrix:
    """Sparse matrix. places: of the entries, row after row. value: of each, 0 if it changes. changing: indices of the
    changing entries. expressions: of these."""

    shape: tuple[int, int]
    places: tuple[Place, ...]
    value: np.ndarray
    changing: np.ndarray
    expressions: Any

    @property
    def start(self) -> list[int]:
        """Index of the first entry of each row, and the total number."""
        count = np.bincount([i for i, _ in self.places], minlength=self.shape[0])
        return [0, *accumulate(count.tolist())]

    @property
    def columns(self) -> list[int]:
        """Column of each entry."""
        return [j for _, j in self.places]

    @cached_property
    def slots(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """First entries of all rows, second ones, ...: (rows, entries, columns)."""
        start, columns = np.array(self.start), np.array(self.columns, int)
        sizes, slots = np.diff(start), []
        for k in range(int(sizes.max(initial=0))):
            rows = np.flatnonzero(sizes > k)
            slots.append((rows, start[rows] + k, columns[start[rows] + k]))
        return slots

    def times(self, value: np.ndarray, matrix: np.ndarray) -> np.ndarray:
        """Return the product with a dense matrix; the terms of each entry are summed in the order of the row."""
        total = np.zeros((self.shape[0], matrix.shape[1]), matrix.dtype)
        for rows, entries, columns in self.slots:
            total[rows] = total[rows] + value[entries, None] * matrix[columns]
        return total

    def placed(self, rows: Sequence[int], columns: Mapping[int, int]) -> EntryMatrix:
        """Return the same entries with these rows numbered from 0, and renumbered columns."""
        row_of = {i: n for n, i in enumerate(rows)}
        places = tuple((row_of[i], columns[j]) for i, j in self.places)
        return EntryMatrix((len(rows), len(columns)), places, self.value, self.changing, self.expressions)

    @property
    def given(self) -> EntryMatrix:
        """The same matrix with all entries computed by a kernel, including constant ones."""
        items = [ca.SX(float(v)) for v in self.value]
        for n, k in enumerate(self.changing):
            items[k] = self.expressions[n]
        every = np.arange(len(items))
        return EntryMatrix(self.shape, self.places, 0 * self.value, every, ca.vertcat(*items) if items else ca.SX(0, 1))

    @property
    def transposed(self) -> EntryMatrix:
        """The transpose: entries column after column."""
        order = sorted(range(len(self.places)), key=lambda k: self.places[k][::-1])
        new = np.argsort(np.array(order, int))
        places = tuple((self.places[k][1], self.places[k][0]) for k in order)
        return EntryMatrix(
            (self.shape[1], self.shape[0]), places, self.value[order], new[self.changing], self.expressions
        )


def sparse_of(matrix: Any) -> EntryMatrix:
    """Entries of an SX matrix."""
    matrix = ca.sparsify(matrix)
    rows, columns = matrix.sparsity().get_triplet()
    order = sorted(range(len(rows)), key=lambda k: (rows[k], columns[k]))
    entries = matrix.nonzeros()
    value = np.array([float(entries[k]) if entries[k].is_constant() else 0.0 for k in order])
    changing = np.array([n for n, k in enumerate(order) if not entries[k].is_constant()], int)
    moved = [entries[order[n]] for n in changing]
    places = tuple((rows[k], columns[k]) for k in order)
    return EntryMatrix(tuple(matrix.shape), places, value, changing, ca.vertcat(*moved) if moved else ca.SX(0, 1))


def constant(matrix: np.ndarray) -> EntryMatrix:
    """Entries of a constant matrix."""
    return sparse_of(ca.SX(ca.DM(matrix)))


@dataclass(frozen=True, eq=False)
class EntryProduct:
    """Entries of C = A B: entry n sums the terms start[n] to start[n + 1], entry left[t] of A times right[t] of B."""

    start: tuple[int, ...]
    left: np.ndarray
    right: np.ndarray

    def applied(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Return the entries of C from those of A and B."""
        total = np.zeros(len(self.start) - 1, left.dtype)
        for rows, a, b in self.slots:
            total[rows] += left[a] * right[b]
        return total

    @cached_property
    def slots(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return the first terms of the sums of all entries, then the second terms, ...: (entries, left, right)."""
        sizes = np.diff(self.start)
        slots = []
        for k in range(int(sizes.max(initial=0))):
            rows = np.flatnonzero(sizes > k)
            terms = np.array(self.start)[rows] + k
            slots.append((rows, self.left[terms], self.right[terms]))
        return slots


def product(left: Sequence[Place], right: Sequence[Place], out: Sequence[Place]) -> EntryProduct:
    """Terms of the entries `out` of a product, with the inner index ascending."""
    of_row: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for n, (i, k) in enumerate(left):
        of_row[i].append((k, n))
    by_place = {place: n for n, place in enumerate(right)}
    terms = [[(n, by_place[k, j]) for k, n in sorted(of_row[i]) if (k, j) in by_place] for i, j in out]
    flat = [t for row in terms for t in row]
    start = tuple(accumulate([0, *map(len, terms)]))
    return EntryProduct(start, np.array([a for a, _ in flat], int), np.array([b for _, b in flat], int))


def picked(matrix: EntryMatrix, rows: set[int]) -> EntryMatrix:
    """Entries of some rows only."""
    entries = [n for n, (i, _) in enumerate(matrix.places) if i in rows]
    new = {n: k for k, n in enumerate(entries)}
    changes = [k for k, n in enumerate(matrix.changing) if n in new]
    changing = np.array([new[n] for n in matrix.changing[changes]], int)
    places = tuple(matrix.places[n] for n in entries)
    expressions = matrix.expressions
    moved = None if expressions is None else ca.vertcat(*[expressions[k] for k in changes]) if changes else ca.SX(0, 1)
    return EntryMatrix(matrix.shape, places, matrix.value[entries], changing, moved)


def without_ones(matrix: EntryMatrix) -> tuple[EntryMatrix, list[float]]:
    """A square matrix without the constant ones on its diagonal, and 1 for each row that had one, else 0."""
    moving = set(matrix.changing.tolist())
    one = {i for n, (i, j) in enumerate(matrix.places) if i == j and n not in moving and matrix.value[n] == 1.0}
    entries = [n for n, (i, j) in enumerate(matrix.places) if i != j or i not in one]
    new = {n: k for k, n in enumerate(entries)}
    left = EntryMatrix(
        matrix.shape, tuple(matrix.places[n] for n in entries), matrix.value[entries],
        np.array([new[n] for n in matrix.changing.tolist()], int), matrix.expressions,
    )  # fmt: skip
    return left, [1.0 if i in one else 0.0 for i in range(matrix.shape[0])]


def pattern(left: Sequence[Place], right: Sequence[Place]) -> list[Place]:
    """Places of the nonzero entries of a product."""
    of_row: dict[int, list[int]] = defaultdict(list)
    for k, j in right:
        of_row[k].append(j)
    return sorted({(i, j) for i, k in left for j in of_row[k]})


def closed(left: Sequence[Place], begin: Sequence[Place]) -> list[Place]:
    """Places of the nonzero entries of begin, left begin, left left begin, ..."""
    every = set(begin)
    while True:
        more = every | set(pattern(left, sorted(every)))
        if more == every:
            return sorted(every)
        every = more


SAME = 1e-12  # of the largest entry: entries that differ by less at random points are equal
POINTS = 20


@dataclass(frozen=True, eq=False)
class KernelExpressions:
    """Expressions of a kernel and their symbols."""

    symbols: list[Any]
    results: list[Any]

    def __getitem__(self, k: int) -> Any:
        return self.results[k]


class ExpressionMaker:
    """Makes scalar (SX) expressions from those of the system, which may contain functions."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.inputs = sum(system.dynamics.inputs.values())
        rng = np.random.default_rng(0)
        points = rng.normal(size=(POINTS, system.space.size))
        for part, at, _ in system.space.places():
            if part.kind != "vector":
                points[:, at] /= np.linalg.norm(points[:, at], axis=1)[:, None]
        self.points, self.rng = points, rng

    def kernel(
        self, name: str, sizes: Mapping[str, int], results: Callable[..., Any], upright: Sequence[int] = ()
    ) -> KernelExpressions:
        """Return results as expressions of columns of these sizes. For results in `upright`, entries that do not depend
        on attitude are evaluated at the identity, which needs fewer operations."""
        columns = [self.system.dynamics.symbol(key, size) for key, size in sizes.items()]
        try:
            function = ca.Function(name, columns, list(results(*columns))).expand()
        except RuntimeError as error:
            raise GenerationError(
                f"the model solves equations by iteration in '{name}'; generated filters do not support this"
            ) from error
        symbols = [ca.SX.sym(key, size) for key, size in sizes.items()]
        expressions: list[Any] = [ca.sparsify(r) for r in function.call(symbols)]
        for k in upright:
            expressions[k] = self._upright(expressions[k], symbols, [*sizes].index("x"))
        return KernelExpressions(symbols, expressions)

    def _upright(self, matrix: Any, symbols: list[Any], at_x: int) -> Any:
        x = symbols[at_x]
        still = ca.SX(x)
        for part, at, _ in self.system.space.places():
            if part.kind == "quaternion":
                still[at] = ca.SX([1.0, 0.0, 0.0, 0.0])
        other = ca.substitute(matrix, x, still)
        both = ca.Function("both", symbols, [ca.vec(ca.densify(matrix)), ca.vec(ca.densify(other))])
        rows = []
        for point in self.points:
            values = [point if k == at_x else self.rng.normal(size=s.numel()) for k, s in enumerate(symbols)]
            rows.append([np.asarray(r).ravel() for r in both.call([ca.DM(g) for g in values])])
        first, second = (np.array([row[k] for row in rows]) for k in (0, 1))
        scale = np.max(np.abs(first), initial=0.0) or 1.0
        same = np.max(np.abs(first - second), axis=0) <= SAME * scale
        steady = np.ptp(second, axis=0) <= SAME * scale
        entries = []
        flat, simple = ca.vec(ca.densify(matrix)), ca.vec(ca.densify(other))
        for k in range(flat.numel()):
            if not same[k]:
                entries.append(flat[k])
            elif steady[k]:
                value = float(second[0, k])
                entries.append(ca.SX(0.0 if abs(value) <= SAME * scale else value))
            else:
                entries.append(ca.simplify(simple[k]))
        return ca.sparsify(ca.reshape(ca.vertcat(*entries), *matrix.shape))

    def shared(self, kernel: KernelExpressions, H: EntryMatrix) -> EntryMatrix:
        """Return H, a function of (t, x, u, z). Entries equal to a subexpression of the residual, up to sign and for
        unit quaternions, reuse it: the derivative by a rotation is often a cross product with an existing term."""
        parts = _parts(kernel[0])
        both = ca.Function("both", kernel.symbols, [ca.vertcat(*parts), H.expressions])
        rows = []
        for point in self.points:
            inputs = [ca.DM(point if k == 1 else self.rng.normal(size=s.numel())) for k, s in enumerate(kernel.symbols)]
            rows.append([np.asarray(r).ravel() for r in both.call(inputs)])
        first, second = (np.array([row[k] for row in rows]) for k in (0, 1))
        entries = []
        for entry, values in zip(H.expressions.nonzeros(), second.T, strict=True):
            near = SAME * (np.max(np.abs(values)) or 1.0)
            signs = [(sign, np.max(np.abs(first - sign * values[:, None]), axis=0) <= near) for sign in (1, -1)]
            same_as = [(int(np.argmax(matches)), sign) for sign, matches in signs if np.any(matches)]
            changes = not entry.is_constant() and len(same_as) > 0
            entries.append(same_as[0][1] * parts[same_as[0][0]] if changes else entry)
        return replace(H, expressions=ca.vertcat(*entries)) if entries else H


def _parts(column: Any) -> list[Any]:
    """All subexpressions of the entries of a column, each once, without constants."""
    visited, pending, parts = set[int](), list(column.nonzeros()), []
    while pending:
        node = pending.pop()
        if node.is_constant() or node.element_hash() in visited:
            continue
        visited.add(node.element_hash())
        parts.append(node)
        pending += [node.dep(k) for k in range(node.n_dep())]
    return parts
