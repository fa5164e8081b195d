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
