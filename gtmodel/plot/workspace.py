"""Cross-sections of a workspace, one above the other, with the guideways."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from .style import SHADES, key_below, styled, with_panels


class Outlined(Protocol):
    """A region of a plane, such as `gt.kinematics.region` gives."""

    @property
    def area(self) -> float:
        """[m2]"""
        ...

    @property
    def loops(self) -> Sequence[np.ndarray]:
        """Closed boundaries (k, 2) [m], holes the other way round."""
        ...


@styled
def section_figure(
    layers: Mapping[str, Outlined], guideways: np.ndarray, *, title: str = "", names: tuple[str, str] = ("u", "v")
) -> Figure:
    """Regions of a section, drawn in the order given, their boundaries, and the guideways as numbered squares.

    Args:
        layers: label -> region, the largest first; the area is added to the label.
        guideways: (m, 2) where they pierce the section [m].
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
    """Squares with the numbers of the guideways at (m, 2) [m]."""
    for k, (u, v) in enumerate(np.asarray(guideways)):
        axes.plot(u, v, "s", color="black", markersize=8, linestyle="none",
                  label="guideway, with its number" if k == 0 else None)  # fmt: skip
        axes.annotate(str(k + 1), (u, v), xytext=(7, 7), textcoords="offset points", fontweight="bold",
                      bbox=dict(boxstyle="round,pad=0.1", facecolor="white", edgecolor="none", alpha=0.7))  # fmt: skip


def _path(loops: Sequence[np.ndarray]) -> Path:
    """All loops as one path; holes run the other way round and stay empty."""
    vertices, codes = [], []
    for loop in loops:
        vertices += [loop, loop[:1]]
        codes += [Path.MOVETO, *[Path.LINETO] * (len(loop) - 1), Path.CLOSEPOLY]
    return Path(np.vstack(vertices), codes)
