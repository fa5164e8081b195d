"""Positioning errors over a section, as level plots (compare Dressler 2012, Figs. 4.8 to 4.10)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from .style import COLOURS, HEIGHT, key_below, styled, with_panels
from .workspace import mark_guideways

STYLES = ("-", "-.", "--")
LEVELS = 12
NEAR = 0.07  # of the picture's width: a level's number so near to a guideway would cover that one's


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
    """Levels of the greatest error.

    Args:
        u, v: coordinates of the grid [m]. error: (len(u), len(v)) [m]; NaN where there is none.
        guideways: (m, 2) where they pierce the section [m].
        window: lower left and upper right corner of the rectangle that the numbers are about [m].
        names: of the two coordinates.
    """
    figure, (axes,) = with_panels(7.5, 6.5, grid=False)
    micrometres = np.ma.masked_invalid(1e6 * error).T
    if micrometres.count():
        filled = axes.contourf(u, v, micrometres, LEVELS, cmap=HEIGHT)
        lines = axes.contour(u, v, micrometres, filled.levels, colors="white", linewidths=0.6)
        axes.clabel(lines, fontsize="small", fmt="%g")
        _make_room(lines.labelTexts, guideways, NEAR * max(np.ptp(u), np.ptp(v)))
        figure.colorbar(filled, ax=axes, label="greatest positioning error [µm]")
    if window is not None:
        low, high = window
        axes.add_patch(Rectangle(tuple(low), *(high - low), fill=False, edgecolor="black", linestyle="--",
                                 label="window that the numbers are about"))  # fmt: skip
    mark_guideways(axes, guideways)
    axes.set(xlabel=f"{names[0]} [m]", ylabel=f"{names[1]} [m]", title=title)
    axes.set_aspect("equal")
    key_below(figure, axes)
    return figure


def _make_room(labels: Sequence[Text], guideways: np.ndarray, near: float) -> None:
    """Take away the numbers of levels that would cover the number of a guideway."""
    for label in labels:
        distance = np.linalg.norm(np.asarray(guideways) - label.get_position(), axis=1)
        if distance.size and distance.min() < near:
            label.set_visible(False)


@styled
def faces_figure(distance: np.ndarray, faces: Mapping[str, np.ndarray], *, title: str = "") -> Figure:
    """Areas of the parallelepiped's faces along a line.

    Args:
        distance: (n,) along the line [m]. faces: case -> (n, 3) areas orthogonal to links 1 to 3 [m2].
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
