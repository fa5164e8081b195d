"""Orientation of a plate over a grid: level plots of the ZYZ angles by layer, and along the grid as it is measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .style import AWAY_FROM_ZERO, COLOURS, key_below, styled, with_panels

ANGLES = ("alpha", "beta", "gamma")
MOST_LAYERS = 4  # more cannot be seen beside each other
LEVELS = 15
NO_SOLUTION = "0.85"


@styled
def layers_figure(
    zyz: np.ndarray, half_width: Sequence[float], directions: Sequence[Sequence[float]], title: str = ""
) -> Figure:
    """One row of level plots per angle, one column per layer; colours are the same along a row.

    Each angle is shown minus its mean over all points, in degrees; where there is no solution the
    panel is grey. Of more than four layers four are shown.

    Args:
        zyz: angles (layers, n, m, 3) [rad] on a grid, NaN where there is no solution.
        half_width, directions: of the grid; its first direction goes from layer to layer.
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
        shown = degrees[..., angle] - np.nanmean(degrees[..., angle])
        top = max(float(np.nanmax(np.abs(shown))), 1e-12)
        levels = np.linspace(-top, top, LEVELS)
        drawn = None
        for column, layer in enumerate(layers):
            axes = panels[angle, column]
            values = np.ma.masked_invalid(shown[layer].T)
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
    what = f"ZYZ angles by layer; {names[1]} and {names[2]} from the middle of the grid"
    what += "" if np.all(np.isfinite(zyz)) else "; grey: no solution"
    figure.suptitle(f"{title}: {what}" if title else what, fontsize="medium")
    return figure


@styled
def sequence_figure(zyz: np.ndarray, title: str = "") -> Figure:
    """The three ZYZ angles (..., 3) [rad] minus their means [deg] over the points (Dressler 2012, Fig. 4.7).

    A grid is traversed as it is measured: within a layer row by row, back and forth, and every second layer
    backwards along the same path, so that a pattern that repeats by layer shows as mirrored copies. Layers are parted
    by lines.
    """
    degrees = np.degrees(zyz)
    order = _serpentine(degrees.shape[:-1])
    degrees = degrees.reshape(-1, 3)[order]
    said = f"{title}: ZYZ angles along the points" if title else "ZYZ angles along the points"
    figure, stack = with_panels(9.0, 6.0, 3, title=said, sharex=True)
    size = len(order) // zyz.shape[0]
    for angle, axes in enumerate(stack):
        mean = float(np.nanmean(degrees[:, angle]))
        axes.plot(degrees[:, angle] - mean, color=COLOURS[angle], linewidth=0.8, marker=".", markersize=2)
        axes.set_ylabel(_from_mean(angle, mean))
        _part(axes, size, len(order))
    stack[-1].set_xlabel("point, in the order of measuring")
    key_below(figure, stack[0])
    return figure


def _from_mean(angle: int, mean: float) -> str:
    """Name of an axis: an angle less its mean [deg]."""
    return f"{ANGLES[angle]} {'-' if mean >= 0 else '+'} {abs(mean):.2f}° [deg]"


def _part(axes: Axes, size: int, count: int) -> None:
    for k in range(size, count, size):
        label = "a new layer begins" if k == size else None
        axes.axvline(k - 0.5, color="0.5", linewidth=0.8, linestyle="--", label=label)
    axes.margins(x=0.01)


def _serpentine(shape: tuple[int, ...]) -> np.ndarray:
    """Indices of the points in the order of the path: rows back and forth, every second layer backwards."""
    index = np.arange(int(np.prod(shape))).reshape(shape)
    if len(shape) == 3:
        index[:, 1::2] = index[:, 1::2, ::-1]
    index = index.reshape(shape[0], -1)
    index[1::2] = index[1::2, ::-1]
    return index.ravel()


def _direction(direction: Sequence[float]) -> str:
    """x, y or z for an axis, v for any other direction."""
    unit = np.asarray(direction, dtype=float)
    unit = unit / np.linalg.norm(unit)
    return next((name for name, axis in zip("xyz", np.eye(3), strict=True) if np.allclose(unit, axis)), "v")
