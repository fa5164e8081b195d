"""Residuals as a statistician looks at them: over time, histogram, normal plot, autocorrelation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from .signals import PANEL_HEIGHT
from .style import LIMIT, SKY, styled, with_panels

BINS = 40  # most bins; their number grows with the cube root of the residuals' (Rice's rule)
SHOWN = 20_000  # points of a panel; more look the same


@styled
def residuals_figure(
    residuals: Sequence[np.ndarray], names: Sequence[str], units: Sequence[str],
    autocorrelations: Sequence[np.ndarray],
    places: Sequence[np.ndarray] | None = None, place: str = "sample", title: str = "",
) -> Figure:  # fmt: skip
    """Draw the residuals of each signal in four panels: in order, histogram, normal plot, autocorrelation.

    Args:
        residuals: per signal its residuals (n,), in its unit. Values that are not finite are left out.
        names, units: of the signals.
        autocorrelations: per signal, from lag 1 on, as `gt.inference.autocorrelation` returns them.
        places: per signal the abscissa (n,), such as times; default: 0, 1, 2, ...
        place: label of the abscissa with its unit, "time [s]"; "sample", "pose" or "line" have none.

    The curve in the histogram is the normal density with the residuals' mean and standard deviation; the line of the
    normal plot is the same distribution. Dashed lines show where 95 % of the autocorrelations of white noise lie.
    """
    import scipy

    rows = max(1, len(names))
    figure, panels = with_panels(13.0, 1.2 + PANEL_HEIGHT * rows, rows, 4, title=title, width_ratios=(2, 1, 1, 1.2))
    for k, (row, name, unit) in enumerate(zip(panels.reshape(-1, 4), names, units, strict=True)):
        r, x = np.asarray(residuals[k], float), np.arange(len(residuals[k])) if places is None else places[k]
        finite = np.isfinite(r)
        r, x = r[finite], np.asarray(x)[finite]
        order, histogram, normal, lags = row
        step = max(1, len(r) // SHOWN)
        label = f"{name} [{unit}]"
        density = "1" if unit == "1" else f"1/{unit}" if unit.isalpha() else f"1/({unit})"
        order.plot(x[::step], r[::step], ".", color="0.4", markersize=3)
        order.set(xlabel=place, ylabel=label)
        for axes, words in ((histogram, (label, f"density [{density}]")), (normal, ("normal quantile [1]", label)),
                            (lags, ("lag [1]", "autocorrelation [1]"))):  # fmt: skip
            axes.set(xlabel=words[0], ylabel=words[1])
        if len(r) < 3 or not np.ptp(r) > 0:
            continue
        mean, deviation = float(np.mean(r)), float(np.std(r, ddof=1))
        histogram.hist(r, min(BINS, round(2 * len(r) ** (1 / 3)) + 1), density=True, color=SKY)
        span = np.linspace(r.min(), r.max(), 200)
        histogram.plot(
            span,
            np.exp(-(((span - mean) / deviation) ** 2) / 2) / (np.sqrt(2 * np.pi) * deviation),
            color="black",
            linewidth=1.2,
        )
        quantiles = scipy.special.ndtri((np.arange(len(r)) + 0.5) / len(r))
        normal.plot(quantiles[::step], np.sort(r)[::step], ".", color="0.4", markersize=3)
        ends = quantiles[[0, -1]]
        normal.plot(ends, mean + deviation * ends, color="black", linewidth=1.2)
        rho = np.asarray(autocorrelations[k])
        lags.vlines(np.arange(1, len(rho) + 1), 0.0, rho, color="0.4")
        band = 1.96 / np.sqrt(len(r))
        for side in (-band, band):
            lags.axhline(side, **LIMIT)
    for axes, words in zip(
        panels[:4],
        ("residuals", "histogram, normal curve", "normal plot", "autocorrelation"),
        strict=True,
    ):
        axes.set_title(words, fontsize="medium")
    return figure
