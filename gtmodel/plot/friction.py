"""Force against velocity with the fitted lines, one panel for each actuator (compare Dressler 2012, Fig. 6.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from .panels import with_panels

MARKERS = ("*", "s", "o", "D", "+", "x", "^", "v")
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
FASTEST = 1.0  # m/s, where there are no points


def friction_figure(
    points: Sequence[tuple[str, np.ndarray, np.ndarray]],
    lines: Sequence[Callable[[np.ndarray], np.ndarray]],
    gravity: np.ndarray,
    *,
    title: str = "",
) -> Figure:
    """One panel per actuator.

    Args:
        points: name of a pose, velocities (runs, carts) [m/s] and forces (runs, carts) [N], gravity moved to that of
            the lines' pose.
        lines: by actuator, velocity -> modelled force [N]; not called at zero.
        gravity: (carts,) dotted level [N].
    """
    figure, panels = with_panels(4.2 * len(lines), 4.2, columns=len(lines), title=title, fontsize="medium")
    moving = np.concatenate([np.abs(v[np.isfinite(v)]) for _, v, _ in points] or [np.zeros(0)])
    fastest = float(moving.max()) if moving.size else FASTEST
    ahead = np.linspace(1e-6, 1.05 * fastest, 50)
    for i, axes in enumerate(panels):
        for way in (ahead, -ahead[::-1]):
            axes.plot(way, lines[i](way), color="black", linewidth=1.2)
        axes.plot([0, 0], [lines[i](-ahead[:1])[0], lines[i](ahead[:1])[0]], color="black", linewidth=0.6)
        axes.axhline(float(gravity[i]), color="0.4", linestyle=":", label="gravity")
        for k, (name, v, tau) in enumerate(points):
            axes.plot(
                v[:, i],
                tau[:, i],
                MARKERS[k % len(MARKERS)],
                color=COLOURS[k % len(COLOURS)],
                markersize=5,
                markerfacecolor="none",
                label=name,
            )
        axes.set(title=f"actuator {i + 1}", xlabel="velocity [m/s]")
    panels[0].set_ylabel("force at constant velocity [N]")
    panels[-1].legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure
