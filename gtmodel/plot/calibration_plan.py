"""Pictures of a calibration plan: points in the room, numbers of poses, parameters, predicted errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from .panels import with_panels
from .robot3d import draw_links, finish

# colour, size, opacity; other layers are what the picture is about
LAYERS: Mapping[str, tuple[str, float, float]] = {
    "candidates": ("0.8", 2.0, 0.3), "calibrate": ("#d55e00", 34.0, 1.0), "held out": ("#0072b2", 22.0, 1.0),
    "reached, but not safe": ("0.7", 4.0, 0.4), "not seen": ("#cc79a7", 6.0, 0.6),
    "seen, too near the edge": ("0.6", 5.0, 0.5),
}  # fmt: skip
MAIN = ("#0072b2", 9.0, 0.35)
CORNERS = np.array(list(np.ndindex(2, 2, 2)))
EDGES = [(i, j) for i in range(8) for j in range(i) if np.sum(CORNERS[i] != CORNERS[j]) == 1]
FACES = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
Box = tuple[np.ndarray, np.ndarray]


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
    figure = Figure(figsize=(8.5, 6.8), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d")
    draw_links(axes, *robot)
    for name, T in layers.items():
        colour, size, strength = LAYERS.get(name, MAIN)
        at, times = np.unique(np.asarray(T).reshape(-1, 3), axis=0, return_counts=True)
        twice = f", {np.count_nonzero(times > 1)} {again}" if np.any(times > 1) else ""
        axes.scatter(*at.T, s=size * times, color=colour, alpha=strength, depthshade=False,
                     label=f"{name}: {len(T)}{twice}")  # fmt: skip
    wire = _corners(room)
    for i, j in EDGES:
        axes.plot(*wire[[i, j]].T, color="black", linewidth=0.6, linestyle=":")
    for k, box in enumerate(boxes):
        faces = [_corners(box)[f] for f in FACES]
        axes.add_collection3d(
            Poly3DCollection(faces, facecolor="#e69f00", edgecolor="#8a5f00", alpha=0.25, linewidth=0.5,
                             label="obstacles" if k == 0 else "_")
        )  # fmt: skip
    if device is not None:
        axes.scatter(*device, marker="^", s=70, color="#009e73", depthshade=False, label="device")
    finish(axes)
    axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(-0.12, 1.0))
    figure.suptitle(title, fontsize="medium")
    return figure


def curve_figure(selected: Sequence[Any], grids: Sequence[Any], accuracy: float, *, title: str = "") -> Figure:
    """Predicted errors [m] against the number of poses; points are (poses, rms, greatest)."""
    figure, (axes,) = with_panels(7.5, 5.2, grid=False)
    for points, name, colour in ((selected, "selected", "#d55e00"), (grids, "regular grid", "#0072b2")):
        if points:
            n, rms, worst = np.array(points, float).T
            axes.plot(n, 1e6 * rms, "o-", color=colour, label=f"{name}: rms over the workspace")
            axes.plot(n, 1e6 * worst, "s--", color=colour, alpha=0.6, markersize=4, label=f"{name}: worst place")
    axes.axhline(1e6 * accuracy, color="black", linewidth=1, label="wanted accuracy")
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(ScalarFormatter())
        axis.set_minor_formatter(ScalarFormatter())
    axes.tick_params(which="both", labelsize="small")
    axes.set(xlabel="poses", ylabel="predicted positioning error [µm]", title=title)
    axes.grid(which="both", alpha=0.3)
    axes.legend(fontsize="small")
    return figure


def parameters_figure(
    names: Sequence[str], predicted: np.ndarray, simulated: np.ndarray | None, *, runs: int = 0, title: str = ""
) -> Figure:
    """Standard deviation of each parameter, predicted and of simulated (synthetic) calibrations [1e-6]; those that are
    undetermined, infinite or NaN, have grey names and nothing else."""
    figure, (axes,) = with_panels(min(max(6.0, 0.36 * len(names) + 2), 16.0), 4.8, grid=False)
    known = np.flatnonzero(np.isfinite(predicted))
    axes.bar(known, 1e6 * predicted[known], color="#8db3d9", label="predicted")
    if simulated is not None:
        axes.plot(
            known, 1e6 * simulated[known], "D", color="#d55e00", markersize=5, label=f"{runs} simulated, synthetic"
        )
    axes.set_xticks(np.arange(len(names)), names, rotation=90, fontsize="small" if len(names) < 45 else "x-small")
    for k, label in enumerate(axes.get_xticklabels()):
        label.set_color("black" if k in known else "0.65")
    if len(known) < len(names):
        axes.plot([], [], " ", label="grey: not determined by itself")
    axes.set_xlim(-0.8, len(names) - 0.2)
    axes.set(ylabel="standard deviation [µm, or 1e-6]", title=title)
    axes.grid(axis="y", alpha=0.3)
    axes.legend(fontsize="small")
    return figure


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
    figure = Figure(figsize=(11.5 if both else 7.0, 5.2), layout="constrained")
    space: Any = figure.add_subplot(1, 2 if both else 1, 1, projection="3d")
    shown = space.scatter(*T.T, c=1e6 * predicted, cmap="viridis", s=14, depthshade=False)
    worst = int(np.argmax(predicted))
    space.scatter(*T[worst], marker="o", s=120, facecolor="none", edgecolor="red", depthshade=False)
    where = ", ".join(f"{x:.2g}" for x in T[worst])
    space.set_title(f"worst: {1e6 * predicted[worst]:.0f} µm at ({where}) m, red", fontsize="medium")
    figure.colorbar(shown, ax=space, label="predicted rms error [µm]", shrink=0.7, pad=0.1)
    finish(space)
    if simulated is not None:
        axes = figure.add_subplot(1, 2, 2)
        top = 1e6 * max(float(predicted.max()), float(np.nanmax(simulated)))
        axes.plot([0, top], [0, top], color="black", linewidth=1)
        axes.plot(1e6 * predicted, 1e6 * simulated, ".", color="#d55e00", markersize=4)
        axes.set(xlabel="predicted rms error [µm]", ylabel=f"in {runs} simulated calibrations, synthetic [µm]")
        axes.set_aspect("equal")
        axes.grid(alpha=0.3)
    figure.suptitle(title, fontsize="medium")
    return figure


def _corners(box: Box) -> np.ndarray:
    low, high = (np.asarray(x, float) for x in box)
    return low + CORNERS * (high - low)
