"""A CasADi function of columns on rows of numbers: one row as quickly as CasADi can, many in one call."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np


class RowsFunction:
    """A function of columns, called with rows: arguments (m, size), results (m, size), of a matrix (m, rows, columns).

    An argument of one row stands for all. The results are new at each call. matrices: places of results that are
    matrices even where they have a single column.
    """

    def __init__(self, name: str, arguments: list[Any], results: list[Any], matrices: tuple[int, ...] = ()) -> None:
        columns = [k not in matrices and r.shape[1] == 1 for k, r in enumerate(results)]
        self.shapes = [r.shape[:1] if column else r.shape for column, r in zip(columns, results, strict=True)]
        dense = [ca.densify(r.T if r.shape[1] != 1 else r) for r in results]  # CasADi stores column by column
        self.function = ca.Function(name, arguments, dense, {"cse": True})
        self._sizes = [a.numel() for a in arguments]
        self._made: dict[int, tuple[list[np.ndarray], list[np.ndarray], Any, Any]] = {}

    def __call__(self, *values: Any) -> list[np.ndarray]:
        rows = 1
        for v in values:
            if isinstance(v, np.ndarray) and v.ndim == 2 and len(v) > rows:
                rows = len(v)
        given, results, run, _ = self._made.get(rows) or self._prepared(rows)
        for memory, value in zip(given, values, strict=True):
            memory[...] = value
        run()
        return [r.copy() for r in results]

    def _prepared(self, rows: int) -> tuple[list[np.ndarray], list[np.ndarray], Any, Any]:
        f = self.function if rows == 1 else self.function.map(rows)
        given = [np.zeros((rows, size)) for size in self._sizes]
        results = [np.zeros((rows, *s)) for s in self.shapes]
        buffer, run = f.buffer()
        set_arg: Any = buffer.set_arg
        set_res: Any = buffer.set_res
        places: list[tuple[Any, list[Any]]] = [(set_arg, given), (set_res, results)]
        for setter, arrays in places:
            for k, a in enumerate(arrays):
                if a.size:
                    setter(k, memoryview(a))
        if len(self._made) > MOST_SIZES:
            self._made.pop(next(iter(self._made)))
        self._made[rows] = given, results, run, (buffer, f)
        return self._made[rows]


MOST_SIZES = 8  # numbers of rows whose memory is kept
