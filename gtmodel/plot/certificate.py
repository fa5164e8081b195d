"""Picture of a certificate: proved, refuted and undecided boxes, seen along the other coordinates."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from .style import BLACK, ORANGE, SHADES, YELLOW, key_below, styled, with_panels

# drawn one over the other: what is not proved hides what is
_DRAWN = ((1, "proved", SHADES[1]), (0, "undecided", YELLOW), (-1, "refuted", ORANGE))


@styled
def boxes_figure(
    lo: np.ndarray,
    hi: np.ndarray,
    verdicts: np.ndarray,
    shares: dict[int, float],
    *,
    names: tuple[str, str],
    points: np.ndarray,
    title: str = "",
) -> Figure:
    """Draw boxes by their verdict in two coordinates.

    Args:
        lo, hi: (2, n) least and greatest coordinates. verdicts: (n,) 1 proved, -1 refuted, 0 undecided.
        shares: verdict -> share of the volume. names: of the coordinates, with units.
        points: (2, k) counter-examples.
    """
    figure, (axes,) = with_panels(7.5, 6.0, grid=False)
    for verdict, word, shade in _DRAWN:
        chosen = np.flatnonzero(verdicts == verdict)
        if not chosen.size:
            continue
        a, b = lo[:, chosen], hi[:, chosen]
        corners = np.stack([[a[0], b[0], b[0], a[0]], [a[1], a[1], b[1], b[1]]]).transpose(2, 1, 0)
        label = f"{word}: {100 * shares[verdict]:.4g} % of the volume"
        axes.add_collection(PolyCollection(list(corners), facecolor=shade, edgecolor="0.4", linewidth=0.3, label=label))
    if points.shape[1]:
        axes.plot(points[0], points[1], "x", color=BLACK, linestyle="none", label="counter-example, evaluated")
    axes.autoscale_view()
    axes.set(xlabel=names[0], ylabel=names[1], title=title)
    key_below(figure, axes, columns=2)
    return figure
