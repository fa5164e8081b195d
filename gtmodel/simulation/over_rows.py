"""A function of a reduced system at one point or over many rows, on NumPy memory."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from ..compiler.point_function import PointFunction, densified
from ..compiler.rows import map_columns

# rows that are evaluated one by one: a call over several costs more than that
FEW = 6


class OverRows:
    """Called with arrays (n, size), one for each input, or (size,) where a row is the same for all; gives arrays
    (n, size), one for each output."""

    def __init__(self, f: ca.Function) -> None:
        self.function = densified(f)
        self._made: dict[int, ca.Function] = {}

    @cached_property
    def _at_one(self) -> PointFunction:
        return PointFunction(self.function)

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        rows = next((len(a) for a in arguments if a.ndim == 2), 1)
        if rows <= FEW:
            each = [self._at_one(*[a[n] if a.ndim == 2 else a for a in arguments]) for n in range(rows)]
            return [np.concatenate([r.T.reshape(1, -1) for r in one]) for one in zip(*each, strict=True)]
        columns = [a.T if a.ndim == 2 else np.broadcast_to(a[:, None], (a.size, rows)) for a in arguments]
        return [r.T for r in map_columns(self.function, columns, self._made)]
