"""Measured beside modelled efforts, and what is left as friction, of an identification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from .signals import PANEL_HEIGHT
from .style import MEASURED, MODELLED, ORANGE, key_below, styled, with_panels


@styled
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
    figure, panels = with_panels(11.0, 1.4 + PANEL_HEIGHT * len(names), len(names), 2, title=title, sharex=True,
                                 width_ratios=(2, 1))  # fmt: skip
    panels = panels.reshape(-1, 2)
    for k, ((axes, error), name) in enumerate(zip(panels, names, strict=True)):
        axes.plot(time[rows], modelled[rows, k], label="modelled", **MODELLED)
        axes.plot(time[rows], measured[rows, k], label="measured", **MEASURED)
        axes.set_ylabel(f"{name} [{unit}]")
        error.plot(time[rows], (measured - modelled)[rows, k], color="0.4", linewidth=0.8)
        error.set_ylabel(f"difference [{unit}]")
    panels[0, 0].set_title("measured and modelled")
    panels[0, 1].set_title("measured - modelled, scale of its own")
    key_below(figure, panels[0, 0])
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    return figure


@styled
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
    figure, panels = with_panels(3.6 * len(names) + 0.2, 3.8, columns=len(names), title=title)
    for k, (axes, name) in enumerate(zip(panels, names, strict=True)):
        # of filtered records the law is no curve, for the filter acts on it too
        axes.plot(velocity[:, k], law[:, k], "o", color=ORANGE, markersize=5, label="fitted law at the same samples")
        axes.plot(velocity[:, k], friction[:, k], label="measured, less all other terms of the model", **MEASURED)
        axes.set(title=name, xlabel=f"velocity [{units[0]}]", ylabel=f"friction [{units[1]}]")
    key_below(figure, panels[0])
    return figure
