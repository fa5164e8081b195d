"""A log as it is: each vector over time, between its least and largest number, and the steps of the time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .style import BLUE, LIMIT, colour, styled, with_panels

MOST_PANELS = 12
HEIGHT = 1.25  # inches of a panel
MOST_POINTS = 4_000  # of the steps
FINEST = 0.01  # of the median step, either way of it: what the axis shows at least


@styled
def log_figure(title: str, streams: Sequence[Mapping[str, Any]]) -> Figure:
    """One panel for each vector or column, as many as there is room for, and one for the steps of each time.

    streams: each with name, time (n,), its label, low and high (n, k), groups (name, unit, columns) and clock (m,),
    None for none.
    """
    panels = [(stream, group) for stream in streams for group in stream["groups"]]
    left = len(panels) - MOST_PANELS
    panels = panels[:MOST_PANELS]
    timed = [stream for stream in streams if stream["clock"] is not None and len(stream["clock"]) > 2]
    count = max(1, len(panels) + len(timed))
    more = f"; {left} more are not drawn" if left > 0 else ""
    figure, stack = with_panels(8.5, 0.8 + HEIGHT * count, count, title=f"{title}{more}")
    for axes, (stream, (name, unit, columns)) in zip(stack, panels, strict=False):
        for k, j in enumerate(columns):
            low, high = stream["low"][:, j], stream["high"][:, j]
            axes.fill_between(stream["time"], low, high, color=colour(k), alpha=0.5, linewidth=0)
            axes.plot(stream["time"], (low + high) / 2, color=colour(k), linewidth=0.8)
        axes.set_title(name if not stream["name"] else f"{stream['name']}: {name}", fontsize="small", loc="left")
        axes.set_ylabel(f"[{unit or '?'}]")
        axes.set_xlabel(stream["label"], fontsize="small")
        axes.margins(x=0.0)
    for axes, stream in zip(stack[len(panels) :], timed, strict=False):
        time = stream["clock"][np.isfinite(stream["clock"])]
        draw_steps(axes, time, np.diff(time))
        axes.set_title(f"steps of {stream['label']}", fontsize="small", loc="left")
        axes.set_ylabel(f"step [{stream['label'].rpartition('[')[2]}")
        axes.set_xlabel(stream["label"], fontsize="small")
        axes.margins(x=0.0)
    return figure


def draw_steps(axes: Axes, time: np.ndarray, steps: np.ndarray) -> None:
    """Steps (n - 1,) from row to row at their times (n,), the widest of each stretch where there are too many to draw:
    a gap is not to be missed. The dotted line is the median. Less than a hundredth of it is not stretched to the axis:
    there is round-off."""
    begins = np.unique(np.linspace(0, len(steps) - 1, min(len(steps), MOST_POINTS)).astype(int))
    axes.plot(time[begins], np.maximum.reduceat(steps, begins), ".", color=BLUE, markersize=2)
    middle = float(np.median(steps))
    axes.axhline(middle, **LIMIT)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, middle - FINEST * abs(middle)), max(high, middle + FINEST * abs(middle)))
