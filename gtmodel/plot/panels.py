"""A figure with its panels, and the colours and styles of curves and links in them."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

# readable with colour-blind eyes (Okabe and Ito), dark ones first
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#f0e442")
STYLES = ("-", "--", ":", "-.")


def colour(k: int) -> str:
    """The colour of curve k, from 0; more curves than colours begin again."""
    return COLOURS[k % len(COLOURS)]


def curve(k: int) -> dict[str, Any]:
    """Colour and style of curve k, from 0, of many: 32 that are all different."""
    return dict(color=colour(k), linestyle=STYLES[k // len(COLOURS) % len(STYLES)])


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
