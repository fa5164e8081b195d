"""Pictures of a calibration: errors per pose, per link and over the workspace, deviations, correlation."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from .panels import COLOURS, with_panels

BINS = 30
MANY = 40  # names that still can be read on an axis


def pose_errors_figure(errors: dict[str, np.ndarray], title: str = "", worst: int | None = None) -> Figure:
    """Absolute positioning error per pose (Dressler 2012, Fig. 5.1).

    Args:
        errors: name -> (N,) [m] of the same poses, drawn in one panel each, for they differ by powers of ten.
        worst: pose of the first ones to be marked.
    """
    figure, panels = with_panels(8.0, 0.8 + 2.3 * len(errors), len(errors), title=title, sharex=True)
    for n, (axes, (name, e)) in enumerate(zip(panels, errors.items(), strict=True)):
        axes.plot(np.arange(1, len(e) + 1), 1e3 * e, ".-", color=COLOURS[n % len(COLOURS)], linewidth=0.8, markersize=3)
        axes.axhline(1e3 * float(np.nanmean(e)), color="0.4", linestyle="--", linewidth=0.8)
        axes.set(ylabel="error [mm]", ylim=(0, None))
        axes.set_title(f"{name}: mean {1e3 * float(np.nanmean(e)):.3g} mm", fontsize="medium", loc="left")
        if n == 0 and worst is not None:
            axes.plot(worst + 1, 1e3 * e[worst], "o", markerfacecolor="none", markeredgecolor="black")
    panels[-1].set_xlabel("pose")
    return figure


def length_errors_figure(residuals: np.ndarray, labels: Sequence[str], title: str = "") -> Figure:
    """Histogram of length errors (N, m) [m], one panel per link; what is not finite is left out and counted."""
    m = len(labels)
    columns = min(3, m)
    rows = -(-m // columns)
    figure, panels = with_panels(2.9 * columns, 1.0 + 2.2 * rows, rows, columns, title=title)
    for k, axes in enumerate(panels):
        if k >= m:
            axes.set_axis_off()
            continue
        known = residuals[np.isfinite(residuals[:, k]), k]
        axes.hist(1e3 * known, BINS, color=COLOURS[0])
        mean = f"mean size {1e3 * float(np.mean(np.abs(known))):.3g} mm" if known.size else "no errors"
        left = f", {len(residuals) - known.size} left out" if known.size < len(residuals) else ""
        axes.set_title(f"{labels[k]}: {mean}{left}", fontsize="small")
        axes.set_xlabel("length error [mm]", fontsize="small")
    return figure


def workspace_errors_figure(positions: np.ndarray, sizes: np.ndarray, title: str = "") -> Figure:
    """Errors (N,) [m] at positions (N, 3) [m], seen along each axis; the greatest lie on top."""
    order = np.argsort(np.nan_to_num(sizes, nan=-1.0), kind="stable")
    figure, panels = with_panels(11.0, 4.2, columns=3, title=title)
    drawn: PathCollection | None = None
    for axes, (a, b) in zip(panels, ((0, 1), (0, 2), (1, 2)), strict=True):
        drawn = axes.scatter(positions[order, a], positions[order, b], c=1e3 * sizes[order], s=22, cmap="viridis")
        worst = order[-1]
        axes.plot(positions[worst, a], positions[worst, b], "o", markerfacecolor="none", markeredgecolor="red", ms=11)
        axes.set(xlabel=f"{'xyz'[a]} [m]", ylabel=f"{'xyz'[b]} [m]")
        axes.set_aspect("equal", adjustable="datalim")
    assert drawn is not None
    figure.colorbar(drawn, ax=list(panels), label="positioning error [mm]")
    return figure


def deviations_figure(names: Sequence[str], std: np.ndarray, units: Sequence[str], title: str = "") -> Figure:
    """Standard deviations (n,) of unknowns in SI, a bar each; what the poses leave undetermined is hatched instead."""
    known = np.isfinite(std)
    top = float(np.max(std[known])) if known.any() else 1.0
    said = textwrap.fill(title, 60)
    figure, (axes,) = with_panels(7.5, 1.2 + 0.17 * len(names), grid=False, title=said, fontsize="medium")
    at = np.arange(len(names))
    colours = [COLOURS[0] if u == "m" else COLOURS[1] if u == "1" else COLOURS[2] for u in units]
    axes.barh(at[known], std[known], color=[c for c, k in zip(colours, known, strict=True) if k])
    axes.barh(at[~known], np.full(int((~known).sum()), 3 * top), color="0.9", hatch="//", edgecolor="0.6")
    axes.set_xscale("log")
    positive = std[known & (std > 0)]
    least = float(np.min(positive)) if positive.size else 0.1 * top
    # below the least one, which would have no bar else
    axes.set_xlim(10 ** (np.ceil(np.log10(least)) - 1), 10 ** np.ceil(np.log10(max(top, least))))
    axes.set_yticks(at, [f"{n} [{u}]" for n, u in zip(names, units, strict=True)], fontsize=7)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlabel("standard deviation; hatched: not determined by these poses")
    axes.grid(alpha=0.3, axis="x", which="both")
    return figure


def correlation_figure(names: Sequence[str], correlation: np.ndarray, title: str = "") -> Figure:
    """Correlation coefficients (n, n) of unknowns."""
    n = len(names)
    figure = Figure(figsize=(3.0 + 0.14 * n, 2.4 + 0.14 * n), layout="constrained")
    axes = figure.add_subplot()
    drawn = axes.imshow(correlation, cmap="RdBu_r", vmin=-1, vmax=1)
    size = 7 if n <= MANY else 5
    axes.set_xticks(range(n), names, rotation=90, fontsize=size)
    axes.set_yticks(range(n), names, fontsize=size)
    figure.colorbar(drawn, ax=axes, label="correlation", shrink=0.8)
    figure.suptitle(textwrap.fill(title, 60), fontsize="medium")
    return figure
