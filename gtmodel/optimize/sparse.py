"""Constant sparse matrices by their entries: what collocation asks of them, without the import of scipy.sparse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np


@dataclass(frozen=True, eq=False)
class SparseMatrix:
    """Entries row by row, and within a row column by column; `of` sums those that stand at one place.

    >>> from gtmodel.optimize.sparse import SparseMatrix
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
