"""Assembly modes: the real ones side by side as small robots, and how many there are over many poses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator

from .robot3d import draw_robot, from_the_side, pieces
from .style import COLOURS, HIGHLIGHT, ORANGE, styled, with_panels

MARKED = ORANGE
STROKE = 0.25  # of a guideway drawn to each side of its carts, in mean link lengths
PANEL_GAP = 0.12  # between rows of panels, in panel heights


@styled
def modes_figure(
    A: np.ndarray,
    B: np.ndarray,
    R: np.ndarray,
    T: np.ndarray,
    *,
    commanded: int | None = None,
    carts: Sequence[Sequence[int]] = tuple((k,) for k in range(6)),
    directions: np.ndarray | None = None,
    title: str = "",
) -> Figure:
    """One small three-dimensional panel per real mode, all in one scale and view.

    Args:
        A: (6, 3) joints at the carts [m]. B: (6, 3) plate joints in plate coordinates [m].
        R, T: (m, 3, 3), (m, 3) the modes.
        commanded: index of the mode that is marked.
        carts: legs of each cart, which share a colour.
        directions: (6, 3) ways of the cart joints; their guideways are drawn.
    """
    m = len(T)
    columns = max(1, int(np.ceil(np.sqrt(1.5 * m)))) if m > 4 else max(1, m)
    rows = max(1, -(-m // columns))
    side = 2.7 if m <= 12 else 1.9
    figure = Figure(figsize=(max(side * columns, 4.0), side * rows + 0.6), layout="constrained")
    if m <= 12 and rows > 1:  # the names of the first panel's axes stand below it, above the next one's title
        cast(ConstrainedLayoutEngine, figure.get_layout_engine()).set(hspace=PANEL_GAP)
    figure.suptitle(f"{title}\n{_counted(m, commanded)}".strip(), fontsize="medium")
    joints = T[:, None] + B @ np.swapaxes(R, 1, 2)
    reach = STROKE * (float(np.mean(np.linalg.norm(joints - A, axis=2))) if m else 1.0)
    guideways = np.zeros((0, 2, 3)) if directions is None else pieces(A, carts, directions, reach)
    everything = np.concatenate([A, joints.reshape(-1, 3), guideways.reshape(-1, 3)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    for k in range(m):
        axes: Any = figure.add_subplot(rows, columns, k + 1, projection="3d")
        draw_robot(axes, A, joints[k], carts, guideways, width=0.9 if m > 12 else 1.6)
        _frame(axes, low, high, named=k == 0 and m <= 12)
        name = f"{k + 1}, commanded" if k == commanded else f"{k + 1}"
        shown = dict(color=MARKED, fontweight="bold") if k == commanded else dict(color="black")
        axes.set_title(name, fontsize="small", pad=0, **shown)
        if k == commanded:
            axes.patch.set(facecolor=HIGHLIGHT, alpha=1.0)
    return figure


@styled
def real_counts_figure(counts: Sequence[int], nearest: np.ndarray, *, title: str = "") -> Figure:
    """How many poses have how many real modes, and how near the commanded mode another one is.

    counts: real modes of each pose. nearest: (n, 2) distance [mm] and angle [deg]; rows that are not finite are left
    out.
    """
    figure, (left, right) = with_panels(9.0, 3.8, columns=2, title=title)
    poses_by_count = Counter(counts)
    left.bar(list(poses_by_count), list(poses_by_count.values()), width=1.4, color=COLOURS[0])
    left.set(xlabel="number of real modes", ylabel="number of poses", title="real modes per pose")
    left.set_xticks(range(0, max(poses_by_count, default=0) + 3, 2))
    left.yaxis.set_major_locator(MaxNLocator(integer=True))
    near = np.asarray(nearest, dtype=float).reshape(-1, 2)
    near = near[np.isfinite(near).all(axis=1)]
    right.plot(*near.T, "o", color=COLOURS[1], markersize=4, alpha=0.7)
    right.set(xlabel="distance [mm]", ylabel="angle [deg]", title="nearest other mode to the commanded one")
    right.set_xlim(left=0.0)
    right.set_ylim(bottom=0.0)
    return figure


def _counted(m: int, commanded: int | None) -> str:
    text = f"{m} real assembly modes" if m else "no real assembly mode"
    return text if commanded is None else f"{text}; the commanded one is number {commanded + 1}"


def _frame(axes: Any, low: np.ndarray, high: np.ndarray, *, named: bool) -> None:
    """One scale for all panels; numbers would not be readable, so the first names the axes and the rest keep still."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(high - low, 1e-3 * np.max(high - low)), zoom=1.05)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(3))
        axis.set_tick_params(labelsize=7, pad=-3)
        if not named:
            axis.set_ticklabels([])
    if named:
        axes.set_xlabel("x [m]", fontsize=8, labelpad=-6)
        axes.set_ylabel("y [m]", fontsize=8, labelpad=-6)
        axes.set_zlabel("z [m]", fontsize=8, labelpad=-6)
    from_the_side(axes)
