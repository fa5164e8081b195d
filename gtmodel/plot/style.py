"""The one style of all pictures: colours, sizes of letters, legends, scales, and a figure with its panels.

Colours are those of Okabe and Ito, which colour-blind eyes can distinguish; curves of one panel differ in grey too, by
their style, where there are many. What was measured is dots, black, on top of what a model says, a broad coloured line.
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
HIGHLIGHT = "#fff3c4"  # behind a panel that is marked
HEIGHT, AWAY_FROM_ZERO = "viridis", "RdBu_r"  # colour maps: of a size, of what has two signs
MEASURED: dict[str, Any] = dict(color=BLACK, marker=".", markersize=2.5, linestyle="none", zorder=3)
MODELLED: dict[str, Any] = dict(color=ORANGE, linewidth=2.2, zorder=2)
LIMIT: dict[str, Any] = dict(color="0.4", linestyle=":", linewidth=1.2)
SETTINGS: dict[str, Any] = {
    "axes.prop_cycle": cycler(color=COLOURS), "axes.axisbelow": True, "axes.titlesize": "medium",
    "figure.titlesize": "large", "grid.alpha": 0.3, "image.cmap": HEIGHT, "legend.fontsize": "small",
    "legend.framealpha": 0.9, "axes.formatter.use_mathtext": True,
}  # fmt: skip
LETTERS = 9.5  # of a large title, in an inch
_Draw = TypeVar("_Draw", bound=Callable[..., Figure])


@contextmanager
def settings() -> Iterator[None]:
    """The settings of this module in place of a person's own, also while a picture is written: sizes count then."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(cast("Any", SETTINGS))
        yield


def styled(draw: _Draw) -> _Draw:
    """A function that draws a figure, under the settings of this module whatever a person's own are."""

    @wraps(draw)
    def drawn(*args: Any, **more: Any) -> Figure:
        with settings():
            return draw(*args, **more)

    return cast("_Draw", drawn)


def colour(k: int) -> str:
    """The colour of curve k, from 0; more curves than colours begin again."""
    return COLOURS[k % len(COLOURS)]


def curve(k: int) -> dict[str, Any]:
    """Colour and style of curve k, from 0, of many: 32 that are all different."""
    return dict(color=colour(k), linestyle=STYLES[k // len(COLOURS) % len(STYLES)])


def with_panels(
    width: float, height: float, rows: int = 1, columns: int = 1, *, title: str = "", grid: bool = True,
    fontsize: str = "large", **more: Any,
) -> tuple[Figure, np.ndarray]:  # fmt: skip
    """A figure [inches] and its panels in one row of an array, row by row, with a light grid each; no title if empty.

    fontsize: of the title. more: as `Figure.subplots` takes it, such as sharex.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    stack = figure.subplots(rows, columns, squeeze=False, **more).ravel()
    for axes in stack if grid else ():
        axes.grid(alpha=0.3)
    if title:
        figure.suptitle(_wrapped(title, width), fontsize=fontsize)
    return figure, stack


def _wrapped(title: str, width: float) -> str:
    """A title in lines that a figure of this width [inches] has room for."""
    return "\n".join(textwrap.fill(line, int(LETTERS * width)) for line in title.splitlines())


def in_space(width: float, height: float, *, title: str = "") -> tuple[Figure, Any]:
    """A figure [inches] with one panel in three dimensions."""
    figure = Figure(figsize=(width, height), layout="constrained")
    if title:
        figure.suptitle(_wrapped(title, width))
    return figure, figure.add_subplot(projection="3d")


def key_below(figure: Figure, *panels: Any, columns: int = 4) -> None:
    """One legend below all panels, of what the panels name, each name once; none where nothing is named."""
    entries: dict[str, Any] = {}
    for axes in panels or figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if entries:
        count = min(columns, len(entries))
        figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=count, frameon=False)


def key_beside(axes: Any) -> None:
    """A legend right of a panel, where it covers nothing."""
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def key_under(axes: Any, columns: int = 4) -> None:
    """A legend under a panel and the name of its axis, where it covers nothing."""
    count = len(axes.get_legend_handles_labels()[0])
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=min(columns, count), frameon=False)


def millionths(unit: str) -> str:
    """The unit of a millionth: µm, µrad; 1e-6 of what has none."""
    return {"m": "µm", "rad": "µrad"}.get(unit, "1e-6" if unit in ("", "1") else f"1e-6 {unit}")


def plain_logarithm(axis: Any, *, subs: tuple[float, ...] = (1.0, 2.0, 5.0)) -> None:
    """Numbers such as 0.5, 1, 2 and 5 along a logarithmic axis."""
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
