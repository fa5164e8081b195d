"""A parallel robot in space: guideways, carts, links and plate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
TICKS = 5
STROKE = 0.6  # of a guideway drawn to each side of its cart where no ends are given, in link lengths


def draw_robot(
    axes: Any,
    carts: np.ndarray,
    joints: np.ndarray,
    T: np.ndarray,
    directions: np.ndarray,
    *,
    ends: np.ndarray | None = None,
    faint: bool = False,
) -> None:
    """Draw one pose into three-dimensional axes.

    Args:
        carts, joints: (l, 3) the ends of each link at its cart and at the plate [m].
        T: (3,) tool centre point [m].
        directions: (l, 3) of each link's guideway.
        ends: (l, 2, 3) of the guideways [m]; a piece about each cart if left out.
        faint: for further poses of the same robot; guideways are left out.
    """
    carts, joints = np.asarray(carts, float), np.asarray(joints, float)
    unit = np.asarray(directions, float) / np.linalg.norm(directions, axis=1, keepdims=True)
    length = np.linalg.norm(joints - carts, axis=1)
    if ends is None:
        reach = STROKE * length[:, None] * unit
        ends = np.stack([carts - reach, carts + reach], axis=1)
    strength = 0.3 if faint else 1.0
    for i, (cart, joint) in enumerate(zip(carts, joints, strict=True)):
        colour = COLOURS[i % len(COLOURS)]
        if not faint:
            axes.plot(*ends[i].T, color="0.6", linewidth=3, solid_capstyle="butt")
        label = None if faint else f"link {i + 1}"
        axes.plot(*np.stack([cart, joint]).T, color=colour, linewidth=2, alpha=strength, label=label)
        axes.plot(*cart, "s", color="black", markersize=6, alpha=strength)
        axes.plot(*joint, "o", color=colour, markersize=4, alpha=strength)
    if np.ptp(joints, axis=0).max() > 0:  # the plate, as rays from the tool centre point
        for joint in joints:
            axes.plot(*np.stack([T, joint]).T, color="black", linewidth=1, alpha=strength)
    axes.plot(*np.asarray(T, float), "D", color="black", markersize=6, alpha=strength)


def robot_figure(
    carts: np.ndarray,
    joints: np.ndarray,
    T: np.ndarray,
    directions: np.ndarray,
    *,
    ends: np.ndarray | None = None,
    curves: Sequence[np.ndarray] = (),
    title: str = "",
) -> Figure:
    """One pose of a robot, see `draw_robot`, and closed curves (k, 3) [m] such as the boundary of its workspace."""
    figure = Figure(figsize=(8.0, 6.5), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d")
    draw_robot(axes, carts, joints, T, directions, ends=ends)
    for k, curve in enumerate(curves):
        closed = np.vstack([curve, curve[:1]])
        axes.plot(*closed.T, color="0.3", linestyle="--", label="boundary of the section" if k == 0 else None)
    finish(axes)
    axes.legend(fontsize="small", loc="upper left")
    figure.suptitle(title or "robot at its home pose")
    return figure


def finish(axes: Any) -> None:
    """Equal scales, names of the axes and a view from the side of positive x and negative y."""
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(TICKS))
    axes.set_aspect("equal")
    axes.view_init(elev=20.0, azim=-55.0)
