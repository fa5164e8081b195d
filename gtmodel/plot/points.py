"""Quantities over the points of a table, which need have no order in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from .signals import PANEL_HEIGHT
from .style import COLOURS, key_beside, styled, with_panels


@styled
def points_figure(signals: Sequence[tuple[str, str, np.ndarray]], ok: np.ndarray, title: str = "") -> Figure:
    """Stacked panels over the row number, one for each (name, unit, values (rows, ...)); rows without a solution are
    marked below by a grey line."""
    figure, stack = with_panels(8.5, 1.2 + PANEL_HEIGHT * len(signals), len(signals), title=title, sharex=True)
    missing = np.flatnonzero(~ok)
    for axes, (name, unit, values) in zip(stack, signals, strict=True):
        flat = values.reshape(len(ok), -1)
        for k in range(flat.shape[1]):
            label = name if flat.shape[1] == 1 else f"{name}[{k}]"
            axes.plot(flat[:, k], ".", markersize=3, color=COLOURS[k % len(COLOURS)], label=label)
        if missing.size:
            rug = axes.get_xaxis_transform()
            axes.vlines(missing, 0.0, 0.05, color="0.5", transform=rug, linewidth=0.6, label="no solution")
        axes.set_ylabel(f"{name} [{unit or '1'}]")
        key_beside(axes)
    stack[-1].set_xlabel("row of the table")
    return figure
