"""How a robot deflects: maps over a section, and what takes the work of a load."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .style import COLOURS, HEIGHT, key_below, styled, with_panels
from .workspace import mark_guideways

LEVELS = 12
DASHES = 22  # directions drawn along the longer side
DASH = 0.6  # length of one, of their distance
# the tails of a map, near singular poses, would take all the colours
TAIL = 99.0  # percentile
BORDER = 0.15  # around what is drawn [m]
ROOM, MAP, WIDTHS = 2.3, 4.6, (6.0, 9.0)  # inches: beside a map, its height, of the figure


@styled
def map_figure(
    u: np.ndarray,
    v: np.ndarray,
    values: np.ndarray,
    *,
    label: str,
    marks: np.ndarray,
    directions: np.ndarray | None = None,
    point: np.ndarray | None = None,
    title: str = "",
    names: tuple[str, str] = ("u", "v"),
) -> Figure:
    """Levels of a quantity over a section.

    Args:
        u, v: coordinates of the grid [m]. values: (len(u), len(v)), NaN where there is none; label: with its unit.
        marks: (m, 2) where guideways pierce the section [m].
        directions: (len(u), len(v), 2) unit vectors in the plane's coordinates, less than 1 where they leave it, drawn
            as dashes.
        point: (2,) the pose whose numbers are reported.
    """
    figure, (axes,) = with_panels(7.5, 6.0, grid=False)
    shown = np.ma.masked_invalid(values).T
    if shown.count():
        top = float(np.percentile(shown.compressed(), TAIL))
        levels = MaxNLocator(LEVELS).tick_values(shown.min(), max(top, shown.min() * 1.001))
        extend = "max" if levels[-1] < shown.max() else "neither"
        filled = axes.contourf(u, v, shown, levels, cmap=HEIGHT, extend=extend)
        axes.contour(u, v, shown, filled.levels, colors="white", linewidths=0.4)
        figure.colorbar(filled, ax=axes, label=label)
    if directions is not None:
        step = max(1, -(-max(len(u), len(v)) // DASHES))
        here = (slice(step // 2, None, step), slice(step // 2, None, step))
        x, y = np.meshgrid(u[here[0]], v[here[1]], indexing="ij")
        d = directions[here]
        apart = step * max(np.ptp(u) / (len(u) - 1), np.ptp(v) / (len(v) - 1))
        axes.quiver(x, y, d[..., 0], d[..., 1], angles="xy", pivot="mid", headwidth=0, headlength=0, headaxislength=0,
                    color="white", width=0.003, scale_units="xy", scale=1 / (DASH * apart))  # fmt: skip
        axes.plot([], [], "-", color="0.6", label="softest direction, its part in the section (white)")
    if point is not None:
        axes.plot(
            *point,
            "o",
            color=COLOURS[1],
            markersize=7,
            linestyle="none",
            markeredgecolor="white",
            label="reported pose",
        )
    mark_guideways(axes, marks)
    axes.set(xlabel=f"{names[0]} [m]", ylabel=f"{names[1]} [m]", title=title)
    if shown.count():
        inside = ~np.ma.getmaskarray(shown)
        ranges = []
        for limit, c, along, others in ((axes.set_xlim, u, 0, marks[:, 0]), (axes.set_ylim, v, 1, marks[:, 1])):
            seen = np.concatenate([np.asarray(c)[inside.any(axis=along)], others])
            limit(seen.min() - BORDER, seen.max() + BORDER)
            ranges.append(np.ptp(seen) + 2 * BORDER)
        # as wide as what is drawn, with room for the scale beside it
        figure.set_size_inches(float(np.clip(ROOM + MAP * ranges[0] / ranges[1], *WIDTHS)), 6.0)
    axes.set_aspect("equal")
    key_below(figure, axes, columns=2)
    return figure


@styled
def shares_figure(shares: Mapping[str, float], *, title: str = "") -> Figure:
    """Parts of a load's work, 0 to 1, by what is compliant."""
    figure, (axes,) = with_panels(7.5, 2.6, grid=False)
    names = list(shares)[::-1]
    bars = axes.barh(names, [100 * shares[n] for n in names], color=COLOURS[0])
    axes.bar_label(bars, fmt="%.0f %%", padding=3)
    axes.set(xlim=(0, 112 * max(shares.values())), xlabel="part of the work [%]", title=title)
    axes.spines[["top", "right"]].set_visible(False)
    return figure
