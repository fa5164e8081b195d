"""Pictures of logs: each vector over time, the time steps of each clock, resampled signals, delays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory
from .style import BLUE, LIMIT, MEASURED, colour, curve, key_beside, styled, with_panels

MOST_PANELS = 12
HEIGHT = 1.25  # inches of a panel
MOST_POINTS = 4_000  # time steps drawn
FINEST = 0.01  # smallest range of the axis about the median step, relative to it


@styled
def log_figure(title: str, streams: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw each vector or column in a panel, as many as fit, and the time steps of each clock.

    streams: each with name, time (n,), its label, low and high (n, k), groups (name, unit, columns) and clock (m,) or
    None.
    """
    panels = [(stream, group) for stream in streams for group in stream["groups"]]
    missing = len(panels) - MOST_PANELS
    panels = panels[:MOST_PANELS]
    timed = [stream for stream in streams if stream["clock"] is not None and len(stream["clock"]) > 2]
    count = max(1, len(panels) + len(timed))
    note = f"; {missing} more are not drawn" if missing > 0 else ""
    figure, stack = with_panels(8.5, 0.8 + HEIGHT * count, count, title=f"{title}{note}")
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
        axes.set_title(f"time steps of {stream['label']}", fontsize="small", loc="left")
        axes.set_ylabel(f"step [{stream['label'].rpartition('[')[2]}")
        axes.set_xlabel(stream["label"], fontsize="small")
        axes.margins(x=0.0)
    return figure


def draw_steps(axes: Axes, time: np.ndarray, steps: np.ndarray) -> None:
    """Draw the steps (n - 1,) between rows over their times (n,), and their median as a dotted line.

    If there are too many steps, the largest of each stretch is drawn, so that no gap is missed. The axis covers at
    least 1 % of the median either way, so that round-off is not enlarged.
    """
    begins = np.unique(np.linspace(0, len(steps) - 1, min(len(steps), MOST_POINTS)).astype(int))
    axes.plot(time[begins], np.maximum.reduceat(steps, begins), ".", color=BLUE, markersize=2)
    middle = float(np.median(steps))
    axes.axhline(middle, **LIMIT)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, middle - FINEST * abs(middle)), max(high, middle + FINEST * abs(middle)))


MOST_SIGNALS = 8
SIGNAL_HEIGHT = 2.1  # inches of a panel
DETAIL = 40  # rows of the enlarged detail


@styled
def resampled_figure(
    raw: Mapping[str, Trajectory], even: Trajectory, stretch: np.ndarray, *, title: str = ""
) -> Figure:
    """Draw each signal in a row of panels: the whole of it, and a detail around its longest gap with single rows.

    raw: by signal its rows on the clock of the grid. stretch (n,): for each row of the grid the number of its stretch
    between gaps; curves end at gaps.
    """
    names = list(raw)[:MOST_SIGNALS]
    note = f"; {len(raw) - len(names)} more are not drawn" if len(raw) > len(names) else ""
    figure, stack = with_panels(
        10.0, 0.9 + SIGNAL_HEIGHT * len(names), len(names), 2, title=f"{title}{note}", width_ratios=(1.4, 1)
    )
    breaks = np.flatnonzero(np.diff(stretch)) + 1
    for row, name in enumerate(names):
        rows, whole = raw[name], stack[2 * row : 2 * row + 2]
        low, high = _detail(rows.time, even.time)
        for axes in whole:
            values = np.asarray(rows[name]).reshape(len(rows), -1)
            axes.plot(rows.time, values[:, :1], **MEASURED, label="recorded")
            axes.plot(rows.time, values[:, 1:], **MEASURED)
            smooth = np.insert(np.asarray(even[name]).reshape(len(even), -1), breaks, np.nan, axis=0)
            for k in range(smooth.shape[1]):
                label = f"{name}[{k}]" if smooth.shape[1] > 1 else name
                axes.plot(
                    np.insert(even.time, breaks, np.nan), smooth[:, k], **curve(k + 1), linewidth=2.0, label=label
                )
            axes.set(xlabel="time of the reference clock [s]", ylabel=f"{name} [{even.unit(name)}]")
        whole[0].margins(x=0.0)
        inside = (rows.time >= low) & (rows.time <= high)
        values = np.asarray(rows[name])[inside]
        margin = 0.1 * max(float(np.ptp(values)), 1e-12 * float(np.abs(values).max()))
        whole[1].set(xlim=(low, high), ylim=(float(values.min()) - margin, float(values.max()) + margin))
        whole[1].set_title(f"{name}: detail at the longest gap")
        on_grid = np.asarray(even[name]).reshape(len(even), -1)
        whole[1].plot(even.time, on_grid, "o", color=BLUE, markersize=3.5, markerfacecolor="none")
        whole[1].lines[-1].set_label("resampled")
        key_beside(whole[1])
    return figure


@styled
def steps_figure(times: Mapping[str, np.ndarray], *, title: str = "") -> Figure:
    """Draw the time steps of each clock in a panel, as `draw_steps` does; times: by clock (n,) [s]."""
    figure, stack = with_panels(8.5, 1.0 + SIGNAL_HEIGHT * len(times), len(times), title=title)
    for axes, (clock, time) in zip(stack, times.items(), strict=True):
        draw_steps(axes, time, 1e3 * np.diff(time))
        axes.set_title(f"time steps of {clock}")
        axes.set(ylabel="step [ms]", xlabel="time [s]")
        axes.margins(x=0.0)
    return figure


def _detail(time: np.ndarray, grid: np.ndarray) -> tuple[float, float]:
    """Return the start and end time of the detail: around the longest time step within the grid."""
    inside = np.flatnonzero((time >= grid[0]) & (time <= grid[-1]))
    if len(inside) < 3:
        return float(grid[0]), float(grid[-1])
    k = inside[int(np.argmax(np.diff(time[inside])))]
    low, high = max(int(k) - DETAIL // 2, 0), min(int(k) + DETAIL // 2, len(time) - 1)
    return float(time[low]), float(time[high])


@styled
def delay_figure(pairs: Sequence[tuple[str, np.ndarray, np.ndarray, str, float]], *, title: str = "") -> Figure:
    """Draw the residuals of each pair over time, a panel per pair.

    pairs: name, times (n,) [s], residuals (n,), their unit, and the delay [s] that was removed.
    """
    figure, panels = with_panels(7.0, 1.2 + 1.9 * len(pairs), len(pairs), 1, title=title, sharex=True)
    panels = np.atleast_1d(panels).ravel()
    for k, (axes, (name, time, residuals, unit, delay)) in enumerate(zip(panels, pairs, strict=True)):
        axes.plot(time, residuals, color=colour(k), linestyle="none", marker=".", markersize=2)
        axes.axhline(0.0, **LIMIT)
        late = f"{delay:.6g} s" if abs(delay) >= 1.0 else f"{1e3 * delay:.4g} ms"
        axes.set(title=f"{name}: delay of {late} removed", ylabel=f"residual [{unit}]")
    panels[-1].set_xlabel("time of the reference clock [s]")
    return figure
