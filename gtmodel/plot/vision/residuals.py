"""Residuals of corners over the picture of each camera, and the quadratic map that goes through them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..style import BLACK, ORANGE, key_below, styled, with_panels

WIDTH = 8.5  # inches
LONG = 0.05  # of the picture's width: the arrow of a residual of three standard deviations
GRID = 8  # arrows of the map across and down


@styled
def residual_figure(
    cameras: Sequence[tuple[str, np.ndarray, np.ndarray, Any]], size: tuple[int, int], *, title: str = ""
) -> Figure:
    """A panel for each camera: its name, uv (n, 2) [pixel], residuals (n, 2) [pixel], and a picture test or None."""
    width, height = size
    each = WIDTH * height / width * 0.75
    figure, panels = with_panels(WIDTH, 1.0 + each * len(cameras), len(cameras), title=title)
    every = np.concatenate([r for _, _, r, _ in cameras])
    spread = float(np.sqrt(np.mean(every**2))) or 1.0
    scale = 3 * spread / (LONG * width)  # pixels of residual for a pixel of the picture
    for panel, (name, uv, residuals, test) in zip(panels, cameras, strict=True):
        form: dict[str, Any] = dict(angles="xy", scale_units="xy", scale=scale)
        panel.quiver(*uv.T, *residuals.T, color=BLACK, width=1.2e-3, zorder=3, label="corners", **form)
        if test is not None:
            # where there are corners: beyond, the map says nothing
            u, v = (np.linspace(uv[:, k].min(), uv[:, k].max(), GRID) for k in range(2))
            at = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
            arrows = test.at(*(2 * at / [width - 1, height - 1] - 1).T)
            panel.quiver(*at.T, *arrows.T, color=ORANGE, width=3e-3, zorder=4, label="quadratic map", **form)
        panel.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
        mapped = f", map {test.size:.2g} pixel rms (chance {test.quadratic:.2g})" if test is not None else ""
        own = float(np.sqrt(np.mean(residuals**2)))
        panel.set(xlabel="u [pixel]", ylabel="v [pixel]", title=f"{name}: {own:.3g} pixel rms in a coordinate{mapped}")
        panel.text(0.01, 0.02, f"an arrow as long as this line: {3 * spread:.2g} pixel", transform=panel.transAxes,
                   fontsize="small")  # fmt: skip
        panel.plot([0.01 * width, (0.01 + LONG) * width], [0.92 * height] * 2, color=BLACK, linewidth=2.0)
    key_below(figure, *panels)
    return figure
