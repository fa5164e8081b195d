"""Pictures of a parallel robot in space (guideways, carts, links, plate) and of its assembly modes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import product
from typing import Any, cast

import numpy as np
import scipy
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d.proj3d import proj_transform

from .style import COLOURS, HIGHLIGHT, ORANGE, in_space, key_below, styled, with_panels

TICKS = 5
MARGIN = 0.12  # inches around a picture in space
ZOOMS = 2  # iterations: perspective and the axis labels change with the zoom
STROKE = 0.6  # length of guideway drawn to each side of a cart if its ends are unknown, in mean link lengths
FLAT = 1e-9  # smaller relative extents of the plate joints count as zero


def draw_robot(
    axes: Any,
    A: np.ndarray,
    joints: np.ndarray,
    carts: Sequence[Sequence[int]],
    guideways: np.ndarray,
    *,
    T: np.ndarray | None = None,
    width: float = 2.0,
) -> None:
    """Draw one pose into three-dimensional axes: guideways, carts, links with one colour per cart, and the plate.

    Args:
        A, joints: (l, 3), ends of each link at its cart and at the plate [m].
        carts: links of each cart.
        guideways: (g, 2, 3), their ends [m].
        T: (3,), tool centre point [m], drawn with lines to the plate joints.
        width: of the links [points]; other sizes are proportional to it.
    """
    for k, line in enumerate(guideways):
        axes.plot(*line.T, color="0.7", linewidth=1.8 * width, solid_capstyle="butt", zorder=0,
                  label="guideway" if k == 0 else None)  # fmt: skip
    for n, legs in enumerate(map(list, carts)):
        colour = COLOURS[n % len(COLOURS)]
        if len(legs) > 1:  # outline of the cart
            axes.plot(*A[[*legs, legs[0]]].T, color="0.35", linewidth=width)
        for k in legs:
            axes.plot(*np.stack([A[k], joints[k]]).T, color=colour, linewidth=width, label=f"link {k + 1}")
        label = "joint at the cart" if n == 0 else None
        axes.plot(*A[legs].T, "s", color="black", markersize=2.2 * width, label=label)
        axes.plot(*joints[legs].T, "o", color=colour, markersize=1.6 * width)
    for face in plate_faces(joints):
        axes.plot_trisurf(*joints.T, triangles=[face], color="0.5", alpha=0.35, linewidth=0, shade=False)
    if T is not None:
        for joint in joints:
            axes.plot(*np.stack([T, joint]).T, color="black", linewidth=0.5 * width)
        axes.plot(*np.asarray(T, float), "D", color="black", markersize=3.0 * width, linestyle="none",
                  label="tool centre point")  # fmt: skip


@styled
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
    """Draw a robot at its home pose, and closed curves (k, 3) [m] such as the boundary of its workspace.

    Args:
        carts, joints: (l, 3), ends of each link at its cart and at the plate [m].
        T: (3,), tool centre point [m].
        directions: (l, 3), direction of each link's guideway.
        ends: (l, 2, 3), ends of the guideways [m]; if left out, a piece around each cart is drawn.
    """
    figure, axes = in_space(8.0, 5.8, title=f"{title or 'robot'}: home pose")
    draw_links(axes, carts, joints, T, directions, ends=ends)
    for k, curve in enumerate(curves):
        closed = np.vstack([curve, curve[:1]])
        axes.plot(*closed.T, color="0.3", linestyle="--", label="boundary of the section" if k == 0 else None)
    finish(axes)
    key_below(figure, axes)
    fill(figure, axes)
    return figure


def draw_links(
    axes: Any,
    carts: np.ndarray,
    joints: np.ndarray,
    T: np.ndarray,
    directions: np.ndarray,
    *,
    ends: np.ndarray | None = None,
) -> None:
    """Draw one pose with one cart per link; arguments as in `robot_figure`."""
    carts, joints = np.asarray(carts, float), np.asarray(joints, float)
    each = [(k,) for k in range(len(carts))]
    reach = STROKE * float(np.mean(np.linalg.norm(joints - carts, axis=1)))
    draw_robot(axes, carts, joints, each, pieces(carts, each, directions, reach) if ends is None else ends, T=T)


def finish(axes: Any) -> None:
    """Set equal scales, axis labels, few ticks, and a view from the side."""
    for axis, name in ((axes.xaxis, "x"), (axes.yaxis, "y"), (axes.zaxis, "z")):
        axis.set_label_text(f"{name} [m]")
        axis.labelpad = 10
    sides = np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
    for axis, part in zip((axes.xaxis, axes.yaxis, axes.zaxis), sides / sides.max(), strict=True):
        axis.set_major_locator(MaxNLocator(max(2, round(TICKS * float(part)))))  # few on a short side
    axes.set_aspect("equal")
    from_the_side(axes)


def fill(figure: Figure, axes: Any) -> None:
    """Zoom the axes, with their labels, to the space between title and legend; the last step of a figure.

    Three-dimensional axes are square by default: a flat or tall box fills them poorly, and artists outside are clipped.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    low, high = np.array([0.0, 0.0]), np.array([figure.bbox.width, figure.bbox.height])
    low[1] = max([low[1], *(legend.get_window_extent().y1 for legend in figure.legends)])
    high[1] = min([high[1], *(text.get_window_extent().y0 for text in figure.texts)])
    low, high = low + MARGIN * figure.dpi, high - MARGIN * figure.dpi
    sides = np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
    zoom = 1.0
    for _ in range(ZOOMS):
        labelled, box = _extent(axes)
        zoom *= float(np.min((high - low - np.ptp(labelled, axis=0) + np.ptp(box, axis=0)) / np.ptp(box, axis=0)))
        axes.set_box_aspect(sides, zoom=zoom)
        figure.draw_without_rendering()
        shift = (low + high - _extent(axes)[0].sum(axis=0)) / 2 / [figure.bbox.width, figure.bbox.height]
        axes.set_position(axes.get_position().translated(*shift))
    for artist in (*axes.lines, *axes.collections):
        artist.set_clip_on(False)


