"""A recording and the even grid that it was put on; the steps from row to row of its clocks; what a delay leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory
from .log import draw_steps
from .style import BLUE, LIMIT, MEASURED, colour, curve, key_beside, styled, with_panels

MOST_PANELS = 8
HEIGHT = 1.9  # inches of a panel
SHOWN = 40  # rows of the detail


@styled
def resampled_figure(
    raw: Mapping[str, Trajectory], even: Trajectory, stretch: np.ndarray, *, title: str = ""
) -> Figure:
    """One row of panels for each signal: all of it, and a detail about its longest gap, where rows are to be seen.

    raw: by signal its rows on the clock of the grid. stretch (n,): number of the stretch between gaps of each row of
    the grid; curves end at gaps.
    """
    names = list(raw)[:MOST_PANELS]
    more = f"; {len(raw) - len(names)} more are not drawn" if len(raw) > len(names) else ""
    figure, stack = with_panels(
        10.0, 0.9 + HEIGHT * len(names), len(names), 2, title=f"{title}{more}", width_ratios=(1.4, 1)
    )
    breaks = np.flatnonzero(np.diff(stretch)) + 1
    for row, name in enumerate(names):
        rows, whole = raw[name], stack[2 * row : 2 * row + 2]
        low, high = _detail(rows.time, even.time)
        for axes in whole:
            values = np.asarray(rows[name]).reshape(len(rows), -1)
            axes.plot(rows.time, values[:, :1], **MEASURED, label="rows as read")
            axes.plot(rows.time, values[:, 1:], **MEASURED)
            smooth = np.insert(np.asarray(even[name]).reshape(len(even), -1), breaks, np.nan, axis=0)
            for k in range(smooth.shape[1]):
                label = f"{name}[{k}]" if smooth.shape[1] > 1 else name
                axes.plot(
                    np.insert(even.time, breaks, np.nan), smooth[:, k], **curve(k + 1), linewidth=2.0, label=label
                )
            axes.set_ylabel(f"{name} [{even.unit(name)}]")
        whole[0].margins(x=0.0)
        inside = (rows.time >= low) & (rows.time <= high)
        shown = np.asarray(rows[name])[inside]
        margin = 0.1 * max(float(np.ptp(shown)), 1e-12 * float(np.abs(shown).max()))
        whole[1].set(xlim=(low, high), ylim=(float(shown.min()) - margin, float(shown.max()) + margin))
        whole[1].set_title("about the longest gap")
        on_grid = np.asarray(even[name]).reshape(len(even), -1)
        whole[1].plot(even.time, on_grid, "o", color=BLUE, markersize=3.5, markerfacecolor="none")
        whole[1].lines[-1].set_label("on the grid")
        key_beside(whole[1])
    for axes in stack[-2:]:
        axes.set_xlabel("time of the reference [s]")
    return figure


@styled
def steps_figure(times: Mapping[str, np.ndarray], *, title: str = "") -> Figure:
    """One panel for each clock: the steps from row to row over time, the widest where there are too many to draw.

    times: by clock (n,) [s]; the dotted line is the median.
    """
    figure, stack = with_panels(8.5, 1.0 + HEIGHT * len(times), len(times), title=title)
    for axes, (clock, time) in zip(stack, times.items(), strict=True):
        draw_steps(axes, time, 1e3 * np.diff(time))
        axes.set_title(f"steps of {clock}")
        axes.set(ylabel="step [ms]", xlabel="time [s]")
        axes.margins(x=0.0)
    return figure


def _detail(time: np.ndarray, grid: np.ndarray) -> tuple[float, float]:
    """From where to where rows are shown one by one: about the longest step that lies on the grid."""
    inside = np.flatnonzero((time >= grid[0]) & (time <= grid[-1]))
    if len(inside) < 3:
        return float(grid[0]), float(grid[-1])
    k = inside[int(np.argmax(np.diff(time[inside])))]
    low, high = max(int(k) - SHOWN // 2, 0), min(int(k) + SHOWN // 2, len(time) - 1)
    return float(time[low]), float(time[high])


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
