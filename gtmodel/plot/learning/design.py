"""|1 - L T| of all models against 1/|Q|: Dressler 2012, Figs. 7.14 and 7.17."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ..style import BLUE, LIMIT, ORANGE, key_below, styled, with_panels

SMALLEST = 1e-2  # of |Q| in the picture


@styled
def filter_figure(
    names: Sequence[str], axes: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], *, title: str = ""
) -> Figure:
    """A panel for each axis: frequency (k,) [Hz], Q (k,) and the largest |1 - L T| over the models (k,). It converges
    where the second curve lies below the first."""
    figure, panels = with_panels(4.2 * len(names), 4.4, 1, len(names), title=title, sharey=True)
    for panel, name, (frequency, response, rest) in zip(panels, names, axes, strict=True):
        f = frequency[1:]
        panel.loglog(f, 1 / np.maximum(np.abs(response[1:]), SMALLEST), color=BLUE, label="1 / |Q|")
        panel.loglog(f, rest[1:], color=ORANGE, label="|1 - L T|, worst model")
        panel.axhline(1.0, **LIMIT)
        panel.set(title=name, xlabel="frequency [Hz]", xlim=(0.5, f[-1]), ylim=(0.05, 1 / SMALLEST))
    key_below(figure, *panels, columns=2)
    return figure