def _extent(axes: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return lower left and upper right corner (2, 2) [pixels] as last drawn: with labels and ticks, and of the box."""
    x, y, z = np.array(list(product(axes.get_xlim(), axes.get_ylim(), axes.get_zlim()))).T
    u, v, _ = proj_transform(x, y, z, axes.get_proj())
    corners = axes.transData.transform(np.column_stack([u, v]))
    box = np.array([corners.min(axis=0), corners.max(axis=0)])
    labels = [axis.get_tightbbox(None) for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    return Bbox.union([Bbox(box), *labels]).get_points(), box


def from_the_side(axes: Any) -> None:
    """Set a view from positive x and negative y."""
    axes.view_init(elev=20.0, azim=-55.0)


def pieces(A: np.ndarray, carts: Sequence[Sequence[int]], directions: np.ndarray, reach: float) -> np.ndarray:
    """Return the ends (g, 2, 3) of guideways through the centre of each cart's joints, `reach` [m] to each side.

    A: (l, 3), joints at the carts [m]. directions: (l, 3), of the guideways, of any length.
    """
    lines = []
    for legs in map(list, carts):
        direction = np.asarray(directions, float)[legs].mean(axis=0)
        half = reach * direction / np.linalg.norm(direction)
        middle = A[legs].mean(axis=0)
        lines.append([middle - half, middle + half])
    return np.array(lines)


def plate_faces(joints: np.ndarray) -> np.ndarray:
    """Return triangles (t, 3) of the convex hull of the plate joints, in their plane if coplanar, none if collinear."""
    centred = joints - joints.mean(axis=0)
    _, extent, axes = np.linalg.svd(centred, full_matrices=False)
    extent = np.pad(extent, (0, 3 - len(extent)))  # fewer than three joints span no plane
    if extent[2] > FLAT * extent[0]:
        return scipy.spatial.ConvexHull(joints).simplices
    if not extent[1] > FLAT * extent[0]:
        return np.zeros((0, 3), dtype=int)
    around = scipy.spatial.ConvexHull(centred @ axes[:2].T).vertices
    return np.array([[around[0], around[i], around[i + 1]] for i in range(1, len(around) - 1)])


MARKED = ORANGE
SHORT_STROKE = 0.25  # length of guideway drawn to each side of a cart, in mean link lengths
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
    """Draw each real assembly mode in a small three-dimensional panel, all at the same scale and view.

    Args:
        A: (6, 3), joints at the carts [m]. B: (6, 3), plate joints in plate coordinates [m].
        R, T: (m, 3, 3), (m, 3), plate poses of the modes.
        commanded: index of the commanded mode, which is marked.
        carts: links of each cart, drawn in one colour.
        directions: (6, 3), of the guideways, which are drawn only if this is set.
    """
    m = len(T)
    columns = max(1, int(np.ceil(np.sqrt(1.5 * m)))) if m > 4 else max(1, m)
    rows = max(1, -(-m // columns))
    side = 2.7 if m <= 12 else 1.9
    figure = Figure(figsize=(max(side * columns, 4.0), side * rows + 0.6), layout="constrained")
    if m <= 12 and rows > 1:  # room for the axis labels of the first panel above the title of the next
        cast(ConstrainedLayoutEngine, figure.get_layout_engine()).set(hspace=PANEL_GAP)
    figure.suptitle(f"{title}\n{_counted(m, commanded)}".strip(), fontsize="medium")
    joints = T[:, None] + B @ np.swapaxes(R, 1, 2)
    reach = SHORT_STROKE * (float(np.mean(np.linalg.norm(joints - A, axis=2))) if m else 1.0)
    guideways = np.zeros((0, 2, 3)) if directions is None else pieces(A, carts, directions, reach)
    everything = np.concatenate([A, joints.reshape(-1, 3), guideways.reshape(-1, 3)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    for k in range(m):
        axes: Any = figure.add_subplot(rows, columns, k + 1, projection="3d")
        draw_robot(axes, A, joints[k], carts, guideways, width=0.9 if m > 12 else 1.6)
        _frame(axes, low, high, named=k == 0 and m <= 12)
        name = f"{k + 1}, commanded" if k == commanded else f"{k + 1}"
        look = dict(color=MARKED, fontweight="bold") if k == commanded else dict(color="black")
        axes.set_title(name, fontsize="small", pad=0, **look)
        if k == commanded:
            axes.patch.set(facecolor=HIGHLIGHT, alpha=1.0)
    return figure


@styled
def real_counts_figure(counts: Sequence[int], nearest: np.ndarray, *, title: str = "") -> Figure:
    """Draw a histogram of the number of real modes, and how close the nearest other mode is to the commanded one.

    counts: number of real modes of each pose. nearest: (n, 2), distance [mm] and angle [deg]; rows that are not finite
    are left out.
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
    right.set(xlabel="distance [mm]", ylabel="angle [deg]", title="distance of the nearest other mode")
    right.set_xlim(left=0.0)
    right.set_ylim(bottom=0.0)
    return figure


def _counted(m: int, commanded: int | None) -> str:
    text = f"{m} real assembly modes" if m else "no real assembly mode"
    return text if commanded is None else f"{text}; number {commanded + 1} is commanded"


def _frame(axes: Any, low: np.ndarray, high: np.ndarray, *, named: bool) -> None:
    """Set the same limits in all panels; tick labels are small, so only the first panel has axis labels."""
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
