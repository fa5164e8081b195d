"""A table as piecewise polynomials of time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

# polynomial coefficients of one piece: with two, the first derivative is known too, and so on
INTERPOLATIONS = {"previous": 1, "linear": 2, "cubic": 4}


@dataclass(eq=False)
class InputTable:
    """A scalar function of time given by rows; constant before the first and after the last one."""

    name: str
    times: np.ndarray
    values: np.ndarray
    interpolation: str = "linear"

    @property
    def coefficients(self) -> int:
        return INTERPOLATIONS[self.interpolation]

    @cached_property
    def _rows(self) -> np.ndarray:
        """Taylor coefficients (value, derivatives) at the beginning of each piece, one row per time."""
        n = len(self.times)
        rows = np.zeros((n, self.coefficients))
        rows[:, 0] = self.values
        if n > 1 and self.interpolation == "linear":
            rows[:-1, 1] = np.diff(self.values) / np.diff(self.times)
        elif n > 1 and self.interpolation == "cubic":
            rows[:-1] = CubicSpline(self.times, self.values).c[::-1].T * [math.factorial(k) for k in range(4)]
        return rows

    def largest(self, order: int) -> float:
        """Largest size of a derivative at the rows."""
        return float(np.max(np.abs(self._rows[:, order])))

    def piece(self, start: float, before: bool = False) -> np.ndarray:
        """Taylor coefficients at a time, of the piece that begins or goes on there; `before`: that leads there."""
        k = int(np.searchsorted(self.times, start, side="left" if before else "right")) - 1
        if k < 0:
            return np.concatenate([self.values[:1], np.zeros(self.coefficients - 1)])
        row, after = self._rows[k], start - self.times[k]
        n = self.coefficients
        return np.array([sum(row[j] * after ** (j - i) / math.factorial(j - i) for j in range(i, n)) for i in range(n)])
