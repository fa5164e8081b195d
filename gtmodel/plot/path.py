"""The path of a tool centre point in a plane of the axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory


def draw_path(axes: Any, T: np.ndarray, plane: str, path: np.ndarray | None = None) -> None:
    """Draw a motion's path, its start and its goal, in equal scales.

    Args:
        T: (n, 3) [m]. plane: two of x, y, z, such as "xz".
        path: (k, 3) [m] to follow; the straight line if left out.
    """
    a, b = map("xyz".index, plane)
    line, what = (T[[0, -1]], "straight line") if path is None else (path, "path")
    axes.plot(line[:, a], line[:, b], color="0.7", linestyle="--", label=what)
    axes.plot(T[:, a], T[:, b], color="black", label="optimal path")
    axes.plot(T[0, a], T[0, b], "o", color="black", markerfacecolor="white", label="start")
    axes.plot(T[-1, a], T[-1, b], "o", color="black", label="goal")
    axes.set(xlabel=f"{plane[0]} [m]", ylabel=f"{plane[1]} [m]")
    axes.set_aspect("equal", adjustable="datalim")


def head(figure: Figure, trajectory: Trajectory) -> None:
    """Title and duration of a motion above its figure."""
    if trajectory.title:
        figure.suptitle(f"{trajectory.title}: {trajectory.duration:.4f} s")
