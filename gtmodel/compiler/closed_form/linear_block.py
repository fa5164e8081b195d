"""Solution of a linear block by sparse elimination; what has no allowed pivot, the core, by LDL^T, determinants or QR.

Allowed pivots are constants and parameters declared nonzero, never state-dependent expressions, with one exception. A
core that is symmetric and positive definite at the consistent points, as a mass matrix or the matrix of constraint
forces, stays positive definite until it is singular. None of its diagonal pivots can vanish before, in any order. So it
needs no QR; and its pivots may be taken among the others where they cause least fill-in. Along a tree of bodies this
is the recursion of articulated bodies, with operations linear in their number.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..blocks import EQUAL, DenseCore, Margin, SignAnalysis, pivot_cost
from ..matrices import difference, product, quotient, stacked, triplets

# relative difference of constants below which it is round-off of zero: entries are short decimals, seldom 1e-12
CANCELLED = 1e-13
# threshold pivoting: a pivot with a smaller ratio to the largest entry of its column would cost more than three digits
MIN_PIVOT_RATIO = 1e-3
# largest number of unknowns of a core that is solved with determinants
SMALL_CORE = 3
# largest number of unknowns of a full symmetric core that is tried where its pivots can be taken among the others
LARGE_CORE = 30
# cost of a pivot in a column that is held for the core
HELD_COST = 1e6

Assignments = list[tuple[ca.SX, ca.SX]]
Solution = tuple[Assignments, list[Margin], str, DenseCore | None]


def solve_linear(
    residuals: list[ca.SX],
    unknowns: list[ca.SX],
    jacobian: ca.SX,
    signs: SignAnalysis,
    label: str,
    held: Collection[int] = (),
) -> Solution:
    """Solve residuals == 0, linear in the unknowns, with the Jacobian of the residuals.

    held: positions of unknowns that are eliminated last, as the accelerations of states, which make a symmetric core.
    Returns assignments in order of computation, pivot margins of the core, a description, and the core if it has four
    or more unknowns and is solved apart from the rest.
    """
    at_zero = ca.substitute(stacked(residuals), stacked(unknowns), ca.SX.zeros(len(unknowns), 1))
    rhs = [-at_zero[i] for i in range(len(residuals))]
    filled = [(i, j, value) for i, j, value in triplets(jacobian) if not value.is_zero()]
    points = signs.values([value for *_, value in filled]).T.tolist()
    entries = [(i, j, _entry(value, point, signs)) for (i, j, value), point in zip(filled, points, strict=True)]
    chosen = _Elimination(entries, rhs, signs, _Constants(held))
    pairs = chosen.definite_pairs()
    if pairs is None:
        return chosen.solution(None, unknowns, label)
    mixed = _Elimination(entries, rhs, signs, _Mixed(chosen, pairs))
    kinds = [mixed] if not mixed.rows else []
    if not kinds or len(pairs) <= LARGE_CORE or 2 * sum(map(len, chosen.rows.values())) < len(pairs) ** 2:
        kinds.append(chosen)
    return min([k.solution(pairs, unknowns, label) for k in kinds], key=_operations)


def _operations(solution: Solution) -> int:
    return ca.n_nodes(ca.vertcat(*[value for _, value in solution[0]]))


class _Entry(NamedTuple):
    """A matrix entry, its kind as pivot, its values at the consistent points, and their typical size."""

    value: ca.SX
    kind: str | None
    points: list[float]
    size: float


def _entry(value: ca.SX, points: list[float], signs: SignAnalysis) -> _Entry:
    ordered = sorted(map(abs, points))
    size = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    return _Entry(value, signs.kind(value), points, size if all(map(math.isfinite, points)) else math.nan)


class _Constants:
    """Costs of pivots among constants and parameters."""

    def __init__(self, held: Collection[int] = ()) -> None:
        self._held = frozenset(held)

    def fill(self, row: int, column: int) -> int:
        """Return the entries that a pivot may fill in, for the counts of its row and column."""
        return (row - 1) * (column - 1)

    def cost(self, i: int, j: int, entry: _Entry, fill: int, largest: float) -> float:
        """Return the cost of entry (i, j), infinite if it is no allowed pivot or tiny relative to its column."""
        if entry.kind is None or not entry.size >= MIN_PIVOT_RATIO * largest:
            return math.inf
        return pivot_cost(entry.kind, fill, entry.size, largest) + HELD_COST * (j in self._held)

    def taken(self, i: int, j: int) -> Collection[int]:
        """Take note of a pivot, and return further rows whose costs change."""
        return ()


class _Mixed(_Constants):
    """Costs with the diagonal of a definite core, `pairs` of row and column, among the pivots.

    Such a pivot is allowed as soon as its entry equals the one that it has when all other equations are eliminated.
    """

    def __init__(self, core: _Elimination, pairs: Mapping[int, int]) -> None:
        super().__init__()
        self._pairs, self._columns = dict(pairs), set(pairs.values())
        self._place = {i: k for k, i in enumerate(pairs)}
        self._rest = core.numbers(list(pairs), list(pairs.values()))

    def fill(self, row: int, column: int) -> int:
        """Return the operations of a pivot; by fill-in alone the order would jump between bodies."""
        return 2 * (row - 1) * (column - 1) + row + column

    def cost(self, i: int, j: int, entry: _Entry, fill: int, largest: float) -> float:
        if i not in self._pairs:
            return math.inf if j in self._columns else super().cost(i, j, entry, fill, largest)
        if self._pairs[i] != j:
            return math.inf
        k = self._place[i]
        final = self._rest[:, k, k]
        if not np.all(np.abs(np.array(entry.points) - final) <= EQUAL * np.abs(final)):
            return math.inf
        return pivot_cost("constant", fill, entry.size, largest)

    def taken(self, i: int, j: int) -> Collection[int]:
        if i not in self._pairs:
            return ()
        a, k = self._rest, self._place[i]
        self._rest = a - a[:, :, k : k + 1] * a[:, k : k + 1, :] / a[:, k : k + 1, k : k + 1]
        return self._pairs


Step = tuple[int, dict[int, ca.SX], ca.SX, ca.SX]


class _Elimination:
    """Gaussian elimination with the cheapest pivot; `rows` are left without one, `steps` hold the unknown, the other
    entries of its row, the pivot and the right-hand side."""

    def __init__(
        self, entries: Sequence[tuple[int, int, _Entry]], rhs: list[ca.SX], signs: SignAnalysis, rule: _Constants
    ) -> None:
        self.rows: dict[int, dict[int, _Entry]] = {i: {} for i in range(len(rhs))}
        self.columns: dict[int, set[int]] = {}
        for i, j, entry in entries:
            self.rows[i][j] = entry
            self.columns.setdefault(j, set()).add(i)
        self.rhs, self._signs, self._rule = list(rhs), signs, rule
        self.steps: list[Step] = []
        self._varying: dict[int, ca.SX] = {}
        self._largest = {j: self._largest_of(j) for j in self.columns}
        best: dict[int, tuple[float, int]] = {}
        changed = set(self.rows)
        while True:
            for i in changed:
                cheapest = self._cheapest(i)
                if cheapest is None:
                    best.pop(i, None)
                else:
                    best[i] = cheapest
            if not best:
                break
            _, i, j = min((cost, i, j) for i, (cost, j) in best.items())
            del best[i]
            changed = self._eliminate(i, j)

    def _largest_of(self, j: int) -> float:
        largest = 0.0
        for i in self.columns[j]:
            size = self.rows[i][j].size
            largest = size if size > largest else largest
        return largest

    def _cheapest(self, i: int) -> tuple[float, int] | None:
        """Return the cost and the column of the cheapest pivot of a row; None if it has none."""
        best, row = (math.inf, -1), self.rows[i]
        for j in sorted(row):
            fill = self._rule.fill(len(row), len(self.columns[j]))
            if fill < best[0]:
                cost = self._rule.cost(i, j, row[j], fill, self._largest[j])
                best = min(best, (cost, j)) if cost < math.inf else best
        return best if best[1] >= 0 else None

    def _eliminate(self, i: int, j: int) -> set[int]:
        """Eliminate unknown j with row i, and return the rows whose costs may have changed."""
        row = self.rows.pop(i)
        pivot = row.pop(j)
        for k in row:
            self.columns[k].remove(i)
        others = sorted(self.columns.pop(j) - {i})
        for n in others:
            entries = self.rows[n]
            head = entries.pop(j)
            factor = quotient(head.value, pivot.value)
            numbers = [a / b for a, b in zip(head.points, pivot.points, strict=True)]
            self.rhs[n] = difference(self.rhs[n], product(factor, self.rhs[i]))
            for k, entry in row.items():
                old = entries.get(k)
                if old is None:
                    fresh = product(-factor, entry.value)
                    points = [-f * e for f, e in zip(numbers, entry.points, strict=True)]
                else:
                    fresh = _difference(old.value, product(factor, entry.value))
                    points = [o - f * e for o, f, e in zip(old.points, numbers, entry.points, strict=True)]
                if not fresh.is_zero():
                    entries[k] = _entry(fresh, points, self._signs)
                    self.columns[k].add(n)
                elif old is not None:
                    del entries[k]
                    self.columns[k].remove(n)
        for k in row:
            self._largest[k] = self._largest_of(k)
        self.steps.append((j, {k: e.value for k, e in row.items()}, pivot.value, self.rhs[i]))
        if pivot.kind is None:
            self._varying[j] = pivot.value
        changed = {n for k in row for n in self.columns[k]}.union(others, self._rule.taken(i, j))
        return changed & self.rows.keys()

    def numbers(self, rows: Sequence[int], columns: Sequence[int]) -> np.ndarray:
        """Return the remaining matrix at the consistent points (points, rows, columns)."""
        zero = [0.0] * self._signs.count
        entries = [[self.rows[i][j].points if j in self.rows[i] else zero for j in columns] for i in rows]
        return np.moveaxis(np.array(entries), -1, 0)

    def definite_pairs(self) -> dict[int, int] | None:
        """Return the rows of the core with their columns if it is symmetric and definite but for signs of the rows.

        None for a small core, and if there is only one point: it may be symmetric there by chance.
        """
        rows, columns = list(self.rows), sorted(j for j, inside in self.columns.items() if inside)
        n = len(rows)
        if n <= SMALL_CORE or self._signs.count == 1 or len(columns) != n:
            return None
        a = self.numbers(rows, columns)
        if not np.all(np.isfinite(a)):
            return None
        # the largest entry of what remains of a definite matrix is on its diagonal
        rest, pairs = a[0].copy(), dict[int, int]()
        for _ in range(n):
            i, j = np.unravel_index(np.argmax(np.abs(rest)), rest.shape)
            if rest[i, j] == 0.0:
                return None
            pairs[int(j)] = int(i)
            rest -= np.outer(rest[:, j], rest[i] / rest[i, j])
            rest[i], rest[:, j] = 0.0, 0.0
        order = [pairs[j] for j in range(n)]
        a = a[:, order]
        a *= np.sign(np.diagonal(a[0]))[:, None]
        size = np.sqrt(np.abs(np.diagonal(a, axis1=1, axis2=2)))
        if np.any(np.abs(a - a.transpose(0, 2, 1)) > EQUAL * size[:, :, None] * size[:, None, :]):
            return None
        try:
            np.linalg.cholesky(a)
        except np.linalg.LinAlgError:
            return None
        return {rows[i]: columns[j] for j, i in enumerate(order)}

    def solution(self, pairs: Mapping[int, int] | None, unknowns: list[ca.SX], label: str) -> Solution:
        """Solve what remains, `pairs` if it is definite, and return the assignments of all unknowns."""
        done = [Margin("pivot", pivot, f"{label} ({unknowns[j].name()})") for j, pivot in sorted(self._varying.items())]
        core: DenseCore | None = None
        first: Assignments = []
        detail = f"{len(self.steps)} pivots eliminated"
        if self.rows:
            first, done, core = self._core(pairs, unknowns, label)
            detail += f", {'dense' if pairs is None else 'symmetric'} core of {len(self.rows)}"
        elif self._varying:
            detail += f", {len(self._varying)} of them state-dependent"
        for j, row, pivot, value in reversed(self.steps):
            for k in sorted(row):
                value = difference(value, product(row[k], unknowns[k]))
            first.append((unknowns[j], quotient(value, pivot)))
        return first, done, detail, core

    def _core(
        self, pairs: Mapping[int, int] | None, unknowns: list[ca.SX], label: str
    ) -> tuple[Assignments, list[Margin], DenseCore | None]:
        """Solve what remains by division, determinants, LDL^T or QR; their pivots show how near it is to singular."""
        rows = sorted(self.rows) if pairs is None else list(pairs)
        columns = sorted(self.columns)
        n = len(rows)
        if n == 1:
            j, (pivot, *_) = next(iter(self.rows[rows[0]].items()))
            return [(unknowns[j], self.rhs[rows[0]] / pivot)], [Margin("pivot", pivot, label)], None
        a, b = ca.SX.zeros(n, n), ca.vertcat(*[self.rhs[i] for i in rows])
        for r, i in enumerate(rows):
            for c, j in enumerate(columns):
                if j in self.rows[i]:
                    a[r, c] = self.rows[i][j].value
            if pairs is not None and self.rows[i][pairs[i]].points[0] < 0:
                a[r, :], b[r] = -a[r, :], -b[r]
        x, pivots = (_definite if pairs is not None else _determinants if n <= SMALL_CORE else _gram_schmidt)(a, b)
        named = zip(columns, pivots, strict=True)
        margins = [Margin("pivot", p, f"{label} ({unknowns[j].name()})") for j, p in named]
        core = DenseCore([unknowns[j] for j in columns], a, b) if n > SMALL_CORE else None
        return [(unknowns[j], x[c]) for c, j in enumerate(columns)], margins, core


def _difference(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return a - b; exactly zero if two constants cancel up to round-off."""
    new = difference(a, b)
    if new.is_constant() and abs(float(new)) <= CANCELLED * abs(float(a)):
        return ca.SX(0)
    return new


