"""Sparse elimination of linear equations with symbolic entries, whose values at consistent points are carried along."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..blocks import EQUAL, SignAnalysis, pivot_cost
from ..matrices import difference, product, quotient

# relative difference of constants below which it is round-off of zero: entries are short decimals, seldom 1e-12
CANCELLED = 1e-13
# relative difference of values at general points up to which expressions are equal
SHARED = 1e-12
# threshold pivoting: a pivot with a smaller ratio to the largest entry of its column would cost more than three digits
MIN_PIVOT_RATIO = 1e-3
# largest number of unknowns of a core that is solved with determinants
SMALL_CORE = 3
# cost of a pivot in a column that is held for the core
HELD_COST = 1e6


class Entry(NamedTuple):
    """A matrix entry, its kind as pivot, its values at the consistent points and then at general ones, and the typical
    size of the former."""

    value: ca.SX
    kind: str | None
    points: list[float]
    size: float


def entry_of(value: ca.SX, points: list[float], signs: SignAnalysis) -> Entry:
    at_points = points[: signs.count]
    ordered = sorted(map(abs, at_points))
    size = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    return Entry(value, signs.kind(value), points, size if all(map(math.isfinite, at_points)) else math.nan)


class Constants:
    """Costs of pivots among constants and parameters.

    ranks: by row, the only column that is a good pivot, -1 if none is, and the rank of the row: rows with pivots of
    lower rank come first.
    """

    def __init__(self, held: Collection[int] = (), ranks: Mapping[int, tuple[int, int]] | None = None) -> None:
        self.held, self.ranks = frozenset(held), ranks or {}
        self._last = 1 + max([rank for _, rank in self.ranks.values()], default=0)

    def fill(self, row: int, column: int) -> int:
        """Return the entries that a pivot may fill in, for the counts of its row and column."""
        return (row - 1) * (column - 1)

    def cost(self, i: int, j: int, entry: Entry, fill: int, largest: float) -> float:
        """Return the cost of entry (i, j), infinite if it is no allowed pivot or tiny relative to its column."""
        if entry.kind is None or not entry.size >= MIN_PIVOT_RATIO * largest:
            return math.inf
        column, rank = self.ranks.get(i, (j, 0))
        late = self._last if column != j or j in self.held else rank
        return pivot_cost(entry.kind, fill, entry.size, largest) + HELD_COST * late

    def taken(self, i: int, j: int) -> Collection[int]:
        """Take note of a pivot, and return further rows whose costs change."""
        return ()


class Mixed(Constants):
    """Costs with the diagonal of a definite core, `pairs` of row and column, among the pivots.

    Such a pivot is allowed as soon as its entry equals the one that it has when all other equations are eliminated.
    """

    def __init__(self, core: Elimination, pairs: Mapping[int, int]) -> None:
        held = {core.pivots[j]: (j, 0) for j in core.rule.held if j in core.pivots} if core.rule.ranks else {}
        super().__init__((), {**core.rule.ranks, **held})
        self._pairs, self._columns = dict(pairs), set(pairs.values())
        self._place = {i: k for k, i in enumerate(pairs)}
        self._rest = core.numbers(list(pairs), list(pairs.values()))

    def fill(self, row: int, column: int) -> int:
        """Return the operations of a pivot; by fill-in alone the order would jump between bodies."""
        return 2 * (row - 1) * (column - 1) + row + column

    def cost(self, i: int, j: int, entry: Entry, fill: int, largest: float) -> float:
        if i not in self._pairs:
            return math.inf if j in self._columns else super().cost(i, j, entry, fill, largest)
        if self._pairs[i] != j:
            return math.inf
        k = self._place[i]
        final = self._rest[:, k, k]
        if not np.all(np.abs(np.array(entry.points[: len(final)]) - final) <= EQUAL * np.abs(final)):
            return math.inf
        return pivot_cost("constant", fill, entry.size, largest)

    def taken(self, i: int, j: int) -> Collection[int]:
        if i not in self._pairs:
            return ()
        a, k = self._rest, self._place[i]
        self._rest = a - a[:, :, k : k + 1] * a[:, k : k + 1, :] / a[:, k : k + 1, k : k + 1]
        return self._pairs


class SolvedRow(NamedTuple):
    """An equation solved for an unknown: the other entries of its row, the pivot, and the right-hand side."""

    column: int
    row: dict[int, ca.SX]
    pivot: ca.SX
    value: ca.SX


class Values:
    """Expressions by their values at general points, which follow those at the consistent points in an entry's list.

    Analytic functions of free symbols are equal if they are equal at some random points: constant, zero, or an
    expression that exists. So symmetric entries are computed once, and products of rotation matrices with their
    transposes vanish. Consistent points do not show this: they lie near home, where powers of small angles vanish.
    """

    def __init__(self, first: int) -> None:
        """first: number of consistent points."""
        self._first = first
        self._known: dict[tuple[str, ...], tuple[ca.SX, list[float]]] = {}

    def shared(self, value: ca.SX, points: list[float], size: list[float]) -> ca.SX:
        """Return the expression for these values; size: the values of the larger term of a sum, to recognise zero."""
        if value.is_constant():
            return value
        points, size = points[self._first :], size[self._first :]
        if all(abs(x) <= CANCELLED * abs(s) for x, s in zip(points, size, strict=True)):
            return ca.SX(0)
        if all(abs(x - points[0]) <= CANCELLED * abs(points[0]) for x in points):
            return ca.SX(points[0])
        sign = 1.0 if points[0] > 0 else -1.0
        known, of_known = self._known.setdefault(tuple(f"{sign * x:.9e}" for x in points), (value, points))
        turned = 1.0 if (of_known[0] > 0) == (points[0] > 0) else -1.0
        if known is value or any(abs(x - turned * y) > SHARED * abs(x) for x, y in zip(points, of_known, strict=True)):
            return value
        return known if turned > 0 else -known


class Elimination:
    """Gaussian elimination with the cheapest pivot; `rows` are left without one, `pivots` are rows by column, `varying`
    pivots that are neither constants nor parameters."""

    def __init__(
        self, entries: Sequence[tuple[int, int, Entry]], rhs: list[ca.SX], signs: SignAnalysis, rule: Constants,
        values: Values | None = None,
    ) -> None:  # fmt: skip
        self.rows: dict[int, dict[int, Entry]] = {i: {} for i in range(len(rhs))}
        self.columns: dict[int, set[int]] = {}
        for i, j, entry in entries:
            self.rows[i][j] = entry
            self.columns.setdefault(j, set()).add(i)
        self.rhs, self._signs, self.rule, self._values = list(rhs), signs, rule, values
        self.steps: list[SolvedRow] = []
        self.pivots: dict[int, int] = {}
        self._factors: list[tuple[int, int, ca.SX]] = []
        self.varying: dict[int, ca.SX] = {}
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
            fill = self.rule.fill(len(row), len(self.columns[j]))
            if fill < best[0]:
                cost = self.rule.cost(i, j, row[j], fill, self._largest[j])
                best = min(best, (cost, j)) if cost < math.inf else best
        return best if best[1] >= 0 else None

    def _eliminate(self, i: int, j: int) -> set[int]:
        """Eliminate unknown j with row i, and return the rows whose costs may have changed."""
        row = self.rows.pop(i)
        pivot = row.pop(j)
        self.pivots[j] = i
        for k in row:
            self.columns[k].remove(i)
        others = sorted(self.columns.pop(j) - {i})
        for n in others:
            entries = self.rows[n]
            head = entries.pop(j)
            factor = quotient(head.value, pivot.value)
            numbers = [a / b for a, b in zip(head.points, pivot.points, strict=True)]
            self.rhs[n] = difference(self.rhs[n], product(factor, self.rhs[i]))
            self._factors.append((i, n, factor))
            for k, entry in row.items():
                old = entries.get(k)
                if old is None:
                    fresh = product(-factor, entry.value)
                    points = [-f * e for f, e in zip(numbers, entry.points, strict=True)]
                else:
                    fresh = _difference(old.value, product(factor, entry.value))
                    points = [o - f * e for o, f, e in zip(old.points, numbers, entry.points, strict=True)]
                if self._values is not None:
                    fresh = self._values.shared(fresh, points, points if old is None else old.points)
                if not fresh.is_zero():
                    entries[k] = entry_of(fresh, points, self._signs)
                    self.columns[k].add(n)
                elif old is not None:
                    del entries[k]
                    self.columns[k].remove(n)
        for k in row:
            self._largest[k] = self._largest_of(k)
        self.steps.append(SolvedRow(j, {k: e.value for k, e in row.items()}, pivot.value, self.rhs[i]))
        if pivot.kind is None:
            self.varying[j] = pivot.value
        changed = {n for k in row for n in self.columns[k]}.union(others, self.rule.taken(i, j))
        return changed & self.rows.keys()

    def with_right(self, rhs: list[ca.SX]) -> None:
        """Replace the right-hand sides."""
        self.rhs = list(rhs)
        for i, n, factor in self._factors:
            self.rhs[n] = difference(self.rhs[n], product(factor, self.rhs[i]))
        self.steps = [step._replace(value=self.rhs[self.pivots[step.column]]) for step in self.steps]

    def numbers(self, rows: Sequence[int], columns: Sequence[int]) -> np.ndarray:
        """Return the remaining matrix at the consistent points (points, rows, columns)."""
        zero = [0.0] * self._signs.count
        entries = [[self.rows[i][j].points[: len(zero)] if j in self.rows[i] else zero for j in columns] for i in rows]
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


def _difference(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return a - b; exactly zero if two constants cancel up to round-off."""
    new = difference(a, b)
    if new.is_constant() and abs(float(new)) <= CANCELLED * abs(float(a)):
        return ca.SX(0)
    return new
