"""Pictures of camera calibrations: residuals over the image, ellipsoids of predicted errors, placement of cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from .style import BLACK, BLUE, ORANGE, key_below, key_beside, styled, with_panels

CELLS = 8  # across and down, over which residuals are averaged
LARGEST = 0.8  # length of the longest arrow, in cells
LEAST = 4  # corners that a cell needs for an arrow
SHARE = 0.05  # size of the largest ellipse, relative to the volume


@styled
def residuals_figure(drawn: Mapping[str, tuple[np.ndarray, np.ndarray]], *, title: str = "") -> Figure:
    """Draw the mean residuals in cells of each camera's image as arrows; drawn: by camera corners and residuals (n, 2).

    Noise gives short arrows in random directions; a wrong camera model gives a pattern.
    """
    figure, panels = with_panels(4.6 * len(drawn), 4.2, 1, len(drawn), title=title)
    for panel, (name, (uv, residuals)) in zip(panels, drawn.items(), strict=True):
        low, size = uv.min(axis=0), np.ptp(uv, axis=0) / CELLS
        cell = np.clip(((uv - low) / size).astype(int), 0, CELLS - 1)
        number = cell[:, 0] * CELLS + cell[:, 1]
        count = np.bincount(number, minlength=CELLS**2)
        mean = np.stack([np.bincount(number, residuals[:, j], minlength=CELLS**2) for j in (0, 1)], axis=1)
        enough = count >= LEAST
        mean = mean[enough] / count[enough, None]
        middle = low + size * (np.stack(np.divmod(np.flatnonzero(enough), CELLS), axis=1) + 0.5)
        longest = float(np.linalg.norm(mean, axis=1).max(initial=1e-12))
        panel.plot(*uv.T, ".", color="0.85", markersize=1.0)
        panel.quiver(*middle.T, *mean.T, color=BLUE, angles="xy", scale_units="xy", width=0.004,
                     scale=longest / (LARGEST * float(size.min())))  # fmt: skip
        panel.set(title=f"{name}: longest arrow {longest:.2g} pixel", xlabel="u [pixel]", ylabel="v [pixel]")
        panel.set_aspect("equal")
        panel.invert_yaxis()
    return figure


@styled
def ellipsoids_figure(positions: np.ndarray, covariance: np.ndarray, *, title: str = "") -> Figure:
    """Draw ellipsoids of one standard deviation at positions (n, 3) [m], covariance (n, 3, 3) [m2], from three sides.

    All are enlarged by the factor in the title of the first panel.
    """
    sizes = np.sqrt(np.linalg.eigvalsh(covariance)[:, -1])
    span = float(np.ptp(positions, axis=0).max())
    factor = SHARE * span / max(float(sizes.max()), 1e-15)
    digits = 10 ** np.floor(np.log10(factor))
    factor = float(np.floor(factor / digits) * digits)
    figure, panels = with_panels(11.0, 4.0, 1, 3, title=title)
    for panel, (i, j) in zip(panels, ((0, 1), (0, 2), (1, 2)), strict=True):
        for p, C in zip(positions, covariance, strict=True):
            values, vectors = np.linalg.eigh(C[np.ix_((i, j), (i, j))])
            axes = 2 * factor * np.sqrt(np.maximum(values, 0.0))
            angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
            panel.add_patch(Ellipse((p[i], p[j]), axes[1], axes[0], angle=angle, fill=False, color=BLUE, linewidth=0.6))
        panel.plot(positions[:, i], positions[:, j], ".", color=ORANGE, markersize=1.5)
        panel.set(xlabel=f"{'xyz'[i]} [m]", ylabel=f"{'xyz'[j]} [m]")
        panel.set_aspect("equal")
    panels[0].set_title(f"one standard deviation, enlarged {factor:g} times")
    return figure


@styled
def places_figure(rows: Sequence[Mapping[str, Any]], *, title: str = "") -> Figure:
    """Draw the predicted rms error over the baseline, a curve per distance; rows: as in the result of the study."""
    figure, (panel,) = with_panels(6.5, 4.0, title=title)
    for distance in sorted({r["distance_m"] for r in rows}):
        points = sorted((r["baseline_m"], r["rms_mm"]) for r in rows if r["distance_m"] == distance and not r["why"])
        if points:
            panel.plot(*zip(*points, strict=True), marker="o", label=f"distance {distance:g} m")
    panel.set(xlabel="baseline [m]", ylabel="rms error over the volume [mm]")
    panel.set_ylim(bottom=0.0)
    key_beside(panel)
    return figure


WIDTH = 8.5  # inches
LONG = 0.05  # length of the arrow for three standard deviations, relative to the image width
GRID = 8  # arrows of the quadratic map across and down


@styled
def residual_figure(
    cameras: Sequence[tuple[str, np.ndarray, np.ndarray, Any]], size: tuple[int, int], *, title: str = ""
) -> Figure:
    """Draw the residuals of each camera; cameras: name, uv (n, 2) [pixel], residuals (n, 2) [pixel], test or None."""
    width, height = size
    each = WIDTH * height / width * 0.75
    figure, panels = with_panels(WIDTH, 1.0 + each * len(cameras), len(cameras), title=title)
    every = np.concatenate([r for _, _, r, _ in cameras])
    spread = float(np.sqrt(np.mean(every**2))) or 1.0
    scale = 3 * spread / (LONG * width)  # pixels of residual per pixel of the image
    for panel, (name, uv, residuals, test) in zip(panels, cameras, strict=True):
        form: dict[str, Any] = dict(angles="xy", scale_units="xy", scale=scale)
        panel.quiver(*uv.T, *residuals.T, color=BLACK, width=1.2e-3, zorder=3, label="corners", **form)
        if test is not None:
            # only within the corners: outside, the map is extrapolated
            u, v = (np.linspace(uv[:, k].min(), uv[:, k].max(), GRID) for k in range(2))
            grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
            arrows = test.at(*(2 * grid / [width - 1, height - 1] - 1).T)
            panel.quiver(*grid.T, *arrows.T, color=ORANGE, width=3e-3, zorder=4, label="quadratic map", **form)
        panel.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
        mapped = f", map {test.size:.2g} pixel rms (p = {test.quadratic:.2g})" if test is not None else ""
        rms = float(np.sqrt(np.mean(residuals**2)))
        panel.set(xlabel="u [pixel]", ylabel="v [pixel]", title=f"{name}: {rms:.3g} pixel rms per coordinate{mapped}")
        panel.text(0.01, 0.02, f"length of this line: {3 * spread:.2g} pixel", transform=panel.transAxes,
                   fontsize="small")  # fmt: skip
        panel.plot([0.01 * width, (0.01 + LONG) * width], [0.92 * height] * 2, color=BLACK, linewidth=2.0)
    key_below(figure, *panels)
    return figure
