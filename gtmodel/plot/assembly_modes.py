"""Assembly modes: the real ones side by side as small robots, and how many there are over many poses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator
from scipy.spatial import ConvexHull

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")  # readable with colour-blind eyes
MARKED = "#b00020"
STROKE = 0.25  # of a guideway drawn to each side of its carts, in mean link lengths
PANEL_GAP = 0.12  # between rows of panels, in panel heights
FLAT = 1e-9  # least extent of the plate joints, relative, in a direction that counts


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
    guideways = _guideways(A, carts, directions, float(np.mean(np.linalg.norm(joints - A, axis=2))) if m else 1.0)
    everything = np.concatenate([A, joints.reshape(-1, 3), guideways.reshape(-1, 3)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    for k in range(m):
        axes: Any = figure.add_subplot(rows, columns, k + 1, projection="3d")
        draw_platform(axes, A, joints[k], carts, guideways, small=m > 12)
        _frame(axes, low, high, named=k == 0 and m <= 12)
        name = f"{k + 1}, commanded" if k == commanded else f"{k + 1}"
        shown = dict(color=MARKED, fontweight="bold") if k == commanded else dict(color="black")
        axes.set_title(name, fontsize="small", pad=0, **shown)
        if k == commanded:
            axes.patch.set(facecolor="#fff3c4", alpha=1.0)
    return figure


def draw_platform(
    axes: Any,
    A: np.ndarray,
    joints: np.ndarray,
    carts: Sequence[Sequence[int]],
    guideways: np.ndarray,
    *,
    small: bool = False,
) -> None:
    """Draw one mode into three-dimensional axes: guideways (g, 2, 3), carts, links from A to joints, plate."""
    width = 0.9 if small else 1.6
    for line in guideways:
        axes.plot(*line.T, color="0.75", linewidth=2 * width, solid_capstyle="butt", zorder=0)
    for colour, legs in zip(COLOURS, carts, strict=False):
        legs = list(legs)
        if len(legs) > 1:  # the cart or joint plate that carries them
            axes.plot(*A[[*legs, legs[0]]].T, color="0.35", linewidth=width)
        for k in legs:
            axes.plot(*np.stack([A[k], joints[k]]).T, color=colour, linewidth=width)
        axes.plot(*A[legs].T, "s", color="black", markersize=2.0 if small else 3.5)
        axes.plot(*joints[legs].T, "o", color=colour, markersize=1.5 if small else 2.5)
    for face in _faces(joints):
        axes.plot_trisurf(*joints.T, triangles=[face], color="0.5", alpha=0.35, linewidth=0, shade=False)


def real_counts_figure(counts: Sequence[int], nearest: np.ndarray, *, title: str = "") -> Figure:
    """How many poses have how many real modes, and how near the commanded mode another one is.

    counts: real modes of each pose. nearest: (n, 2) distance [mm] and angle [deg]; rows that are not finite are left
    out.
    """
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    found = Counter(counts)
    left.bar(list(found), list(found.values()), width=1.4, color=COLOURS[0])
    left.set(xlabel="real modes", ylabel="poses", title="real modes per pose")
    left.set_xticks(range(0, max(found, default=0) + 3, 2))
    left.yaxis.set_major_locator(MaxNLocator(integer=True))
    near = np.asarray(nearest, dtype=float).reshape(-1, 2)
    near = near[np.isfinite(near).all(axis=1)]
    right.plot(*near.T, "o", color=COLOURS[1], markersize=4, alpha=0.7)
    right.set(xlabel="distance [mm]", ylabel="angle [deg]", title="nearest other mode to the commanded one")
    right.set_xlim(left=0.0)
    right.set_ylim(bottom=0.0)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.suptitle(title)
    return figure


def _counted(m: int, commanded: int | None) -> str:
    text = f"{m} real assembly modes" if m else "no real assembly mode"
    return text if commanded is None else f"{text}; the commanded one is number {commanded + 1}"


def _guideways(A: np.ndarray, carts: Sequence[Sequence[int]], directions: np.ndarray | None, size: float) -> np.ndarray:
    """Ends (g, 2, 3) of a piece of guideway through the middle of each cart's joints."""
    if directions is None:
        return np.zeros((0, 2, 3))
    lines = []
    for legs in map(list, carts):
        way = directions[legs].mean(axis=0)
        reach = STROKE * size * way / np.linalg.norm(way)
        middle = A[legs].mean(axis=0)
        lines.append([middle - reach, middle + reach])
    return np.array(lines)


def _faces(joints: np.ndarray) -> np.ndarray:
    """Triangles (t, 3) of the convex hull of the plate joints; of their plane where they are in one; else none."""
    centred = joints - joints.mean(axis=0)
    _, extent, axes = np.linalg.svd(centred, full_matrices=False)
    if extent[2] > FLAT * extent[0]:
        return ConvexHull(joints).simplices
    if not extent[1] > FLAT * extent[0]:
        return np.zeros((0, 3), dtype=int)
    around = ConvexHull(centred @ axes[:2].T).vertices
    return np.array([[around[0], around[i], around[i + 1]] for i in range(1, len(around) - 1)])


def _frame(axes: Any, low: np.ndarray, high: np.ndarray, *, named: bool) -> None:
    """One scale for all panels; numbers would not be readable, so the first names the axes and the rest keep still."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(high - low, 1e-3 * np.max(high - low)), zoom=1.05)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(3))
        axis.set_tick_params(labelsize=5, pad=-3)
        if not named:
            axis.set_ticklabels([])
    if named:
        axes.set_xlabel("x [m]", fontsize=6, labelpad=-8)
        axes.set_ylabel("y [m]", fontsize=6, labelpad=-8)
        axes.set_zlabel("z [m]", fontsize=6, labelpad=-8)
    axes.view_init(elev=20.0, azim=-55.0)
