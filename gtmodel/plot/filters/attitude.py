"""Errors of the attitude between references, and what a calibrated gyro leaves of the turns between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from ..style import LIMIT, colour, curve, key_below, styled, with_panels

BINS = 7  # of the time since the left reference: a reference in each of them


@styled
def gap_figure(
    panels: Sequence[tuple[float, np.ndarray, Mapping[str, np.ndarray]]], labels: Mapping[str, str], *, title: str = ""
) -> Figure:
    """One panel per length of gap: mean error over the time since the left end, one curve per method.

    panels: length of the gap [s], time since its left end (n,) [s], errors (n,) by method [rad]. labels: of methods.
    """
    figure, axes = with_panels(4.2 * len(panels), 4.2, 1, len(panels), title=title, sharey=True)
    axes = np.atleast_1d(axes).ravel()
    for panel, (gap, since, errors) in zip(axes, panels, strict=True):
        edges = np.linspace(0.0, float(since.max()), BINS + 1)
        place = np.clip(np.searchsorted(edges, since, side="right") - 1, 0, len(edges) - 2)
        full = [k for k in range(len(edges) - 1) if np.any(place == k)]
        middle = [float(np.mean(since[place == k])) for k in full]
        for n, (name, label) in enumerate(labels.items()):
            means = [float(np.degrees(np.mean(errors[name][place == k]))) for k in full]
            panel.semilogy(middle, np.maximum(means, 1e-3), label=label, **curve(n))
        panel.set(title=f"references {gap:g} s apart", xlabel="time since the left one [s]")
    axes[0].set_ylabel("mean error [deg]")
    key_below(figure, *axes, columns=2)
    return figure


@styled
def turn_residual_figure(parts: Sequence[tuple[np.ndarray, np.ndarray]], *, title: str = "") -> Figure:
    """Turns between neighbouring references less those of the gyro, calibrated on each part by itself.

    parts: time (n,) [s] and rotation vectors (n, 3) [rad] of each.
    """
    figure, panels = with_panels(7.0, 5.4, 3, 1, title=title, sharex=True)
    for k, panel in enumerate(panels):
        for n, (time, left) in enumerate(parts):
            panel.plot(time, np.degrees(left[:, k]), color=colour(n), linestyle="none", marker=".", markersize=3)
        panel.axhline(0.0, **LIMIT)
        panel.set_ylabel(f"about {'xyz'[k]} [deg]")
    panels[-1].set_xlabel("time of the reference [s]; the parts differ in colour")
    return figure
