"""A figure with its panels."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure


def with_panels(
    width: float, height: float, rows: int = 1, columns: int = 1, *, title: str = "", grid: bool = True,
    fontsize: str = "large", **more: Any,
) -> tuple[Figure, np.ndarray]:  # fmt: skip
    """A figure [inches] and its panels in one row of an array, row by row, with a light grid each; no title if empty.

    fontsize: of the title. more: as `Figure.subplots` takes it, such as sharex.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    stack = figure.subplots(rows, columns, squeeze=False, **more).ravel()
    for axes in stack if grid else ():
        axes.grid(alpha=0.3)
    if title:
        figure.suptitle(title, fontsize=fontsize)
    return figure, stack
