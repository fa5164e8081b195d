"""An elastic tool after motions: its swing in time, and what is left where the frequency is not as planned."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from .style import curve, key_below, styled, with_panels


@styled
def swing_figure(
    swings: Mapping[str, tuple[np.ndarray, np.ndarray]],
    ratios: np.ndarray,
    residuals: Mapping[str, np.ndarray],
    *,
    title: str = "",
) -> Figure:
    """Two panels.

    Args:
        swings: motion -> times (n,) [s], offsets of the tool from where it hangs (n, 3) [m]; its largest direction is
            drawn.
        ratios: (r,) true to planned frequency. residuals: motion -> amplitudes (r,) [m] after the motion.
    """
    figure, (upper, lower) = with_panels(8.0, 7.0, 2, title=title)
    largest = max(swings.values(), key=lambda s: np.abs(s[1]).max())[1]
    k = int(np.argmax(np.abs(largest).max(axis=0)))
    for n, (name, (t, x)) in enumerate(swings.items()):
        upper.plot(t, 1e3 * x[:, k], label=name, linewidth=1.2, **curve(n))
        lower.plot(ratios, 1e3 * residuals[name], label=name, **curve(n))
    upper.set(xlabel="time [s]", ylabel=f"tool against plate, {'xyz'[k]} [mm]",
              title=f"{'xyz'[k]}, the direction of the largest swing")  # fmt: skip
    lower.set(
        title="what is left where the frequency is not as planned",
        xlabel="true frequency / planned frequency [1]",
        ylabel="swing after the motion [mm]",
        ylim=(0, None),
    )
    key_below(figure)
    return figure
