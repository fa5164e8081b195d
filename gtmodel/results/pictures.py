"""Pictures as PNG: identical for identical pictures, with a warning above those of a failed result."""

from __future__ import annotations

import io
import textwrap
from importlib import import_module
from typing import Any
from weakref import WeakKeyDictionary

_DPI = 150
_WARNING, _WARNING_POINTS = "#b00020", 9.0  # colour and size of the warning above the picture of a failed result
_LETTERS, _LINE = 1.7, 1.25  # letters per width, and height of a line, in units of the font size
# pictures by the function that draws them, for as long as it lives: a page may include what is also a file
_drawn: WeakKeyDictionary[Any, bytes] = WeakKeyDictionary()


def png(draw: Any, said: str = "") -> bytes:
    """Return a picture as PNG, identical for identical pictures. said: warning above the picture of a failed result."""
    if said:
        return _png(draw, said)
    if draw not in _drawn:
        _drawn[draw] = _png(draw)
    return _drawn[draw]


def _png(draw: Any, said: str = "") -> bytes:
    buffer = io.BytesIO()
    style = import_module("gtmodel.plot.style")  # by name: results must not depend on gtmodel.plot
    with style.settings():
        figure = draw()
        options = _headed(figure, said) if said else {}
        as_written(figure)
        _lay_out(figure)
        # without matplotlib's version in the file: same input, same bytes
        figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None}, **options)
    return buffer.getvalue()


def _lay_out(figure: Any) -> None:
    """Place the panels of a figure, so that savefig need not: its layout draws the whole figure once more."""
    if any(axes.name != "rectilinear" or axes.get_aspect() != "auto" for axes in figure.axes):
        figure.draw_without_rendering()  # equal scales move the tick labels, and savefig then makes room for them
    elif layout := figure.get_layout_engine():
        figure.set_dpi(_DPI)  # widths of letters depend on it a little
        layout.execute(figure)
        figure.set_layout_engine("none")


def _headed(figure: Any, message: str) -> dict[str, Any]:
    """Write a text above a figure, on added space; returns the options for savefig."""
    from matplotlib.transforms import Bbox

    width, height = figure.get_size_inches()
    inch = 72.0 / _WARNING_POINTS  # lines per inch, and about half the letters
    lines = textwrap.wrap(" ".join(message.split()), max(20, int(_LETTERS * inch * width)))
    text = figure.text(0.5, 1.0, "\n".join(lines), ha="center", va="bottom", color=_WARNING, fontsize=_WARNING_POINTS)
    text.set_in_layout(False)  # the picture itself stays as it was
    above = (len(lines) + 1) * _LINE / inch
    text.set_y(1.0 + 0.5 * _LINE / inch / height)
    return {"bbox_inches": Bbox([[0.0, 0.0], [width, height + above]])}


def as_written(figure: Any) -> None:
    """Print "$" in titles and names literally, not as a formula; Matplotlib's tick labels stay."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if "$" in text.get_text() and "\\mathdefault" not in text.get_text():
            text.set_parse_math(False)
