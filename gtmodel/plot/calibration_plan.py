"""Pictures of a calibration plan: points in the room, numbers of poses, parameters, predicted errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from .robot3d import draw_links, fill, finish
from .style import (
    AMBER,
    BLUE,
    GREEN,
    ORANGE,
    PINK,
    SHADES,
    in_space,
    key_below,
    millionths,
    plain_logarithm,
    styled,
    with_panels,
)  # fmt: skip

# colour, size, opacity; other layers are what the picture is about
LAYERS: Mapping[str, tuple[str, float, float]] = {
    "candidates": ("0.8", 2.0, 0.3), "calibrate": (ORANGE, 34.0, 1.0), "held out": (BLUE, 22.0, 1.0),
    "reached, but not safe": ("0.7", 4.0, 0.4), "not seen": (PINK, 6.0, 0.6),
    "seen, too near the edge": ("0.6", 5.0, 0.5),
}  # fmt: skip
MAIN = (BLUE, 9.0, 0.35)
CORNERS = np.array(list(np.ndindex(2, 2, 2)))
EDGES = [(i, j) for i in range(8) for j in range(i) if np.sum(CORNERS[i] != CORNERS[j]) == 1]
FACES = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
Box = tuple[np.ndarray, np.ndarray]


@styled
def room_figure(
    robot: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    layers: Mapping[str, np.ndarray],
    *,
    room: Box,
    boxes: Sequence[Box] = (),
    device: np.ndarray | None = None,
    again: str = "of them more than once",
    title: str = "",
) -> Figure:
    """Layers of points (n, 3) [m] with their numbers in the legend, the robot at home, the room as a wire box.

    Args:
        robot: ends of its links at carts and plate (l, 3), tool centre point (3,), guideway directions (l, 3).
        boxes: obstacles, corners low and high (3,) [m]. device: where it stands (3,) [m]. again: what points are that
            a layer holds several times.
    """
    figure, axes = in_space(8.5, 6.4, title=title)
    axes.computed_zorder = False  # what the picture is about over the other points, the robot over both
    draw_links(axes, *robot)
    for name, T in layers.items():
        colour, size, strength = LAYERS.get(name, MAIN)
        at, times = np.unique(np.asarray(T).reshape(-1, 3), axis=0, return_counts=True)
        twice = f", {np.count_nonzero(times > 1)} {again}" if np.any(times > 1) else ""
        axes.scatter(*at.T, s=size * times, color=colour, alpha=strength, depthshade=False,
                     zorder=1.5 if name not in LAYERS else 1.0, label=f"{name}: {len(T)}{twice}")  # fmt: skip
    wire = _corners(room)
    for n, (i, j) in enumerate(EDGES):
        label = "room" if n == 0 else None
        axes.plot(*wire[[i, j]].T, color="black", linewidth=0.6, linestyle=":", label=label)
    for k, box in enumerate(boxes):
        faces = [_corners(box)[f] for f in FACES]
        axes.add_collection3d(
            Poly3DCollection(faces, facecolor=AMBER, edgecolor="0.3", alpha=0.25, linewidth=0.5,
                             label="obstacles" if k == 0 else "_")
        )  # fmt: skip
    if device is not None:
        axes.scatter(*device, marker="^", s=70, color=GREEN, depthshade=False, label="device")
    finish(axes)
    key_below(figure, axes)
    fill(figure, axes)
    return figure


@styled
def curve_figure(selected: Sequence[Any], grids: Sequence[Any], accuracy: float, *, title: str = "") -> Figure:
    """Predicted errors [m] against the number of poses; points are (poses, rms, greatest)."""
    figure, (axes,) = with_panels(7.5, 5.2, grid=False)
    for points, name, colour in ((selected, "selected", ORANGE), (grids, "regular grid", BLUE)):
        if points:
            n, rms, worst = np.array(points, float).T
            axes.plot(n, 1e6 * rms, "o-", color=colour, label=f"{name}: rms over the workspace")
            axes.plot(n, 1e6 * worst, "s--", color=colour, alpha=0.6, markersize=4, label=f"{name}: worst place")
    axes.axhline(1e6 * accuracy, color="black", linewidth=1, label=f"wanted accuracy: {1e6 * accuracy:g} µm")
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        plain_logarithm(axis)
    axes.set(xlabel="number of poses", ylabel="predicted positioning error [µm]", title=title)
    axes.grid(which="both", alpha=0.3)
    key_below(figure, axes, columns=2)
    return figure


@styled
def parameters_figure(
    names: Sequence[str], predicted: np.ndarray, simulated: np.ndarray | None, *, units: Sequence[str] | None = None,
    runs: int = 0, title: str = "",
) -> Figure:  # fmt: skip
    """Standard deviation of each parameter, predicted and of simulated (synthetic) calibrations, a panel for each unit.

    Those that are undetermined, infinite or NaN, have grey names and nothing else. units: of each parameter, "m" or
    none; all are lengths if left out.
    """
    of = ["m"] * len(names) if units is None else list(units)
    groups = {u: [k for k, other in enumerate(of) if other == u] for u in dict.fromkeys(of)}
    most = max(len(rows) for rows in groups.values())
    figure, panels = with_panels(min(max(7.0, 0.3 * most + 2), 14.0), 0.8 + 3.0 * len(groups), len(groups),
                                 title=title, grid=False)  # fmt: skip
    for axes, (unit, rows) in zip(panels, groups.items(), strict=True):
        known = np.flatnonzero(np.isfinite(predicted[rows]))
        at = np.asarray(rows)[known]
        axes.bar(known, 1e6 * predicted[at], color=SHADES[2], label="predicted")
        if simulated is not None:
            axes.plot(known, 1e6 * simulated[at], "D", color=ORANGE, markersize=5, linestyle="none",
                      label=f"of {runs} simulated calibrations, synthetic")  # fmt: skip
        axes.set_xticks(np.arange(len(rows)), [names[k] for k in rows], rotation=90, fontsize="small")
        for k, label in enumerate(axes.get_xticklabels()):
            label.set_color("black" if k in known else "0.65")
        if len(known) < len(rows):
            axes.plot([], [], " ", label="grey name: not determined by itself")
        axes.set_xlim(-0.8, len(rows) - 0.2)
        axes.set(ylabel=f"standard deviation [{millionths(unit)}]")
        axes.grid(axis="y", alpha=0.3)
    panels[-1].set_xlabel("parameter")
    key_below(figure)
    return figure


@styled
def predicted_figure(
    T: np.ndarray, predicted: np.ndarray, simulated: np.ndarray | None, *, runs: int = 0, title: str = ""
) -> Figure:
    """Predicted rms error [m] at each place (n, 3) [m], the worst marked, and beside it that of simulations.

    Places without a prediction, NaN, are left out.
    """
    known = np.isfinite(predicted)
    T, predicted = T[known], predicted[known]
    simulated = None if simulated is None else simulated[known]
    both = simulated is not None
    figure = Figure(figsize=(12.5 if both else 7.0, 5.2), layout="constrained")
    cast(ConstrainedLayoutEngine, figure.get_layout_engine()).set(wspace=0.12)
    space: Any = figure.add_subplot(1, 2 if both else 1, 1, projection="3d")
    shown = space.scatter(*T.T, c=1e6 * predicted, s=14, depthshade=False)
    worst = int(np.argmax(predicted))
    space.scatter(*T[worst], marker="o", s=120, facecolor="none", edgecolor=ORANGE, linewidth=2, depthshade=False,
                  zorder=10)  # fmt: skip
    where = ", ".join(f"{x:.2g}" for x in T[worst])
    space.set_title(f"worst: {1e6 * predicted[worst]:.0f} µm at ({where}) m (circle)")
    figure.colorbar(shown, ax=space, label="predicted rms error [µm]", shrink=0.7, pad=0.16)
    finish(space)
    if simulated is not None:
        axes = figure.add_subplot(1, 2, 2)
        top = 1e6 * max(float(predicted.max()), float(np.nanmax(simulated)))
        axes.plot([0, top], [0, top], color="black", linewidth=1)
        axes.plot(1e6 * predicted, 1e6 * simulated, ".", color=ORANGE, markersize=4)
        axes.set(xlabel="predicted rms error [µm]", ylabel="simulated rms error [µm]")
        axes.set_title(f"against {runs} simulated calibrations, synthetic")
        axes.set_aspect("equal")
        axes.grid(alpha=0.3)
    figure.suptitle(title)
    return figure


def _corners(box: Box) -> np.ndarray:
    low, high = (np.asarray(x, float) for x in box)
    return low + CORNERS * (high - low)
