"""Path, velocities and motor forces of a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ..results.trajectory import Trajectory
from .panels import COLOURS, colour, with_panels
from .path import draw_path, head


def motion_figure(
    trajectory: Trajectory,
    polynomial: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    force_limit: float,
    obstacles: Sequence[tuple[np.ndarray, np.ndarray]] = (),
    path: np.ndarray | None = None,
    constant: bool = True,
) -> Figure:
    """Four panels: the path from the side and from the front, TCP velocity, and motor forces with their limit.

    Args:
        trajectory: with T [m], der(T) [m/s], tau [N]; the motion that is exported.
        polynomial: times (n,) and forces (n, motors) of the collocation optimum, drawn faintly: they may overshoot
            between its points.
        force_limit: [N].
        obstacles: boxes as (center, size) [m].
        path: (n, 3) [m], the path to follow, drawn in place of the straight line.
        constant: forces are constant per element, and drawn as steps.
    """
    figure, (side, front, speed, force) = with_panels(10.5, 7.0, 2, 2)
    T = trajectory["T"]
    for axes, plane in ((side, "xz"), (front, "yz")):
        a, b = map("xyz".index, plane)
        for center, size in obstacles:
            low = center - size / 2
            axes.add_patch(Rectangle((low[a], low[b]), size[a], size[b], color="0.85", zorder=0))
        draw_path(axes, T, plane, path)
    side.set_title("path seen from the side")
    front.set_title("path seen along the guideways")
    side.legend(fontsize="small")
    time = trajectory.time
    for k, name in enumerate("xyz"):
        speed.plot(time, trajectory["der(T)"][:, k], color=COLOURS[k], label=name)
    speed.set_title("TCP velocity")
    speed.set_ylabel("velocity [m/s]")
    for k in range(trajectory["tau"].shape[1]):
        if polynomial is not None:
            force.plot(polynomial[0], polynomial[1][:, k], color=colour(k), alpha=0.3, linewidth=0.8)
        style = "steps-pre" if constant else "default"
        force.plot(time, trajectory["tau"][:, k], drawstyle=style, color=colour(k), label=f"motor {k + 1}")
    for sign in (-1, 1):
        force.axhline(sign * force_limit, color="0.4", linestyle=":")
    highest = 0.0 if polynomial is None else float(np.max(np.abs(polynomial[1])))
    reach = 1.1 * max(1.4 * force_limit, float(np.max(np.abs(trajectory["tau"]))), highest)
    force.set_ylim(-reach, reach)
    title_text = "motor forces, constant per element" if constant else "motor forces"
    force.set_title(title_text + ("; faint: polynomial" if polynomial is not None else ""))
    force.set_ylabel("force [N]")
    for axes in (speed, force):
        axes.set_xlabel("time [s]")
        axes.legend(fontsize="small", ncols=3, loc="lower right")
    head(figure, trajectory)
    return figure


def force_figure(runs: Sequence[tuple[str, Trajectory]], *, force_limit: float) -> Figure:
    """Motor forces over time, one panel per motor and one curve per motion; as Dressler 2012, Fig. 3.10.

    Args:
        runs: (label, motion) with tau [N].
        force_limit: [N].
    """
    figure, panels = with_panels(8.0, 7.0, runs[0][1]["tau"].shape[1], title="motor forces", sharex=True)
    for k, axes in enumerate(panels):
        for n, (label, run) in enumerate(runs):
            axes.plot(run.time, run["tau"][:, k], color=COLOURS[n % len(COLOURS)], linewidth=1.0, label=label)
        for sign in (-1, 1):
            axes.axhline(sign * force_limit, color="0.4", linestyle=":")
        axes.set_ylabel(f"motor {k + 1} [N]")
    panels[-1].set_xlabel("time [s]")
    if len(runs) > 1:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize="small")
    return figure


def space_figure(runs: Sequence[tuple[str, Trajectory]]) -> Figure:
    """Paths of the tool centre point in space, one per motion; as Dressler 2012, Fig. 3.9.

    Args:
        runs: (label, motion) with T [m].
    """
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    for n, (label, run) in enumerate(runs):
        axes.plot(*run["T"].T, color=COLOURS[n % len(COLOURS)], label=label)
    T = runs[0][1]["T"]
    axes.scatter(*T[0], color="black", s=20, label="start")  # type: ignore[misc]
    for set_label, name in ((axes.set_xlabel, "x"), (axes.set_ylabel, "y"), (axes.set_zlabel, "z")):  # type: ignore[attr-defined]
        set_label(f"{name} [m]")
    axes.set_title("path of the tool centre point")
    axes.set_aspect("equal")
    axes.legend(fontsize="small")
    return figure
