"""Error of the Kalman filter against how far its model is off: the order of Dressler 2012, Fig. 7.1, and its reason."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ..style import BLUE, GREEN, ORANGE, key_below, styled, with_panels


@styled
def mismatch_figure(
    off: np.ndarray, kalman: np.ndarray, kinematics: float, complementary: float, *, title: str = ""
) -> Figure:
    """Shares off (k,) of the model's frequency and the error (k,) of its filter; errors of the motors alone and of the
    complementary filter, root mean squares [m]."""
    figure, (panel,) = with_panels(6.0, 4.4, title=title)
    order = np.argsort(off)
    panel.semilogy(100 * off[order], 1e6 * kalman[order], ".-", color=BLUE, markersize=8, label="Kalman filter")
    panel.axhline(1e6 * complementary, color=GREEN, linestyle="--", label="complementary filter")
    panel.axhline(1e6 * kinematics, color=ORANGE, linestyle=":", label="motors alone")
    panel.set(xlabel="frequency of the model, off by [%]", ylabel="rms error of the estimate [um]")
    key_below(figure, panel, columns=3)
    return figure
