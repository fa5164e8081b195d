"""Pictures of a calibration: errors per pose, per link and over the workspace, deviations, correlation."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .style import AWAY_FROM_ZERO, COLOURS, ORANGE, key_below, millionths, plain_logarithm, styled, with_panels

BINS = 30
TICKS = 4  # along the longer side of a view
FEW_DECADES = 3  # of which 2 and 5 have room for their numbers too
MANY = 40  # names that still can be read on an axis


@styled
def pose_errors_figure(
    errors: dict[str, np.ndarray], title: str = "", worst: int | None = None, quantity: str = "positioning error [mm]"
) -> Figure:
    """Absolute positioning error per pose (Dressler 2012, Fig. 5.1).

    Args:
        errors: name -> (N,) [m], drawn in one panel each, for they differ by powers of ten.
        worst: pose of the first ones to be marked.
        quantity: what they are errors of, along the axis.
    """
    figure, panels = with_panels(8.0, 0.8 + 2.3 * len(errors), len(errors), title=title, sharex=True)
    for n, (axes, (name, e)) in enumerate(zip(panels, errors.items(), strict=True)):
        axes.plot(np.arange(1, len(e) + 1), 1e3 * e, ".-", color=COLOURS[n % len(COLOURS)], linewidth=0.6, markersize=4)
        axes.axhline(1e3 * float(np.nanmean(e)), color="0.4", linestyle="--", linewidth=0.8)
        axes.set(ylabel=quantity, ylim=(0, None))
        said = f"{name}: mean {1e3 * float(np.nanmean(e)):.3g} mm (dashed)"
        if n == 0 and worst is not None:
            axes.plot(worst + 1, 1e3 * e[worst], "o", markersize=8, markerfacecolor="none", markeredgecolor="black")
            said += f", largest {1e3 * float(e[worst]):.3g} mm (circle)"
        axes.set_title(said, loc="left")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    panels[-1].set_xlabel("pose, in the order of the data")
    return figure


@styled
def length_errors_figure(residuals: np.ndarray, labels: Sequence[str], title: str = "") -> Figure:
    """Histogram of length errors (N, m) [m], one panel per link; what is not finite is left out and counted."""
    m = len(labels)
    columns = min(3, m)
    rows = -(-m // columns)
    figure, panels = with_panels(3.0 * columns, 1.0 + 2.3 * rows, rows, columns, title=title, sharey=True)
    everything = residuals[np.isfinite(residuals)]
    bins = np.histogram_bin_edges(1e3 * everything, BINS) if everything.size else np.linspace(-1.0, 1.0, BINS + 1)
    for k, axes in enumerate(panels):
        if k >= m:
            axes.set_axis_off()
            continue
        known = residuals[np.isfinite(residuals[:, k]), k]
        axes.hist(1e3 * known, bins, color=COLOURS[0])
        mean = f"mean size {1e3 * float(np.mean(np.abs(known))):.3g} mm" if known.size else "no errors"
        left = f", {len(residuals) - known.size} left out" if known.size < len(residuals) else ""
        axes.set_title(f"{labels[k]}: {mean}{left}", fontsize="small")
        axes.set_xlabel("length error [mm]")
        if k % columns == 0:
            axes.set_ylabel("number of poses")
    return figure


@styled
def workspace_errors_figure(positions: np.ndarray, sizes: np.ndarray, title: str = "") -> Figure:
    """Errors (N,) [m] at positions (N, 3) [m], seen along each axis, or (N, 2); the greatest lie on top."""
    order = np.argsort(np.nan_to_num(sizes, nan=-1.0), kind="stable")
    pairs = list(combinations(range(positions.shape[1]), 2))
    figure, panels = with_panels(11.0 if len(pairs) > 1 else 5.5, 4.2, columns=len(pairs), title=title)
    top = 1e3 * float(np.nanmax(sizes))
    drawn: PathCollection | None = None
    for axes, (a, b) in zip(panels, pairs, strict=True):
        drawn = axes.scatter(positions[order, a], positions[order, b], c=1e3 * sizes[order], s=22, zorder=2)
        worst = order[-1]
        axes.plot(positions[worst, a], positions[worst, b], "o", markerfacecolor="none", markeredgecolor=ORANGE, ms=12,
                  markeredgewidth=1.5, clip_on=False, label=f"largest: {top:.3g} mm")  # fmt: skip
        sides = np.ptp(positions[:, [a, b]], axis=0)
        for axis, part in zip((axes.xaxis, axes.yaxis), sides / max(float(sides.max()), 1e-12), strict=True):
            axis.set_major_locator(MaxNLocator(max(1, round(TICKS * float(part)))))  # a narrow panel has room for few
        axes.set(xlabel=f"{'xyz'[a]} [m]", ylabel=f"{'xyz'[b]} [m]")
        axes.set_aspect("equal")
    assert drawn is not None
    figure.colorbar(drawn, ax=list(panels), label="positioning error [mm]")
    key_below(figure, panels[0])
    return figure


@styled
def deviations_figure(names: Sequence[str], std: np.ndarray, units: Sequence[str], title: str = "") -> Figure:
    """Standard deviations (n,) of unknowns in SI, a bar each, a panel for each unit.

    What the poses leave undetermined is hatched instead.
    """
    groups = {u: [k for k, other in enumerate(units) if other == u] for u in dict.fromkeys(units)}
    sizes = [len(rows) for rows in groups.values()]
    figure, panels = with_panels(7.5, 0.6 + 0.8 * len(groups) + 0.18 * len(names), len(groups), grid=False,
                                 title=textwrap.fill(title, 60), height_ratios=sizes)  # fmt: skip
    for axes, (unit, rows) in zip(panels, groups.items(), strict=True):
        _deviations(axes, [names[k] for k in rows], 1e6 * np.asarray(std, float)[rows], millionths(unit))
    return figure


def _deviations(axes: Any, names: Sequence[str], std: np.ndarray, unit: str) -> None:
    """Bars of the deviations of one unit."""
    known = np.isfinite(std)
    top = (float(np.max(std[known])) if known.any() else 0.0) or 1.0
    at = np.arange(len(names))
    axes.barh(at[known], std[known], color=COLOURS[0])
    axes.barh(at[~known], np.full(int((~known).sum()), 30 * top), color="0.9", hatch="//", edgecolor="0.6")
    positive = std[known & (std > 0)]
    least = float(np.min(positive)) if positive.size else 0.1 * top
    # below the least one, which would have no bar else
    low, high = np.ceil(np.log10(least)) - 1, np.ceil(np.log10(max(top, least)))
    axes.set_xlim(10**low, 10**high)
    axes.set_xscale("log")
    plain_logarithm(axes.xaxis, subs=(1.0, 2.0, 5.0) if high - low <= FEW_DECADES else (1.0,))
    axes.set_yticks(at, names, fontsize=7)
    axes.set_ylim(len(names) - 0.4, -0.6)
    hatched = "" if known.all() else "; hatched: not determined by these poses"
    axes.set(xlabel=f"standard deviation [{unit}]{hatched}", ylabel="parameter")
    axes.grid(alpha=0.3, axis="x", which="both")


@styled
def correlation_figure(names: Sequence[str], correlation: np.ndarray, title: str = "") -> Figure:
    """Correlation coefficients (n, n) of unknowns."""
    n = len(names)
    beside = 0.06 * max(map(len, names), default=0)  # inches that the names need
    figure = Figure(figsize=(3.2 + beside + 0.14 * n, 2.8 + beside + 0.14 * n), layout="constrained")
    axes = figure.add_subplot()
    drawn = axes.imshow(correlation, cmap=AWAY_FROM_ZERO, vmin=-1, vmax=1)
    size = 7 if n <= MANY else 5
    axes.set_xticks(range(n), names, rotation=90, fontsize=size)
    axes.set_yticks(range(n), names, fontsize=size)
    axes.set(xlabel="parameter", ylabel="parameter")
    figure.colorbar(drawn, ax=axes, label="coefficient of correlation [1]", shrink=0.8)
    axes.set_title(textwrap.fill(title, 60))
    return figure
