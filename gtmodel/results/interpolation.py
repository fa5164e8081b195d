"""Values of a signal between the rows of its time grid."""

from __future__ import annotations

from typing import Literal

import numpy as np

from .trajectory_errors import Array, TrajectoryError

Kind = Literal["linear", "pchip", "previous"]
KINDS = ("linear", "pchip", "previous")


def interpolate(grid: Array, value: Array, times: Array, kind: Kind) -> Array:
    """Values (..., k) at times inside the grid."""
    if kind not in KINDS:
        raise TrajectoryError(f"kind is {kind!r}; expected 'linear', 'pchip' or 'previous'")
    if kind == "previous" or grid.size == 1:
        return value[np.searchsorted(grid, times, side="right") - 1]
    if kind == "pchip":
        from scipy.interpolate import PchipInterpolator

        between = PchipInterpolator(grid, value, axis=0)(times)
        end = times == grid[-1]  # scipy evaluates the last polynomial there, which rounds
        return np.where(end[..., None] if value.ndim == 2 else end, value[-1], between)
    left = np.clip(np.searchsorted(grid, times, side="right") - 1, 0, grid.size - 2)
    weight = (times - grid[left]) / (grid[left + 1] - grid[left])
    weight = weight[..., None] if value.ndim == 2 else weight
    below, above = value[left], value[left + 1]
    return np.where(weight == 1.0, above, below + weight * (above - below))


class CubicHermite:
    """The cubics through values (n, k) with derivatives (n, k) on an ascending grid, n at least 2; beyond its ends, the
    outermost ones. The numbers are those of scipy.interpolate.CubicHermiteSpline, which takes longer to import than a
    motion to re-simulate.
    """

    def __init__(self, grid: Array, value: Array, derivative: Array) -> None:
        h = np.diff(grid)[:, None]
        slope = np.diff(value, axis=0) / h
        bend = (derivative[:-1] + derivative[1:] - 2.0 * slope) / h
        self._grid = grid
        self._powers = value[:-1], derivative[:-1], (slope - derivative[:-1]) / h - bend, bend / h

    def __call__(self, times: Array, order: int = 0) -> Array:
        """Values (m, k) at times (m,), or their derivatives where order is 1."""
        piece = np.clip(np.searchsorted(self._grid, times, side="right") - 1, 0, len(self._grid) - 2)
        s = (times - self._grid[piece])[:, None]
        zeroth, first, second, third = (p[piece] for p in self._powers)
        if order == 1:
            return first + second * s * 2.0 + third * (s * s) * 3.0
        return zeroth + first * s + second * (s * s) + third * (s * s * s)
