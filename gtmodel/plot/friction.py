"""Force against velocity with the fitted lines, one panel for each actuator (compare Dressler 2012, Fig. 6.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from .style import LIMIT, colour, key_below, styled, with_panels

MARKERS = ("*", "s", "o", "D", "+", "x", "^", "v")
FASTEST = 1.0  # m/s, where there are no points


@styled
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
    rows = 2 if points else 1
    figure, panels = with_panels(3.6 * len(lines), 1.4 + 2.4 * rows, rows, len(lines), title=title, fontsize="medium",
                                 sharex=True, height_ratios=[2, 1][:rows])  # fmt: skip
    panels = panels.reshape(rows, -1)
    moving = np.concatenate([np.abs(v[np.isfinite(v)]) for _, v, _ in points] or [np.zeros(0)])
    fastest = float(moving.max()) if moving.size else FASTEST
    ahead = np.linspace(1e-6, 1.05 * fastest, 50)
    for i, axes in enumerate(panels[0]):
        for n, way in enumerate((ahead, -ahead[::-1])):
            axes.plot(way, lines[i](way), color="black", linewidth=1.2, label="fitted law" if n == 0 else None)
        axes.plot([0, 0], [lines[i](-ahead[:1])[0], lines[i](ahead[:1])[0]], color="black", linewidth=0.6)
        axes.axhline(float(gravity[i]), label="gravity", **LIMIT)
        axes.set(title=f"actuator {i + 1}", ylabel="force at constant velocity [N]")
        for k, (name, v, tau) in enumerate(points):
            look = dict(linestyle="none", color=colour(k), marker=MARKERS[k % len(MARKERS)], markersize=5,
                        markerfacecolor="none")  # fmt: skip
            axes.plot(v[:, i], tau[:, i], label=f"measured, {name}", **look)
            panels[1, i].plot(v[:, i], tau[:, i] - _of_moving(lines[i], v[:, i]), **look)
    for axes in panels[1:].ravel():
        axes.axhline(0.0, color="black", linewidth=1.0)
        axes.set_ylabel("measured - law [N]")
    for axes in panels[-1]:
        axes.set_xlabel("velocity [m/s]")
    key_below(figure, panels[0, 0])
    return figure


def _of_moving(line: Callable[[np.ndarray], np.ndarray], v: np.ndarray) -> np.ndarray:
    """The law where something moves, NaN elsewhere."""
    moves = np.isfinite(v) & (v != 0)
    force = np.full(len(v), np.nan)
    force[moves] = line(v[moves])
    return force
