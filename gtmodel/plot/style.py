"""The style of all pictures: colours, font sizes, legends, scales, and figures with panels.

The Okabe-Ito colours can be told apart by colour-blind readers. If a panel has many curves, line styles distinguish
them too. Measurements are black dots, drawn on top of the model's prediction, a broad coloured line.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, TypeVar, cast

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

# dark ones first
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#f0e442")
BLUE, ORANGE, GREEN, PINK, AMBER, SKY, BLACK, YELLOW = COLOURS
STYLES = ("-", "--", ":", "-.")
# tints of the blue, light to dark: nested regions, bars behind dots
SHADES = ("#e3e9f0", "#bcd0e5", "#8db3d9", "#5a8fc4", "#2d6aa8", "#124a83")
HIGHLIGHT = "#fff3c4"  # background of marked panels and intervals
HEIGHT, AWAY_FROM_ZERO = "viridis", "RdBu_r"  # colour maps: for magnitudes, for signed values
MEASURED: dict[str, Any] = dict(color=BLACK, marker=".", markersize=2.5, linestyle="none", zorder=3)
MODELLED: dict[str, Any] = dict(color=ORANGE, linewidth=2.2, zorder=2)
LIMIT: dict[str, Any] = dict(color="0.4", linestyle=":", linewidth=1.2)
SETTINGS: dict[str, Any] = {
    "axes.prop_cycle": cycler(color=COLOURS), "axes.axisbelow": True, "axes.titlesize": "medium",
    "figure.titlesize": "large", "grid.alpha": 0.3, "image.cmap": HEIGHT, "legend.fontsize": "small",
    "legend.framealpha": 0.9, "axes.formatter.use_mathtext": True,
}  # fmt: skip
LETTERS = 9.5  # characters of a large title per inch
_Draw = TypeVar("_Draw", bound=Callable[..., Figure])


@contextmanager
def settings() -> Iterator[None]:
    """Replace the user's matplotlib settings by those of this module, also needed while a figure is written."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(cast("Any", SETTINGS))
        yield


def styled(draw: _Draw) -> _Draw:
    """Make a drawing function use the settings of this module instead of the user's."""

    @wraps(draw)
    def drawn(*args: Any, **more: Any) -> Figure:
        with settings():
            return draw(*args, **more)

    return cast("_Draw", drawn)


def colour(k: int) -> str:
    """Return the colour of curve k, counted from 0; the colours repeat."""
    return COLOURS[k % len(COLOURS)]


def curve(k: int) -> dict[str, Any]:
    """Return colour and line style of curve k, counted from 0; 32 combinations differ."""
    return dict(color=colour(k), linestyle=STYLES[k // len(COLOURS) % len(STYLES)])


def with_panels(
    width: float, height: float, rows: int = 1, columns: int = 1, *, title: str = "", grid: bool = True,
    fontsize: str = "large", **more: Any,
) -> tuple[Figure, np.ndarray]:  # fmt: skip
    """Return a figure of this size [inches] and a flat array of its panels, row by row; an empty title is not drawn.

    grid: draw a light grid in each panel. fontsize: of the title. more: passed to `Figure.subplots`, such as sharex.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    stack = figure.subplots(rows, columns, squeeze=False, **more).ravel()
    for axes in stack if grid else ():
        axes.grid(alpha=0.3)
    if title:
        figure.suptitle(_wrapped(title, width), fontsize=fontsize)
    return figure, stack


def _wrapped(title: str, width: float) -> str:
    """Wrap a title to the width of the figure [inches]."""
    return "\n".join(textwrap.fill(line, int(LETTERS * width)) for line in title.splitlines())


def in_space(width: float, height: float, *, title: str = "") -> tuple[Figure, Any]:
    """Return a figure of this size [inches] with one three-dimensional panel."""
    figure = Figure(figsize=(width, height), layout="constrained")
    if title:
        figure.suptitle(_wrapped(title, width))
    return figure, figure.add_subplot(projection="3d")


def key_below(figure: Figure, *panels: Any, columns: int = 4) -> None:
    """Draw one legend below all panels with each label once; no legend if there are no labels."""
    entries: dict[str, Any] = {}
    for axes in panels or figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if entries:
        count = min(columns, len(entries))
        figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=count, frameon=False)


def key_beside(axes: Any) -> None:
    """Draw a legend to the right of a panel, where it covers nothing."""
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def key_under(axes: Any, columns: int = 4) -> None:
    """Draw a legend under a panel and its axis label, where it covers nothing."""
    count = len(axes.get_legend_handles_labels()[0])
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=min(columns, count), frameon=False)


def millionths(unit: str) -> str:
    """Return the unit scaled by 1e-6: µm, µrad, or 1e-6 if dimensionless."""
    return {"m": "µm", "rad": "µrad"}.get(unit, "1e-6" if unit in ("", "1") else f"1e-6 {unit}")


def plain_logarithm(axis: Any, *, subs: tuple[float, ...] = (1.0, 2.0, 5.0)) -> None:
    """Label a logarithmic axis with plain numbers such as 0.5, 1, 2 and 5."""
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
