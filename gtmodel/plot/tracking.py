"""How well a robot followed its reference: positions and errors of runs over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory
from .style import COLOURS, STYLES, colour, curve, key_below, styled, with_panels

_AXES = "xyz"
SMALLEST_MM = 1e-3  # what no measurement would show; zero has no logarithm


@styled
def tracking_figure(wanted: Trajectory, runs: Mapping[str, Trajectory], title: str = "") -> Figure:
    """The tool centre point of each run beside its reference, and below, its distance from it.

    Args:
        wanted: T (n, 3) [m] and q (n, k) [m], a row per cycle.
        runs: by label; T and q of the cycles that a run lasted.
    """
    figure, panels = with_panels(8.5, 9.0, 5, title=title, sharex=True)
    for k, axes in enumerate(panels[:3]):
        axes.plot(wanted.time, wanted["T"][:, k], color="black", linewidth=1.0, label="reference")
        for n, (label, run) in enumerate(runs.items(), 1):
            axes.plot(run.time, run["T"][:, k], linewidth=1.2, label=label, **_dashed(n))
        axes.set_ylabel(f"T_{_AXES[k]} [m]")
    for name, axes in zip(("T", "q"), panels[3:], strict=True):
        for n, (label, run) in enumerate(runs.items(), 1):
            off = 1e3 * (run[name] - wanted[name][: len(run)])
            size = np.linalg.norm(off, axis=1) if name == "T" else np.abs(off).max(axis=1)
            axes.plot(run.time, np.maximum(size, SMALLEST_MM), label=label, **curve(n))
        axes.set_yscale("log")
        axes.set_ylim(bottom=SMALLEST_MM / 2)
        axes.set_ylabel("error of T [mm]" if name == "T" else "worst cart [mm]")
    panels[0].set_xlim(wanted.time[0], wanted.time[-1])
    figure.align_ylabels(panels)
    panels[3].set_title(f"errors; below {1e3 * SMALLEST_MM:g} µm they are drawn as {1e3 * SMALLEST_MM:g} µm")
    panels[-1].set_xlabel("time [s]")
    key_below(figure, panels[0])
    return figure


def _dashed(n: int) -> dict[str, Any]:
    """The n-th curve beside one that is drawn in full."""
    return dict(color=colour(n), linestyle=STYLES[1:][n // len(COLOURS) % 3])
