"""Pictures of a calibration (errors per pose, per link and over the workspace) and of a calibration plan (points in the
room, accuracy over the number of poses)."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, cast

import numpy as np
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from .robot3d import draw_links, fill, finish
from .style import (
    AMBER,  # fmt: skip
    AWAY_FROM_ZERO,
    BLUE,
    COLOURS,
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
)

TICKS = 4  # along the longer side of a view
FEW_DECADES = 3  # up to which an axis has room for ticks at 2 and 5
MANY = 40  # labels that can be read on an axis at normal size


@styled
def pose_errors_figure(
    errors: dict[str, np.ndarray], title: str = "", worst: int | None = None, quantity: str = "positioning error [mm]",
    *, lines: np.ndarray | None = None, held_out: np.ndarray | None = None,
) -> Figure:  # fmt: skip
    """Absolute positioning error per pose (Dressler 2012, Fig. 5.1).

    Args:
        errors: name -> (N,) [m], one panel each on one scale, which is logarithmic if means differ by more than ten.
        worst: pose of the first ones to be marked.
        quantity: what they are errors of, along the axis.
        lines: (N,) of the file, along the axis; pose numbers if left out.
        held_out: (N,) poses that the fit did not use, drawn with a marker of their own.
    """
    figure, panels = with_panels(8.0, 0.8 + 2.3 * len(errors), len(errors), title=title, sharex=True, sharey=True)
    means = [float(np.nanmean(e)) for e in errors.values()]
    logarithmic = max(means) > 10 * min(means) > 0
    for n, (axes, (name, e)) in enumerate(zip(panels, errors.items(), strict=True)):
        at = np.arange(1, len(e) + 1) if lines is None else lines
        averages = []
        for word, chosen, colour, marker in _groups(held_out, len(e), COLOURS[n % len(COLOURS)]):
            if not np.any(np.isfinite(e[chosen])):
                continue
            mean = 1e3 * float(np.nanmean(e[chosen]))
            order = np.flatnonzero(chosen)[np.argsort(at[chosen], kind="stable")]
            axes.plot(at[order], 1e3 * e[order], marker, linestyle="-", color=colour, linewidth=0.6, markersize=4,
                      label=word or "_")  # fmt: skip
            axes.axhline(mean, color=colour if word else "0.4", linestyle="--", linewidth=0.8)
            averages.append(f"{mean:.3g} mm {word}".strip())
        said = f"{name}: mean {', '.join(averages)} (dashed)"
        axes.set(ylabel=quantity, yscale="log" if logarithmic else "linear")
        if n == 0 and worst is not None:
            axes.plot(at[worst], 1e3 * e[worst], "o", markersize=10, markerfacecolor="none", markeredgecolor="black")
            place = "pose" if lines is None else "line"
            said += f"; largest {1e3 * float(e[worst]):.3g} mm, {place} {at[worst]} (ring)"
        axes.set_title(said, loc="left", fontsize="medium")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if not logarithmic:
        panels[0].set_ylim(bottom=0.0)
    panels[-1].set_xlabel("pose, in the order of the data" if lines is None else "line of the file")
    if held_out is not None:
        key_below(figure, panels[0])
    return figure


def _groups(held_out: np.ndarray | None, N: int, colour: str) -> list[tuple[str, np.ndarray, str, str]]:
    """Word, poses, colour and marker of fitted and held-out poses; one group without a word if not told apart."""
    if held_out is None:
        return [("", np.ones(N, bool), colour, ".")]
    return [("fitted", ~held_out, BLUE, "o"), ("held out", held_out, ORANGE, "s")]


@styled
def workspace_errors_figure(
    positions: np.ndarray, sizes: np.ndarray, title: str = "", *, held_out: np.ndarray | None = None
) -> Figure:
    """Draw errors (N,) [m] at positions (N, 3) [m], projected along each axis, or (N, 2); the largest are on top.

    held_out: (N,) poses that the fit did not use, drawn as squares."""
    order = np.argsort(np.nan_to_num(sizes, nan=-1.0), kind="stable")
    pairs = list(combinations(range(positions.shape[1]), 2))
    figure, panels = with_panels(11.0 if len(pairs) > 1 else 5.5, 4.2, columns=len(pairs), title=title)
    top = 1e3 * float(np.nanmax(sizes))
    drawn: PathCollection | None = None
    for axes, (a, b) in zip(panels, pairs, strict=True):
        for word, chosen, _, marker in _groups(held_out, len(sizes), BLUE):
            rows = order[chosen[order]]
            drawn = axes.scatter(positions[rows, a], positions[rows, b], c=1e3 * sizes[rows], s=22, zorder=2,
                                 vmin=1e3 * float(np.nanmin(sizes)), vmax=top, marker=marker if word else "o",
                                 label=word or "_")  # fmt: skip
        worst = order[-1]
        axes.plot(positions[worst, a], positions[worst, b], "o", markerfacecolor="none", markeredgecolor=ORANGE, ms=12,
                  markeredgewidth=1.5, clip_on=False, label=f"largest: {top:.3g} mm")  # fmt: skip
        sides = np.ptp(positions[:, [a, b]], axis=0)
        for axis, part in zip((axes.xaxis, axes.yaxis), sides / max(float(sides.max()), 1e-12), strict=True):
            axis.set_major_locator(MaxNLocator(max(1, round(TICKS * float(part)))))  # few ticks on a short side
        axes.set(xlabel=f"{'xyz'[a]} [m]", ylabel=f"{'xyz'[b]} [m]")
        axes.set_aspect("equal")
    assert drawn is not None
    figure.colorbar(drawn, ax=list(panels), label="positioning error [mm]")
    key_below(figure, panels[0])
    return figure


@styled
def deviations_figure(names: Sequence[str], std: np.ndarray, units: Sequence[str], title: str = "") -> Figure:
    """Draw standard deviations (n,) of unknowns in SI units as bars, a panel per unit.

    Unknowns that the poses do not determine have hatched bars.
    """
    groups = {u: [k for k, other in enumerate(units) if other == u] for u in dict.fromkeys(units)}
    sizes = [len(rows) for rows in groups.values()]
    figure, panels = with_panels(7.5, 0.6 + 0.8 * len(groups) + 0.18 * len(names), len(groups), grid=False,
                                 title=textwrap.fill(title, 60), height_ratios=sizes)  # fmt: skip
    for axes, (unit, rows) in zip(panels, groups.items(), strict=True):
        _deviations(axes, [names[k] for k in rows], 1e6 * np.asarray(std, float)[rows], millionths(unit))
    return figure


def _deviations(axes: Any, names: Sequence[str], std: np.ndarray, unit: str) -> None:
    """Draw the bars of one unit."""
    known = np.isfinite(std)
    top = (float(np.max(std[known])) if known.any() else 0.0) or 1.0
    places = np.arange(len(names))
    axes.barh(places[known], std[known], color=COLOURS[0])
    axes.barh(places[~known], np.full(int((~known).sum()), 30 * top), color="0.9", hatch="//", edgecolor="0.6")
    positive = std[known & (std > 0)]
    least = float(np.min(positive)) if positive.size else 0.1 * top
    # so that the smallest one has a bar too
    low, high = np.ceil(np.log10(least)) - 1, np.ceil(np.log10(max(top, least)))
    axes.set_xlim(10**low, 10**high)
    axes.set_xscale("log")
    plain_logarithm(axes.xaxis, subs=(1.0, 2.0, 5.0) if high - low <= FEW_DECADES else (1.0,))
    axes.set_yticks(places, names, fontsize=7)
    axes.set_ylim(len(names) - 0.4, -0.6)
    hatched = "" if known.all() else "; hatched: not determined by these poses"
    axes.set(xlabel=f"standard deviation [{unit}]{hatched}", ylabel="parameter")
    axes.grid(alpha=0.3, axis="x", which="both")


@styled
def correlation_figure(names: Sequence[str], correlation: np.ndarray, title: str = "") -> Figure:
    """Draw the correlation coefficients (n, n) of unknowns."""
    n = len(names)
    margin = 0.06 * max(map(len, names), default=0)  # inches for the names
    figure = Figure(figsize=(3.2 + margin + 0.14 * n, 2.8 + margin + 0.14 * n), layout="constrained")
    axes = figure.add_subplot()
    drawn = axes.imshow(correlation, cmap=AWAY_FROM_ZERO, vmin=-1, vmax=1)
    size = 7 if n <= MANY else 5
    axes.set_xticks(range(n), names, rotation=90, fontsize=size)
    axes.set_yticks(range(n), names, fontsize=size)
    axes.set(xlabel="parameter", ylabel="parameter")
    figure.colorbar(drawn, ax=axes, label="correlation coefficient [1]", shrink=0.8)
    axes.set_title(textwrap.fill(title, 60))
    return figure


# colour, size, opacity; all other layers are drawn as MAIN
LAYERS: Mapping[str, tuple[str, float, float]] = {
    "candidates": ("0.8", 2.0, 0.3), "calibrate": (ORANGE, 34.0, 1.0), "held out": (BLUE, 22.0, 1.0),
    "reachable, but not safe": ("0.7", 4.0, 0.4), "not seen": (PINK, 6.0, 0.6),
    "seen, but too near the edge": ("0.6", 5.0, 0.5),
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
    again: str = "chosen more than once",
    title: str = "",
) -> Figure:
    """Draw layers of points (n, 3) [m], counted in the legend, the robot at its home pose, and the room as a wire box.

    Args:
        robot: ends of its links at carts and plate (l, 3), tool centre point (3,), guideway directions (l, 3).
        boxes: obstacles, low and high corners (3,) [m]. device: position of the measuring device (3,) [m]. again: words
            for the points that a layer contains several times.
    """
    figure, axes = in_space(8.5, 6.4, title=title)
    axes.computed_zorder = False  # main layer over the other points, robot over both
    draw_links(axes, *robot)
    for name, T in layers.items():
        colour, size, strength = LAYERS.get(name, MAIN)
        points, times = np.unique(np.asarray(T).reshape(-1, 3), axis=0, return_counts=True)
        repeated = f", {np.count_nonzero(times > 1)} {again}" if np.any(times > 1) else ""
        axes.scatter(*points.T, s=size * times, color=colour, alpha=strength, depthshade=False,
                     zorder=1.5 if name not in LAYERS else 1.0, label=f"{name}: {len(T)}{repeated}")  # fmt: skip
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
    """Draw predicted errors [m] over the number of poses; points are (poses, rms error, largest error)."""
    figure, (axes,) = with_panels(7.5, 5.2, grid=False)
    for points, name, colour in ((selected, "selected", ORANGE), (grids, "regular grid", BLUE)):
        if points:
            n, rms, worst = np.array(points, float).T
            axes.plot(n, 1e6 * rms, "o-", color=colour, label=f"{name}: rms over the workspace")
            axes.plot(n, 1e6 * worst, "s--", color=colour, alpha=0.6, markersize=4, label=f"{name}: largest error")
    axes.axhline(1e6 * accuracy, color="black", linewidth=1, label=f"required accuracy: {1e6 * accuracy:g} µm")
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
    """Draw the standard deviation of each parameter, predicted and from simulated (synthetic) calibrations, by unit.

    Undetermined parameters (infinite or NaN) have a grey name and no bar. units: of each parameter, "m" or ""; all are
    lengths if left out.
    """
    unit_of = ["m"] * len(names) if units is None else list(units)
    groups = {u: [k for k, other in enumerate(unit_of) if other == u] for u in dict.fromkeys(unit_of)}
    most = max(len(rows) for rows in groups.values())
    figure, panels = with_panels(min(max(7.0, 0.3 * most + 2), 14.0), 0.8 + 3.0 * len(groups), len(groups),
                                 title=title, grid=False)  # fmt: skip
    for axes, (unit, rows) in zip(panels, groups.items(), strict=True):
        known = np.flatnonzero(np.isfinite(predicted[rows]))
        chosen = np.asarray(rows)[known]
        axes.bar(known, 1e6 * predicted[chosen], color=SHADES[2], label="predicted")
        if simulated is not None:
            axes.plot(known, 1e6 * simulated[chosen], "D", color=ORANGE, markersize=5, linestyle="none",
                      label=f"from {runs} simulated calibrations (synthetic)")  # fmt: skip
        axes.set_xticks(np.arange(len(rows)), [names[k] for k in rows], rotation=90, fontsize="small")
        for k, label in enumerate(axes.get_xticklabels()):
            label.set_color("black" if k in known else "0.65")
        if len(known) < len(rows):
            axes.plot([], [], " ", label="grey name: not identifiable on its own")
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
    """Draw the predicted rms error [m] at each position (n, 3) [m], with the largest marked, and that of simulations.

    Positions without a prediction (NaN) are left out.
    """
    known = np.isfinite(predicted)
    T, predicted = T[known], predicted[known]
    simulated = None if simulated is None else simulated[known]
    both = simulated is not None
    figure = Figure(figsize=(12.5 if both else 7.0, 5.2), layout="constrained")
    cast(ConstrainedLayoutEngine, figure.get_layout_engine()).set(wspace=0.12)
    space: Any = figure.add_subplot(1, 2 if both else 1, 1, projection="3d")
    points = space.scatter(*T.T, c=1e6 * predicted, s=14, depthshade=False)
    worst = int(np.argmax(predicted))
    space.scatter(*T[worst], marker="o", s=120, facecolor="none", edgecolor=ORANGE, linewidth=2, depthshade=False,
                  zorder=10)  # fmt: skip
    position = ", ".join(f"{x:.2g}" for x in T[worst])
    space.set_title(f"worst: {1e6 * predicted[worst]:.0f} µm at ({position}) m (circle)")
    figure.colorbar(points, ax=space, label="predicted rms error [µm]", shrink=0.7, pad=0.16)
    finish(space)
    if simulated is not None:
        axes = figure.add_subplot(1, 2, 2)
        top = 1e6 * max(float(predicted.max()), float(np.nanmax(simulated)))
        axes.plot([0, top], [0, top], color="black", linewidth=1)
        axes.plot(1e6 * predicted, 1e6 * simulated, ".", color=ORANGE, markersize=4)
        axes.set(xlabel="predicted rms error [µm]", ylabel="simulated rms error [µm]")
        axes.set_title(f"{runs} simulated calibrations (synthetic)")
        axes.set_aspect("equal")
        axes.grid(alpha=0.3)
    figure.suptitle(title)
    return figure


def _corners(box: Box) -> np.ndarray:
    low, high = (np.asarray(x, float) for x in box)
    return low + CORNERS * (high - low)
