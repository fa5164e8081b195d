"""What remains of a late signal when its delay, scale and shift are taken off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from .style import LIMIT, colour, styled, with_panels


@styled
def delay_figure(pairs: Sequence[tuple[str, np.ndarray, np.ndarray, str, float]], *, title: str = "") -> Figure:
    """One panel per pair: residuals over time.

    pairs: name, times (n,) [s], residuals (n,) in the unit that follows, and the delay [s] that was taken off.
    """
    figure, panels = with_panels(7.0, 1.2 + 1.9 * len(pairs), len(pairs), 1, title=title, sharex=True)
    panels = np.atleast_1d(panels).ravel()
    for k, (axes, (name, time, left, unit, delay)) in enumerate(zip(panels, pairs, strict=True)):
        axes.plot(time, left, color=colour(k), linestyle="none", marker=".", markersize=2)
        axes.axhline(0.0, **LIMIT)
        axes.set(title=f"{name}: {1e3 * delay:.4g} ms taken off", ylabel=f"residual [{unit}]")
    panels[-1].set_xlabel("time of the reference [s]")
    return figure
