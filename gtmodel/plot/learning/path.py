"""The tool's path after learning beside its reference: Dressler 2012, Figs. 7.10, 7.15 and 7.18."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..style import BLACK, ORANGE, key_below, styled, with_panels


@styled
def tool_path_figure(
    reference: np.ndarray, tool: np.ndarray, *, before: np.ndarray | None = None, title: str = ""
) -> Figure:
    """Reference, tool of the last run, and of the first one before learning, (n, 2) [m] each, in the plane."""
    figure, (panel,) = with_panels(5.0, 5.4, title=title)
    if before is not None:
        panel.plot(1e3 * before[:, 0], 1e3 * before[:, 1], color="0.6", linewidth=0.9, label="tool, before learning")
    panel.plot(1e3 * tool[:, 0], 1e3 * tool[:, 1], color=ORANGE, label="tool, last run")
    panel.plot(1e3 * reference[:, 0], 1e3 * reference[:, 1], color=BLACK, linewidth=0.9, label="reference")
    panel.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    key_below(figure, panel, columns=3)
    return figure
