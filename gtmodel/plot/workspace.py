"""Pictures over a workspace: cross-sections, contour plots of positioning errors and plate orientation, quantities over
the rows of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path
from matplotlib.text import Text

from .signals import PANEL_HEIGHT
from .style import AWAY_FROM_ZERO, COLOURS, HEIGHT, SHADES, key_below, key_beside, styled, with_panels


class Outlined(Protocol):
    """A region of a plane, such as `gt.kinematics.region` returns."""

    @property
    def area(self) -> float:
        """[m2]"""
        ...

    @property
    def loops(self) -> Sequence[np.ndarray]:
        """Closed boundaries (k, 2) [m]; holes have the opposite orientation."""
        ...


@styled
def section_figure(
    layers: Mapping[str, Outlined], guideways: np.ndarray, *, title: str = "", names: tuple[str, str] = ("u", "v")
) -> Figure:
    """Draw regions of a section one over the other with their boundaries, and the guideways as numbered squares.

    Args:
        layers: label -> region, the largest first; the area is added to the label.
        guideways: (m, 2), intersections of the guideways with the section [m].
        names: of the two coordinates.
    """
    figure, (axes,) = with_panels(7.5, 6.5)
    for k, (label, region) in enumerate(layers.items()):
        shade = SHADES[min(k, len(SHADES) - 1)]
        if not region.loops:
            axes.plot([], [], color=shade, label=f"{label}: none")
            continue
        patch = PathPatch(_path(region.loops), facecolor=shade, edgecolor="black", linewidth=0.8)
        patch.set_label(f"{label}: {region.area:.2f} m²")
        axes.add_patch(patch)
    mark_guideways(axes, guideways)
    axes.autoscale_view()
    axes.set(xlabel=f"{names[0]} [m]", ylabel=f"{names[1]} [m]", title=f"{title or 'workspace'}: cross-section")
    axes.set_aspect("equal", adjustable="box")
    key_below(figure, axes, columns=2)
    return figure


def mark_guideways(axes: Any, guideways: np.ndarray) -> None:
    """Draw the guideways as numbered squares at (m, 2) [m]."""
    for k, (u, v) in enumerate(np.asarray(guideways)):
        axes.plot(u, v, "s", color="black", markersize=8, linestyle="none",
                  label="guideway with number" if k == 0 else None)  # fmt: skip
        axes.annotate(str(k + 1), (u, v), xytext=(7, 7), textcoords="offset points", fontweight="bold",
                      bbox=dict(boxstyle="round,pad=0.1", facecolor="white", edgecolor="none", alpha=0.7))  # fmt: skip


def _path(loops: Sequence[np.ndarray]) -> Path:
    """Return all loops as one path; holes have the opposite orientation and are not filled."""
    vertices, codes = [], []
    for loop in loops:
        vertices += [loop, loop[:1]]
        codes += [Path.MOVETO, *[Path.LINETO] * (len(loop) - 1), Path.CLOSEPOLY]
    return Path(np.vstack(vertices), codes)


STYLES = ("-", "-.", "--")
LEVELS = 12
NEAR = 0.07  # of the picture's width: level labels closer to a guideway would cover its number


@styled
def error_figure(
    u: np.ndarray,
    v: np.ndarray,
    error: np.ndarray,
    guideways: np.ndarray,
    *,
    window: tuple[np.ndarray, np.ndarray] | None = None,
    title: str = "",
    names: tuple[str, str] = ("u", "v"),
) -> Figure:
    """Draw a contour plot of the largest positioning error over a section.

    Args:
        u, v: coordinates of the grid [m]. error: (len(u), len(v)) [m], NaN if undefined.
        guideways: (m, 2), intersections of the guideways with the section [m].
        window: lower left and upper right corner of the window that the reported numbers refer to [m].
        names: of the two coordinates.
    """
    figure, (axes,) = with_panels(7.5, 6.5, grid=False)
    micrometres = np.ma.masked_invalid(1e6 * error).T
    if micrometres.count():
        filled = axes.contourf(u, v, micrometres, LEVELS, cmap=HEIGHT)
        lines = axes.contour(u, v, micrometres, filled.levels, colors="white", linewidths=0.6)
        axes.clabel(lines, fontsize="small", fmt="%g")
        _make_room(lines.labelTexts, guideways, NEAR * max(np.ptp(u), np.ptp(v)))
        figure.colorbar(filled, ax=axes, label="largest positioning error [µm]")
    if window is not None:
        low, high = window
        axes.add_patch(Rectangle(tuple(low), *(high - low), fill=False, edgecolor="black", linestyle="--",
                                 label="window of the reported numbers"))  # fmt: skip
    mark_guideways(axes, guideways)
    axes.set(xlabel=f"{names[0]} [m]", ylabel=f"{names[1]} [m]", title=title)
    axes.set_aspect("equal")
    key_below(figure, axes)
    return figure


def _make_room(labels: Sequence[Text], guideways: np.ndarray, near: float) -> None:
    """Hide level labels that would cover the number of a guideway."""
    for label in labels:
        distance = np.linalg.norm(np.asarray(guideways) - label.get_position(), axis=1)
        if distance.size and distance.min() < near:
            label.set_visible(False)


@styled
def faces_figure(distance: np.ndarray, faces: Mapping[str, np.ndarray], *, title: str = "") -> Figure:
    """Draw the areas of the faces of the error parallelepiped along a line.

    Args:
        distance: (n,), along the line [m]. faces: case -> (n, 3), areas orthogonal to links 1 to 3 [m2].
    """
    figure, panels = with_panels(8.0, 1.0 + 2.6 * len(faces), len(faces), title=title, sharex=True)
    for axes, (name, areas) in zip(panels, faces.items(), strict=True):
        for i in range(areas.shape[1]):
            axes.plot(
                distance, 1e12 * areas[:, i], STYLES[i], color=COLOURS[i], label=f"face orthogonal to link {i + 1}"
            )
        axes.set(ylabel="area [µm²]", title=name)
    panels[-1].set_xlabel("distance along the line [m]")
    key_below(figure)
    return figure


ANGLES = ("alpha", "beta", "gamma")
MOST_LAYERS = 4  # more do not fit side by side
ANGLE_LEVELS = 15
NO_SOLUTION = "0.85"


@styled
def layers_figure(
    zyz: np.ndarray, half_width: Sequence[float], directions: Sequence[Sequence[float]], title: str = ""
) -> Figure:
    """Draw contour plots of the ZYZ angles, a row per angle with one colour scale and a column per layer.

    Each angle is drawn minus its mean over all points, in degrees; points without a solution are grey. Of more than
    four layers, four are drawn.

    Args:
        zyz: angles (layers, n, m, 3) [rad] on a grid, NaN without a solution.
        half_width, directions: of the grid; its first direction is across the layers.
    """
    degrees = np.degrees(zyz)
    layers = np.unique(np.linspace(0, len(degrees) - 1, min(len(degrees), MOST_LAYERS)).round().astype(int))
    offsets = [
        np.linspace(-h, h, n) if n > 1 else np.zeros(1) for h, n in zip(half_width, degrees.shape[:3], strict=True)
    ]
    figure, panels = with_panels(1.8 + 1.9 * len(layers), 6.6, 3, len(layers), grid=False, sharex=True, sharey=True)
    panels = panels.reshape(3, -1)
    names = [_direction(d) for d in directions]
    for angle in range(3):
        deviation = degrees[..., angle] - np.nanmean(degrees[..., angle])
        top = max(float(np.nanmax(np.abs(deviation))), 1e-12)
        levels = np.linspace(-top, top, ANGLE_LEVELS)
        drawn = None
        for column, layer in enumerate(layers):
            axes = panels[angle, column]
            values = np.ma.masked_invalid(deviation[layer].T)
            drawn = axes.contourf(offsets[1], offsets[2], values, levels, cmap=AWAY_FROM_ZERO)
            axes.contour(offsets[1], offsets[2], values, levels, colors="black", linewidths=0.3)
            axes.set_aspect("equal")
            axes.set_facecolor(NO_SOLUTION)
            if angle == 0:
                axes.set_title(f"{offsets[0][layer]:+.3g} m along {names[0]}", fontsize="small")
        if drawn is not None:
            mean = float(np.nanmean(degrees[..., angle]))
            bar = figure.colorbar(drawn, ax=list(panels[angle]), ticks=[-top, 0.0, top], format="%+.2f")
            bar.set_label(_from_mean(angle, mean))
        panels[angle, 0].set_ylabel(f"{names[2]} [m]")
    for axes in panels[-1]:
        axes.set_xlabel(f"{names[1]} [m]")
    subject = f"ZYZ angles by layer; {names[1]} and {names[2]} from the centre of the grid"
    subject += "" if np.all(np.isfinite(zyz)) else "; grey: no solution"
    figure.suptitle(f"{title}: {subject}" if title else subject, fontsize="medium")
    return figure


@styled
def sequence_figure(zyz: np.ndarray, title: str = "") -> Figure:
    """Draw the three ZYZ angles (..., 3) [rad] minus their means [deg] over the points (Dressler 2012, Fig. 4.7).

    A grid is traversed as it is measured: back and forth row by row within a layer, and every second layer backwards
    along the same path. A pattern that repeats by layer therefore appears as mirrored copies. Dashed lines separate the
    layers.
    """
    degrees = np.degrees(zyz)
    order = _serpentine(degrees.shape[:-1])
    degrees = degrees.reshape(-1, 3)[order]
    heading = f"{title}: ZYZ angles along the points" if title else "ZYZ angles along the points"
    figure, stack = with_panels(9.0, 6.0, 3, title=heading, sharex=True)
    size = len(order) // zyz.shape[0]
    for angle, axes in enumerate(stack):
        mean = float(np.nanmean(degrees[:, angle]))
        axes.plot(degrees[:, angle] - mean, color=COLOURS[angle], linewidth=0.8, marker=".", markersize=2)
        axes.set_ylabel(_from_mean(angle, mean))
        _separate(axes, size, len(order))
    stack[-1].set_xlabel("point, in the order of measurement")
    key_below(figure, stack[0])
    return figure


def _from_mean(angle: int, mean: float) -> str:
    """Return an axis label: an angle minus its mean [deg]."""
    return f"{ANGLES[angle]} {'-' if mean >= 0 else '+'} {abs(mean):.2f}° [deg]"


def _separate(axes: Axes, size: int, count: int) -> None:
    for k in range(size, count, size):
        label = "start of a layer" if k == size else None
        axes.axvline(k - 0.5, color="0.5", linewidth=0.8, linestyle="--", label=label)
    axes.margins(x=0.01)


def _serpentine(shape: tuple[int, ...]) -> np.ndarray:
    """Return the indices of the points along the path: rows back and forth, every second layer backwards."""
    index = np.arange(int(np.prod(shape))).reshape(shape)
    if len(shape) == 3:
        index[:, 1::2] = index[:, 1::2, ::-1]
    index = index.reshape(shape[0], -1)
    index[1::2] = index[1::2, ::-1]
    return index.ravel()


def _direction(direction: Sequence[float]) -> str:
    """Return x, y or z for the direction of an axis, v for any other."""
    unit = np.asarray(direction, dtype=float)
    unit = unit / np.linalg.norm(unit)
    return next((name for name, axis in zip("xyz", np.eye(3), strict=True) if np.allclose(unit, axis)), "v")


@styled
def points_figure(signals: Sequence[tuple[str, str, np.ndarray]], ok: np.ndarray, title: str = "") -> Figure:
    """Draw signals (name, unit, values (rows, ...)) over the row number; grey ticks mark rows without a solution."""
    figure, stack = with_panels(8.5, 1.2 + PANEL_HEIGHT * len(signals), len(signals), title=title, sharex=True)
    missing = np.flatnonzero(~ok)
    for axes, (name, unit, values) in zip(stack, signals, strict=True):
        flat = values.reshape(len(ok), -1)
        for k in range(flat.shape[1]):
            label = name if flat.shape[1] == 1 else f"{name}[{k}]"
            axes.plot(flat[:, k], ".", markersize=3, color=COLOURS[k % len(COLOURS)], label=label)
        if missing.size:
            rug = axes.get_xaxis_transform()
            axes.vlines(missing, 0.0, 0.05, color="0.5", transform=rug, linewidth=0.6, label="no solution")
        axes.set_ylabel(f"{name} [{unit or '1'}]")
        key_beside(axes)
    stack[-1].set_xlabel("row of the table")
    return figure
