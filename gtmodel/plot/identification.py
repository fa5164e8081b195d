"""Measured beside modelled efforts, and what is left as friction, of an identification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from .panels import COLOURS, with_panels
from .signals import PANEL_HEIGHT

MODELLED = COLOURS[1]


def efforts_figure(
    time: np.ndarray,
    measured: np.ndarray,
    modelled: np.ndarray,
    names: Sequence[str],
    unit: str,
    title: str = "",
    most_s: float = 20.0,
) -> Figure:
    """Measured and modelled efforts (n, m) over time, and their difference, one panel per target.

    As Figs. 6.5 and 6.6 of Dressler 2012. Of longer records the first `most_s` seconds are drawn.
    """
    rows = time <= time[0] + most_s
    figure, stack = with_panels(8.5, 1.2 + PANEL_HEIGHT * len(names), len(names), title=title, sharex=True)
    for k, (axes, name) in enumerate(zip(stack, names, strict=True)):
        axes.plot(time[rows], measured[rows, k], color="black", linewidth=1.4, label="measured")
        axes.plot(time[rows], modelled[rows, k], color=MODELLED, linewidth=1.0, label="modelled")
        axes.plot(time[rows], (measured - modelled)[rows, k], color="0.6", linewidth=0.8, label="difference")
        axes.set_ylabel(f"{name} [{unit}]")
    figure.legend(*stack[0].get_legend_handles_labels(), loc="outside lower right", ncols=3, fontsize="small")
    stack[-1].set_xlabel("time [s]")
    return figure


def friction_figure(
    velocity: np.ndarray,
    friction: np.ndarray,
    law: np.ndarray,
    names: Sequence[str],
    units: tuple[str, str],
    title: str = "",
) -> Figure:
    """What is left of the efforts (n, m) when the rest of the model is taken away, over velocity, and the fitted law.

    As Fig. 6.4 of Dressler 2012, from one motion. units: of velocity and of the efforts.
    """
    figure, panels = with_panels(3.1 * len(names) + 0.6, 3.2, columns=len(names), title=title)
    for k, (axes, name) in enumerate(zip(panels, names, strict=True)):
        order = np.argsort(velocity[:, k])
        axes.plot(velocity[:, k], friction[:, k], ".", color="0.6", markersize=2.5, label="measured less the masses")
        axes.plot(velocity[order, k], law[order, k], ".", color=MODELLED, markersize=2.0, label="law")
        axes.set_title(name, fontsize="medium")
        axes.set_xlabel(f"velocity [{units[0]}]")
        if k == 0:
            axes.set_ylabel(f"friction [{units[1]}]")
            axes.legend(loc="upper left", fontsize="x-small")
    return figure
