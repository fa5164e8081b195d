"""A tool led by hand over a plate: force along the normal, commanded speed, distance from the plate."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ..style import curve, key_below, styled, with_panels

_LABELS = ("force along normal [N]", "commanded speed [m/s]", "above the plate [mm]")


@styled
def guided_figure(
    cycle_s: float, runs: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]], reference: float, title: str = ""
) -> Figure:
    """Three panels over time.

    Args:
        cycle_s: between two numbers [s].
        runs: by label, (n,) each: force [N], commanded speed [m/s], distance from the plate [mm].
        reference: force that is to be held [N].
    """
    figure, panels = with_panels(8.5, 7.0, 3, title=title, sharex=True)
    panels[0].axhline(reference, color="black", linewidth=1.0, label="reference")
    for n, (label, series) in enumerate(runs.items(), 1):
        for axes, values in zip(panels, series, strict=True):
            axes.plot(cycle_s * np.arange(len(values)), values, label=label, **curve(n))
    for axes, text in zip(panels, _LABELS, strict=True):
        axes.set_ylabel(text)
    figure.align_ylabels(panels)
    panels[-1].set_xlabel("time [s]")
    key_below(figure, panels[0])
    return figure
