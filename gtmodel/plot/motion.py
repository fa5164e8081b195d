"""Path, velocities and motor forces of a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ..results.trajectory import Trajectory
from .path import draw_path, head
from .robot3d import fill, finish
from .style import COLOURS, LIMIT, colour, in_space, key_below, key_under, styled, with_panels


@styled
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
    figure, (side, front, speed, force) = with_panels(10.0, 7.8, 2, 2)
    T = trajectory["T"]
    for axes, plane in ((side, "xz"), (front, "yz")):
        a, b = map("xyz".index, plane)
        for center, size in obstacles:
            low = center - size / 2
            axes.add_patch(Rectangle((low[a], low[b]), size[a], size[b], color="0.85", zorder=0))
        draw_path(axes, T, plane, path)
    side.set_title("path of the tool centre point, x and z")
    front.set_title("the same path, y and z")
    for axes in (side, front):
        key_under(axes)
    time = trajectory.time
    for k, name in enumerate("xyz"):
        speed.plot(time, trajectory["der(T)"][:, k], color=COLOURS[k], label=name)
    speed.set_title("velocity of the tool centre point")
    speed.set_ylabel("velocity [m/s]")
    for k in range(trajectory["tau"].shape[1]):
        if polynomial is not None:
            force.plot(polynomial[0], polynomial[1][:, k], color=colour(k), alpha=0.3, linewidth=0.8)
        style = "steps-pre" if constant else "default"
        force.plot(time, trajectory["tau"][:, k], drawstyle=style, color=colour(k), label=f"motor {k + 1}")
    for sign in (-1, 1):
        force.axhline(sign * force_limit, label="limit" if sign == 1 else None, **LIMIT)
    highest = 0.0 if polynomial is None else float(np.max(np.abs(polynomial[1])))
    reach = 1.1 * max(1.4 * force_limit, float(np.max(np.abs(trajectory["tau"]))), highest)
    force.set_ylim(-reach, reach)
    title_text = "motor forces, constant per element" if constant else "motor forces"
    force.set_title(title_text + ("; faint: polynomial" if polynomial is not None else ""))
    force.set_ylabel("force [N]")
    for axes in (speed, force):
        axes.set_xlabel("time [s]")
        key_under(axes)
    head(figure, trajectory)
    return figure


@styled
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
            axes.axhline(sign * force_limit, label="limit" if sign == 1 else None, **LIMIT)
        axes.set_ylabel(f"force of motor {k + 1} [N]")
    panels[-1].set_xlabel("time [s]")
    key_below(figure, panels[0], columns=5)
    return figure


@styled
def space_figure(runs: Sequence[tuple[str, Trajectory]]) -> Figure:
    """Paths of the tool centre point in space, one per motion; as Dressler 2012, Fig. 3.9.

    Args:
        runs: (label, motion) with T [m].
    """
    figure, axes = in_space(8.0, 6.0, title="paths of the tool centre point")
    for n, (label, run) in enumerate(runs):
        axes.plot(*run["T"].T, color=COLOURS[n % len(COLOURS)], label=label)
    T = runs[0][1]["T"]
    axes.plot(*T[0], "o", markerfacecolor="white", markeredgecolor="black", linestyle="none", label="start")
    axes.plot(*T[-1], "o", color="black", linestyle="none", label="goal")
    finish(axes)
    key_below(figure, axes, columns=6)
    fill(figure, axes)
    return figure
