"""Axes, motor forces and the path of the plate of a robot with three carts and three rotary axes."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..results.trajectory import Trajectory
from .path import draw_path, head
from .style import COLOURS, LIMIT, key_under, styled, with_panels


@styled
def axis_motion_figure(
    trajectory: Trajectory, *, force_limit: float, torque_limit: float, path: np.ndarray | None = None
) -> Figure:
    """Six panels: the path of the tool centre point from two sides, carts and their forces, angles and their torques.

    Args:
        trajectory: with q (6) [m, rad], T (3) [m] and tau (6) [N, N.m].
        force_limit: of the carts [N]; torque_limit: of the rotary axes [N.m].
        path: (n, 3) [m], the path to follow, drawn in place of the straight line.
    """
    figure, panels = with_panels(12.0, 7.8, 2, 3)
    panels = panels.reshape(2, 3)
    draw_path(panels[0, 0], trajectory["T"], "xz", path)
    draw_path(panels[1, 0], trajectory["T"], "yz", path)
    panels[0, 0].set_title("path of the tool centre point, x and z")
    panels[1, 0].set_title("the same path, y and z")
    for axes in panels[:, 0]:
        key_under(axes, columns=2)
    carts, angles = trajectory["q"][:, :3], np.degrees(trajectory["q"][:, 3:])
    forces, torques = trajectory["tau"][:, :3], trajectory["tau"][:, 3:]
    for axes, curves, what, first, title, unit, limit in (
        (panels[0, 1], carts, "q", 1, "positions of the carts", "position [m]", None),
        (panels[1, 1], forces, "motor ", 1, "forces of the carts", "force [N]", force_limit),
        (panels[0, 2], angles, "q", 4, "angles of the rotary axes", "angle [deg]", None),
        (panels[1, 2], torques, "motor ", 4, "torques of the rotary axes", "torque [N m]", torque_limit),
    ):
        for k in range(3):
            axes.plot(trajectory.time, curves[:, k], color=COLOURS[k], label=f"{what}{first + k}")
        for bound in (-limit, limit) if limit is not None else ():
            axes.axhline(bound, label="limit" if bound == limit else None, **LIMIT)
        axes.set_title(title)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(unit)
        key_under(axes)
    head(figure, trajectory)
    return figure
