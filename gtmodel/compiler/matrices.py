"""Matrices: entries of symbolic matrices, fast scalar operations, constant sparse matrices, calls on NumPy memory, and
QR with column pivoting, with types for checkers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import casadi as ca
import numpy as np

# largest residual of a solution of linear equations, relative to the right-hand side
SOLVED = 1e-6


def nonzeros(m: ca.SX) -> list[ca.SX]:
    """Return the structural nonzeros, column by column."""
    return cast("list[ca.SX]", m.nonzeros())


def triplets(m: ca.SX) -> list[tuple[int, int, ca.SX]]:
    """Return (row, column, value) of the structural nonzeros, column by column."""
    return list(zip(*m.sparsity().get_triplet(), nonzeros(m), strict=True))


def elements(m: ca.SX) -> list[ca.SX]:
    """Return all elements of a matrix, column by column."""
    return ca.vertsplit(ca.vec(ca.densify(m)))


def stacked(values: list[ca.SX]) -> ca.SX:
    """Return a column of scalars, possibly empty."""
    if len(values) == 1:
        return values[0]
    return ca.vertcat(*values) if values else ca.SX(0, 1)


def total(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return a + b for two scalars. CasADi's operators give the same result, but first test whether the operands are
    numbers, which takes ten times as long as the operation."""
    return ca.SX.binary(ca.OP_ADD, a, b)


def difference(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return a - b, see `total`."""
    return ca.SX.binary(ca.OP_SUB, a, b)


def product(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return a * b, see `total`."""
    return ca.SX.binary(ca.OP_MUL, a, b)


def quotient(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return a / b, see `total`."""
    return ca.SX.binary(ca.OP_DIV, a, b)


def substituted_in_order(
    symbols: Sequence[ca.SX], values: Sequence[ca.SX], results: Sequence[ca.SX], calls: bool
) -> list[ca.SX]:
    """Return `results` with each symbol replaced by its value, which may contain the symbols before it.

    calls: whether expressions may contain calls of functions, which ca.substitute_inplace would lose.
    """
    if not calls:
        return ca.substitute_inplace(list(symbols), list(values), list(results))[1]
    replaced: list[ca.SX] = []
    for k, value in enumerate(values):
        replaced.append(ca.substitute([value], list(symbols[:k]), replaced)[0] if k else value)
    return ca.substitute(list(results), list(symbols), replaced)


def left_over(a: np.ndarray, b: np.ndarray, rank: float) -> np.ndarray:
    """Return a correction to a weighted least-norm solution: solve a x = b with columns of equal size.

    Column weights select one of several solutions. If they differ by many orders of magnitude, the rank tolerance of
    the weighted matrix cuts off directions in which the equations have a solution. Returns zero if the equations have
    no solution.
    """
    size = np.max(np.abs(a), axis=0, initial=0.0)
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    x = scale * np.linalg.lstsq(a * scale, b, rcond=rank)[0]
    return x if np.linalg.norm(b - a @ x) <= SOLVED * np.linalg.norm(b) else np.zeros_like(x)


def pivoted_qr(a: np.ndarray, mode: str = "full") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Q, R and the column order, largest remaining column first; mode "full" or "economic"."""
    import scipy  # not needed by every causality, and slow to import

    return cast("tuple[np.ndarray, np.ndarray, np.ndarray]", scipy.linalg.qr(a, mode=mode, pivoting=True))


def called(f: ca.Function, *arguments: np.ndarray | float) -> list[np.ndarray]:
    """Call a function and return the structural nonzeros of each result, column by column.

    Arguments are dense: a column, or for a matrix its columns as rows (n, height). Creating CasADi matrices would take
    0.2 us per number.

    >>> import casadi as ca
    >>> from gtmodel.compiler.matrices import called
    >>> x = ca.SX.sym("x", 2)
    >>> called(ca.Function("f", [x], [x[0] * x[1], ca.diag(x)]), np.array([2.0, 3.0]))
    [array([6.]), array([2., 3.])]
    """
    buffer: Any
    buffer, run = f.buffer()
    inputs: list[Any] = [np.ascontiguousarray(a, dtype=float) for a in arguments]
    results: list[Any] = [np.zeros(f.nnz_out(k)) for k in range(f.n_out())]
    for k, a in enumerate(inputs):
        if a.size != f.nnz_in(k):
            raise ValueError(f"argument {k} of {f.name()} needs {f.nnz_in(k)} numbers; found {a.size}")
        if a.size:
            buffer.set_arg(k, memoryview(a))  # pyrefly: ignore[missing-argument]
    for k, r in enumerate(results):
        if r.size:
            buffer.set_res(k, memoryview(r))  # pyrefly: ignore[missing-argument]
    run()
    return results


@dataclass(frozen=True, eq=False)
class SparseMatrix:
    """A constant sparse matrix, sorted by row and then by column; `of` sums entries at the same position.

    It avoids scipy.sparse, whose import takes longer than the operations that collocation needs.

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
        positions = np.asarray(rows, int) * shape[1] + np.asarray(columns, int)
        positions, where = np.unique(positions, return_inverse=True)
        sums = np.bincount(where, weights=values, minlength=len(positions))
        return cls(positions // max(shape[1], 1), positions % max(shape[1], 1), sums, shape)

    @classmethod
    def picked(cls, place: np.ndarray, height: int) -> SparseMatrix:
        """Return a matrix with a one in each column, in row `place`."""
        return cls.of(place, np.arange(len(place)), np.ones(len(place)), (height, len(place)))

    @property
    def T(self) -> SparseMatrix:
        return SparseMatrix.of(self.columns, self.rows, self.values, (self.shape[1], self.shape[0]))

    def among(self, begin: int, end: int) -> SparseMatrix:
        """Return the rows begin, ..., end - 1."""
        part = slice(*np.searchsorted(self.rows, [begin, end]))
        shape = (end - begin, self.shape[1])
        return SparseMatrix(self.rows[part] - begin, self.columns[part], self.values[part], shape)

    def of_rows(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the entries of these rows in order: position of the row in `rows`, column, value."""
        begin, end = (np.searchsorted(self.rows, rows, side=side) for side in ("left", "right"))
        count = end - begin
        number = np.repeat(np.arange(len(rows)), count)
        entries = np.arange(len(number)) + np.repeat(begin - np.cumsum(count) + count, count)
        return number, self.columns[entries], self.values[entries]

    @property
    def dm(self) -> ca.DM:
        """The matrix as ca.DM. The constructor of sparsities is five times faster than the one of matrices."""
        order = np.lexsort((self.rows, self.columns))
        begins = np.concatenate([[0], np.cumsum(np.bincount(self.columns, minlength=self.shape[1]))])
        return ca.DM(ca.Sparsity(*self.shape, begins.tolist(), self.rows[order].tolist()), self.values[order])


def stacked_rows(parts: Sequence[SparseMatrix]) -> SparseMatrix:
    """Stack matrices vertically."""
    begins = np.cumsum([0, *[p.shape[0] for p in parts]])
    rows = np.concatenate([p.rows + begin for p, begin in zip(parts, begins[:-1], strict=True)])
    columns, values = (np.concatenate([getattr(p, name) for p in parts]) for name in ("columns", "values"))
    return SparseMatrix(rows, columns, values, (int(begins[-1]), parts[0].shape[1]))
