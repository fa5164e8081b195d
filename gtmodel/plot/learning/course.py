"""Error against iteration, with what was predicted before the first one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ..style import GREEN, LIMIT, MODELLED, key_below, styled, with_panels


@styled
def course_figure(
    names: Sequence[str], errors: np.ndarray, predicted: np.ndarray, floors: Sequence[float], rates: Sequence[float],
    tool: np.ndarray | None = None, title: str = "",
) -> Figure:  # fmt: skip
    """A panel for each axis: errors (axes, runs) of the estimate, predicted (axes, iterations + 1), the floor, the rate
    sigma of (7.16), and the true tool's error (axes, runs) where it is known; all root mean squares [m]."""
    figure, panels = with_panels(4.2 * len(names), 4.4, 1, len(names), title=title, sharey=True)
    for k, (panel, name) in enumerate(zip(panels, names, strict=True)):
        panel.semilogy(1e6 * predicted[k], label="predicted before learning", **MODELLED)
        panel.semilogy(1e6 * errors[k], "k.", markersize=7, label="error of the estimate", zorder=3)
        if tool is not None:
            panel.semilogy(1e6 * tool[k], "x", color=GREEN, label="error of the tool", zorder=3)
        panel.axhline(1e6 * floors[k], **LIMIT, label="floor, predicted")
        k_axis = np.arange(predicted.shape[1])
        panel.semilogy(k_axis, 1e6 * predicted[k][0] * rates[k] ** k_axis, "--", color="0.6", label="slowest rate")
        low = 0.5e6 * min(float(np.min(errors[k], initial=np.inf)), floors[k], float(predicted[k].min()))
        panel.set_ylim(bottom=low if low > 0 else None)
        panel.set(title=f"{name}: sigma {rates[k]:.2f}", xlabel="iteration")
    panels[0].set_ylabel("rms error [um]")
    key_below(figure, *panels, columns=3)
    return figure
