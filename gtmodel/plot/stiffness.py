"""Joint stiffness with its intervals, by method (compare Cvitanic 2021, Tables 1 and 2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from .style import COLOURS, key_below, plain_logarithm, styled, with_panels

MARKERS = ("o", "s", "D")
APART = 0.16  # of a joint's width, between methods


@styled
def stiffness_figure(
    fits: Sequence[tuple[str, np.ndarray, np.ndarray]], true: np.ndarray | None = None, *, title: str = ""
) -> Figure:
    """One point per joint and method.

    found: name of a method, stiffness (k,) and intervals (k, 2) [N.m/rad]; true (k,): that of synthetic tests. What is
    not positive cannot be drawn and is left out; an interval without an upper end is drawn as an arrow.
    """
    figure, (axes,) = with_panels(7.0, 4.2)
    for m, (name, K, ends) in enumerate(fits):
        place = np.arange(1, len(K) + 1) + APART * (m - (len(fits) - 1) / 2)
        K, ends = K / 1e6, ends / 1e6
        there = (K > 0) & (ends[:, 0] > 0)
        open_end = there & ~np.isfinite(ends[:, 1])
        high = np.where(open_end, 2 * K, ends[:, 1])
        bars = np.abs(np.stack([K - ends[:, 0], high - K]))
        style = dict(color=COLOURS[m % 3], marker=MARKERS[m % 3], linestyle="none", markersize=5, capsize=3)
        axes.errorbar(place[there], K[there], yerr=bars[:, there], lolims=open_end[there], label=name, **style)  # pyright: ignore[reportArgumentType]
    if true is not None:
        k = np.arange(1, len(true) + 1)
        axes.hlines(true / 1e6, k - 0.3, k + 0.3, color="black", linewidth=0.8, label="true")
    axes.set(xlabel="joint", ylabel="stiffness [MN m/rad]", yscale="log", title=title)
    plain_logarithm(axes.yaxis)
    key_below(figure, axes)
    return figure
