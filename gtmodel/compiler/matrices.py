"""Matrices: entries of symbolic ones as scalars and what is computed of these, constant sparse ones, functions on
NumPy's own memory, and QR with column pivoting, under types that checkers understand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import casadi as ca
import numpy as np

# of the right side: a solution of linear equations that leaves less solves them
SOLVED = 1e-6


def nonzeros(m: ca.SX) -> list[ca.SX]:
    """Structural nonzeros, column by column."""
    return cast("list[ca.SX]", m.nonzeros())


def triplets(m: ca.SX) -> list[tuple[int, int, ca.SX]]:
    """(row, column, value) of the structural nonzeros, column by column."""
    return list(zip(*m.sparsity().get_triplet(), nonzeros(m), strict=True))


def elements(m: ca.SX) -> list[ca.SX]:
    """All elements of a matrix, column by column."""
    return ca.vertsplit(ca.vec(ca.densify(m)))


def stacked(values: list[ca.SX]) -> ca.SX:
    """A column of scalars; an empty one where there is none. One alone is a column already."""
    if len(values) == 1:
        return values[0]
    return ca.vertcat(*values) if values else ca.SX(0, 1)


def total(a: ca.SX, b: ca.SX) -> ca.SX:
    """a + b of two scalars. CasADi's operators, which give the same, first try whether these are numbers: ten times as
    long as the operation."""
    return ca.SX.binary(ca.OP_ADD, a, b)


def difference(a: ca.SX, b: ca.SX) -> ca.SX:
    """a - b, as `total`."""
    return ca.SX.binary(ca.OP_SUB, a, b)


def product(a: ca.SX, b: ca.SX) -> ca.SX:
    """a * b, as `total`."""
    return ca.SX.binary(ca.OP_MUL, a, b)


def quotient(a: ca.SX, b: ca.SX) -> ca.SX:
    """a / b, as `total`."""
    return ca.SX.binary(ca.OP_DIV, a, b)


def left_over(a: np.ndarray, b: np.ndarray, rank: float) -> np.ndarray:
    """What is left of a x = b after a least-norm solution with weights, solved with columns of equal size.

    Weights of columns say which of several solutions is taken. Where they differ by many orders of magnitude, some
    directions fall below the rank that the weighted matrix is cut at, although the equations have a solution there.
    Zero where they have none.
    """
    size = np.max(np.abs(a), axis=0, initial=0.0)
    own = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    x = own * np.linalg.lstsq(a * own, b, rcond=rank)[0]
    return x if np.linalg.norm(b - a @ x) <= SOLVED * np.linalg.norm(b) else np.zeros_like(x)


def pivoted_qr(a: np.ndarray, mode: str = "full") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Q, R and the column order, largest remaining column first; mode "full" or "economic"."""
    import scipy  # here: a causality without it starts sooner

    return cast("tuple[np.ndarray, np.ndarray, np.ndarray]", scipy.linalg.qr(a, mode=mode, pivoting=True))


def called(f: ca.Function, *arguments: np.ndarray | float) -> list[np.ndarray]:
    """The numbers of each result that are not always zero, column by column. Arguments are dense: a column, or for a
    matrix its columns as rows (n, height). To make a matrix of CasADi would cost 0.2 us a number.

    >>> import casadi as ca
    >>> from gtmodel.compiler.matrices import called
    >>> x = ca.SX.sym("x", 2)
    >>> called(ca.Function("f", [x], [x[0] * x[1], ca.diag(x)]), np.array([2.0, 3.0]))
    [array([6.]), array([2., 3.])]
    """
    buffer: Any
    buffer, run = f.buffer()
    given: list[Any] = [np.ascontiguousarray(a, dtype=float) for a in arguments]
    results: list[Any] = [np.zeros(f.nnz_out(k)) for k in range(f.n_out())]
    for k, a in enumerate(given):
        if a.size != f.nnz_in(k):
            raise ValueError(f"argument {k} of {f.name()} has {f.nnz_in(k)} numbers; found {a.size}")
        if a.size:
            buffer.set_arg(k, memoryview(a))
    for k, r in enumerate(results):
        if r.size:
            buffer.set_res(k, memoryview(r))
    run()
    return results


@dataclass(frozen=True, eq=False)
class SparseMatrix:
    """A constant matrix: its entries row by row, and within a row column by column; `of` sums those at one place.

    Without scipy.sparse, whose import takes longer than what collocation asks of it.

    >>> from gtmodel.compiler.matrices import SparseMatrix
    >>> m = SparseMatrix.of([1, 0, 1], [0, 1, 0], [2.0, 3.0, 4.0], (2, 2))
    >>> m.rows.tolist(), m.columns.tolist(), m.values.tolist()
    ([0, 1], [1, 0], [3.0, 6.0])
    """

    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    shape: tuple[int, int]

    @classmethod
    def of(
        cls,
        rows: Sequence[int] | np.ndarray,
        columns: Sequence[int] | np.ndarray,
        values: Sequence[float] | np.ndarray,
        shape: tuple[int, int],
    ) -> SparseMatrix:
        places = np.asarray(rows, int) * shape[1] + np.asarray(columns, int)
        places, where = np.unique(places, return_inverse=True)
        summed = np.bincount(where, weights=values, minlength=len(places))
        return cls(places // max(shape[1], 1), places % max(shape[1], 1), summed, shape)

    @classmethod
    def picked(cls, place: np.ndarray, height: int) -> SparseMatrix:
        """With a one in each column, in row `place`."""
        return cls.of(place, np.arange(len(place)), np.ones(len(place)), (height, len(place)))

    @property
    def T(self) -> SparseMatrix:
        return SparseMatrix.of(self.columns, self.rows, self.values, (self.shape[1], self.shape[0]))

    def among(self, begin: int, end: int) -> SparseMatrix:
        """The rows from `begin` on, before `end`."""
        own = slice(*np.searchsorted(self.rows, [begin, end]))
        return SparseMatrix(self.rows[own] - begin, self.columns[own], self.values[own], (end - begin, self.shape[1]))

    def of_rows(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The entries of these rows one after the other: number of the row among these, column, value."""
        begin, end = (np.searchsorted(self.rows, rows, side=side) for side in ("left", "right"))
        count = end - begin
        number = np.repeat(np.arange(len(rows)), count)
        at = np.arange(len(number)) + np.repeat(begin - np.cumsum(count) + count, count)
        return number, self.columns[at], self.values[at]

    @property
    def dm(self) -> ca.DM:
        """For CasADi, by its constructor of sparsities, which is five times faster than the one of matrices."""
        order = np.lexsort((self.rows, self.columns))
        begins = np.concatenate([[0], np.cumsum(np.bincount(self.columns, minlength=self.shape[1]))])
        return ca.DM(ca.Sparsity(*self.shape, begins.tolist(), self.rows[order].tolist()), self.values[order])


def stacked_rows(parts: Sequence[SparseMatrix]) -> SparseMatrix:
    """One matrix below the other."""
    begins = np.cumsum([0, *[p.shape[0] for p in parts]])
    rows = np.concatenate([p.rows + begin for p, begin in zip(parts, begins[:-1], strict=True)])
    columns, values = (np.concatenate([getattr(p, name) for p in parts]) for name in ("columns", "values"))
    return SparseMatrix(rows, columns, values, (int(begins[-1]), parts[0].shape[1]))