def _definite(a: ca.SX, b: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Solve by LDL^T for a symmetric definite matrix, and return D; the next unknown has the fewest others in its row.

    Of two equal entries one is computed: those of the triangle that needs fewer operations.
    """
    n = a.shape[0]
    lower = [(i, j) for i in range(n) for j in range(i)]
    nodes = [ca.n_nodes(ca.vertcat(*[a[p] for p in half])) for half in (lower, [(j, i) for i, j in lower])]
    rest: dict[int, dict[int, ca.SX]] = {i: {i: a[i, i]} for i in range(n)}
    for i, j in lower:
        if not a[i, j].is_zero() and not a[j, i].is_zero():
            rest[i][j] = rest[j][i] = a[i, j] if nodes[0] <= nodes[1] else a[j, i]
    right = ca.vertsplit(b)
    steps: list[tuple[int, dict[int, ca.SX], ca.SX]] = []
    pivots = [ca.SX(0)] * n
    while rest:
        i = min(rest, key=lambda i: (len(rest[i]), i))
        row = rest.pop(i)
        pivots[i] = row.pop(i)
        inverse = quotient(ca.SX(1), pivots[i])
        for p in sorted(row):
            del rest[p][i]
            factor = product(row[p], inverse)
            right[p] = difference(right[p], product(factor, right[i]))
            for q in sorted(k for k in row if k >= p):
                rest[p][q] = rest[q][p] = difference(rest[p].get(q, ca.SX(0)), product(factor, row[q]))
        steps.append((i, row, inverse))
    x = [ca.SX(0)] * n
    for i, row, inverse in reversed(steps):
        value = right[i]
        for k in sorted(row):
            value = difference(value, product(row[k], x[k]))
        x[i] = product(value, inverse)
    return x, pivots


def _determinants(a: ca.SX, b: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Solve for two or three unknowns with determinants, and return the diagonal of R: two thirds of QR's operations.

    Any column may come first in R; with this order gcc uses registers best. Near a loss of rank the error grows with
    the condition number, as for QR; with its square only if three columns are nearly parallel.
    """
    if a.shape[0] == 2:
        first = ca.norm_2(a[:, 0])
        d = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
        x = [b[0] * a[1, 1] - a[0, 1] * b[1], a[0, 0] * b[1] - b[0] * a[1, 0]]
        return [value / d for value in x], [first, d / first]
    last, first, second = ca.horzsplit(a)
    normal, moment = ca.cross(first, second), ca.cross(last, b)
    length, area, d = ca.norm_2(first), ca.norm_2(normal), ca.dot(normal, last)
    x = [ca.dot(normal, b), ca.dot(second, moment), -ca.dot(first, moment)]
    return [value / d for value in x], [d / area, length, area / length]


def _gram_schmidt(a: ca.SX, b: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Solve for any number of unknowns, and return the diagonal of R.

    The right-hand side is reduced like another column. Computing Q^T b instead would include the loss of orthogonality
    of Q, an error of cond^2 instead of cond.
    """
    rest = ca.horzcat(a, b)
    rows: list[ca.SX] = []
    pivots: list[ca.SX] = []
    for _ in range(a.shape[0]):
        pivots.append(ca.norm_2(rest[:, 0]))
        q = rest[:, 0] / pivots[-1]
        rows.append(q.T @ rest[:, 1:])
        rest = rest[:, 1:] - q @ rows[-1]
    x: list[ca.SX] = []
    for pivot, row in zip(reversed(pivots), reversed(rows), strict=True):
        value = row[-1]
        for k, known in enumerate(x):
            value = value - row[k] * known
        x.insert(0, value / pivot)
    return x, pivots
