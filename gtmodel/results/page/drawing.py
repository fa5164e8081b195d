"""Pictures of a page: SVG with readable text, and the scales of its panels for reading values."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from ..pictures import as_written

POINTS = 72.0  # SVG units per inch
MANY = 4000  # vertices of an artist; beyond that it is a picture within the SVG, smaller and faster to show
FINE, COARSE = 120, 72  # pixels per inch of such a picture, and of a whole picture on a page that grew too large
# no version and no date: same input, same bytes
BARE = {"Date": None, "Creator": None, "Format": None, "Type": None}


@dataclass(frozen=True)
class Drawing:
    """A picture for a page: its SVG element, and the panels, each with box [SVG units], limits, scales and names."""

    svg: str
    panels: list[dict[str, Any]]


def drawing_of(draw: Callable[[], Any], name: str, pixels: bool = False) -> Drawing:
    """Return the picture that `draw` draws. name: prefix of its ids, unique on the page. pixels: without curves, to
    save space."""
    style = import_module("gtmodel.plot.style")  # by name: results must not depend on gtmodel.plot
    import matplotlib as mpl

    with style.settings(), mpl.rc_context({"svg.hashsalt": "gtmodel", "svg.fonttype": "none"}):
        figure = draw()
        as_written(figure)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # written at another resolution, the panels would move
        panels = [_panel(axes, figure, f"{name}-{k}") for k, axes in enumerate(figure.axes) if _is_plane(axes)]
        text = _pixels(figure) if pixels else _vectors(figure, name)
    return Drawing(text, panels)


def _vectors(figure: Any, name: str) -> str:
    for artist in [a for axes in figure.axes for a in (*axes.lines, *axes.collections, *axes.images)]:
        if _vertices(artist) > MANY:
            artist.set_rasterized(True)
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", dpi=FINE, metadata=BARE)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    # ids are unique within a figure; on a page with several figures only with a prefix
    text = re.sub(rf'\bid="(?!{name}-)', f'id="{name}.', text)
    text = re.sub(rf'(href="|url\()#(?!{name}-)', rf"\1#{name}.", text)
    # Verdana is as wide as DejaVu Sans, which Matplotlib laid the texts out for
    return text.replace("'DejaVu Sans'", "'DejaVu Sans', Verdana, sans-serif").strip()


def _pixels(figure: Any) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=COARSE, metadata={"Software": None})
    data = base64.b64encode(buffer.getvalue()).decode()
    width, height = POINTS * figure.get_size_inches()
    return (
        f'<svg width="{width:g}pt" viewBox="0 0 {width:g} {height:g}" xmlns="http://www.w3.org/2000/svg" '
        f'xmlns:xlink="http://www.w3.org/1999/xlink"><image width="{width:g}" height="{height:g}" '
        f'xlink:href="data:image/png;base64,{data}"/></svg>'
    )


def _vertices(artist: Any) -> int:
    """Vertices that an SVG would list for an artist; a marker counts several times, as each is an element."""
    if hasattr(artist, "get_xdata"):
        marker = artist.get_marker()
        return len(artist.get_xdata()) * (1 if marker in ("None", None, "", " ") else 4)
    if (offsets := getattr(artist, "get_offsets", None)) is not None and len(offsets()) > 1:
        return 4 * len(offsets())
    paths = getattr(artist, "get_paths", list)()
    return sum(len(path.vertices) for path in paths)


def _is_plane(axes: Any) -> bool:
    """True for a panel with two axes whose values can be read; not for a colour bar or a view in space."""
    scales = (axes.get_xscale(), axes.get_yscale())
    return axes.name == "rectilinear" and axes.axison and not hasattr(axes, "_colorbar") and set(scales) <= _SCALES


_SCALES = {"linear", "log"}


def _panel(axes: Any, figure: Any, name: str) -> dict[str, Any]:
    """Box, axes and curves of a panel; the curves get ids."""
    scale, height = POINTS / figure.dpi, POINTS * figure.get_size_inches()[1]
    box = axes.get_window_extent()
    sides = [scale * box.x0, height - scale * box.y1, scale * box.x1, height - scale * box.y0]
    return {
        "box": [round(float(side), 2) for side in sides],
        "x": [*_limits(axes.get_xlim()), axes.get_xscale(), axes.get_xlabel() or _shared(axes, "x")],
        "y": [*_limits(axes.get_ylim()), axes.get_yscale(), axes.get_ylabel() or _shared(axes, "y")],
        "curves": dict(_curves(axes, name)),
    }


def _limits(limits: tuple[float, float]) -> list[float]:
    return [float(f"{value:.9g}") for value in limits]


def _shared(axes: Any, side: str) -> str:
    """The label of an axis that another panel shows, as in a column of panels over one time axis."""
    siblings = getattr(axes, f"get_shared_{side}_axes")().get_siblings(axes)
    labels = [getattr(other, f"get_{side}label")() for other in siblings]
    return next((label for label in labels if label), side)


def _curves(axes: Any, name: str) -> Iterator[tuple[str, str]]:
    for k, line in enumerate(axes.lines):
        if 1 < len(line.get_xdata()) and _vertices(line) <= MANY and line.get_transform() == axes.transData:
            line.set_gid(f"{name}-{k}")
            label = str(line.get_label())
            yield f"{name}-{k}", "" if label.startswith("_") else label
