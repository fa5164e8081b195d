"""What is wrong with a picture: axes without a unit, texts that cover each other, colours that are not the house's."""

from __future__ import annotations

import re
from collections import Counter
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.text import Text

from gtmodel.plot.style import COLOURS, HIGHLIGHT, SHADES

# what has no unit: names along an axis, and numbers of things
COUNTED = ("pose", "row", "point", "line", "joint", "test", "order", "parameter", "unknown", "equation", "iteration",
           "number of")  # fmt: skip
UNIT = re.compile(r"\[[^\]]+\]")
PALETTE = np.array([to_rgb(c) for c in (*COLOURS, *SHADES, HIGHLIGHT)])
SLACK = 1.5  # pixels that texts may share, for their boxes are wider than the letters
NAMES_OVERLAP = 30  # more names than this along an axis are meant to be read in a zoomed picture


def faults(figure: Figure) -> list[str]:
    """A sentence each; none of a good picture."""
    canvas = FigureCanvasAgg(figure)
    for _ in range(2):  # equal scales and the layout follow each other
        canvas.draw()
    return [*unlabelled(figure), *doubled(figure), *covered(figure, canvas.get_renderer()), *foreign(figure)]


def panels(figure: Figure) -> list[Any]:
    """Axes that hold data, without the scales of colours."""
    return [a for a in figure.axes if a.axison and a.get_label() != "<colorbar>"]


def unlabelled(figure: Figure) -> list[str]:
    """Axes without a name or a unit; those that share their scale with a neighbour's are named there."""
    said = []
    for axes in panels(figure):
        for axis in axes._axis_map.values():
            shown = any(t.label1.get_visible() and t.label1.get_text() for t in axis._update_ticks())
            text = axis.get_label_text()
            if shown and not (UNIT.search(text) or text.startswith(COUNTED) or _named(axis)):
                said.append(f"axis {axis.axis_name} of '{axes.get_title()}' is called '{text}', without a unit")
    bars = [a for a in figure.axes if a.get_label() == "<colorbar>"]
    said += [f"a scale of colours is called '{a.get_ylabel()}'" for a in bars if not UNIT.search(a.get_ylabel())]
    return said


def _named(axis: Any) -> bool:
    """Words instead of numbers along an axis."""
    texts = [t.get_text() for t in axis.get_ticklabels() if t.get_text()]
    return bool(texts) and all(re.search(r"[A-Za-z]{2}", t) and "mathdefault" not in t for t in texts)


def doubled(figure: Figure) -> list[str]:
    """Equal entries of one legend, equal titles of panels."""
    said = []
    for legend in [*figure.legends, *(a.get_legend() for a in figure.axes)]:
        texts = [] if legend is None else [t.get_text() for t in legend.get_texts()]
        said += [f"legend holds '{t}' {n} times" for t, n in Counter(texts).items() if n > 1]
    titles = Counter(a.get_title(loc) for a in panels(figure) for loc in ("left", "center", "right"))
    return said + [f"{n} panels are called '{t}'" for t, n in titles.items() if t and n > 1]


def covered(figure: Figure, renderer: Any) -> list[str]:
    """Texts that lie on others, or leave the picture."""
    # the box of a slanted text is not where its letters are
    shown = [text for text in texts(figure) if text.get_text().strip() and text.get_rotation() % 90 == 0]
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in shown if text.get_visible()]
    width, height = figure.canvas.get_width_height()
    said = [f"'{t}' leaves the picture" for t, b in boxes
            if min(b.x0, b.y0) < -SLACK or b.x1 > width + SLACK or b.y1 > height + SLACK]  # fmt: skip
    for k, (text, box) in enumerate(boxes):
        for other, place in boxes[:k]:
            wide = min(box.x1, place.x1) - max(box.x0, place.x0)
            high = min(box.y1, place.y1) - max(box.y0, place.y0)
            if wide > SLACK and high > SLACK:
                said.append(f"'{text}' lies on '{other}'")
    return said


def texts(figure: Figure) -> list[Text]:
    """Everything written in a picture; of long lists of names along an axis nothing."""
    written = [*figure.texts, *(t for legend in figure.legends for t in legend.get_texts())]
    if figure._suptitle is not None and figure._suptitle not in written:
        written.append(figure._suptitle)
    for axes in (a for a in figure.axes if a.axison):
        written += [*axes.texts, axes.title, axes._left_title, axes._right_title]
        written += [] if axes.get_legend() is None else axes.get_legend().get_texts()
        for axis in axes._axis_map.values():
            ticks = axis._update_ticks()
            written += [axis.label, axis.offsetText]
            if len(ticks) <= NAMES_OVERLAP:
                written += [t for tick in ticks for t in (tick.label1, tick.label2)]
    return written


def foreign(figure: Figure) -> list[str]:
    """Colours of lines, areas and marks that are neither of the palette nor grey."""
    seen = []
    for axes in panels(figure):
        seen += [line.get_color() for line in axes.get_lines()]
        seen += [p.get_facecolor() for p in axes.findobj(Patch) if p is not axes.patch and p.get_fill()]
        for marks in axes.collections:
            if isinstance(marks, PathCollection) and marks.get_array() is None:
                seen += list(marks.get_facecolor())
    strange = {str(c) for c in seen if not _ours(c)}
    return [f"colour {c} is not of the palette" for c in sorted(strange)]


def _ours(colour: Any) -> bool:
    rgb = np.array(to_rgb(colour))
    return bool(np.ptp(rgb) < 1e-6 or np.abs(PALETTE - rgb).max(axis=1).min() < 1e-6)
