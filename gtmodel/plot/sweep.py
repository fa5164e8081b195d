"""Pictures of a sweep: curves over one key, a map over two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from .style import COLOURS, curve, key_below, styled, with_panels

PANEL = 3.2  # inches


@styled
def sweep_figure(
    keys: Sequence[str], table: Mapping[str, Sequence[Any]], quantities: Sequence[str], *, most: int = 4,
    title: str = "",
) -> Figure:  # fmt: skip
    """Draw the quantities of a sweep that vary, at most `most` of them.

    One key with numbers: a curve over it, and one curve for each value of the other keys if there are few. Two such
    keys whose rows fill a grid: a map of each quantity. Any other design: dots over the row number. Crosses on the
    lower edge mark rows without a value.

    Args:
        keys: varied keys. table: column -> values of the rows, None for no value; with the column "row".
        quantities: columns to draw.
    """
    drawn = [q for q in quantities if _varies(table[q])][:most] or [q for q in quantities if _numeric(table[q])][:1]
    if not drawn:
        figure, (axes,) = with_panels(6.0, PANEL, title=title or "sweep")
        axes.text(0.5, 0.5, "no quantity with numbers", ha="center", transform=axes.transAxes)
        return figure
    numeric = [key for key in keys if _numeric(table[key]) and len(set(table[key])) > 1]
    columns = min(2, len(drawn))
    lines = -(-len(drawn) // columns)
    figure, panels = with_panels(5.2 * columns, PANEL * lines, lines, columns, title=title or "sweep")
    grid = _grid(table, numeric) if len(numeric) == len(keys) == 2 else None
    for panel, name in zip(panels, drawn, strict=False):
        y = _numbers(table[name])
        if grid is not None:
            u, v, index = grid
            mesh = panel.pcolormesh(u, v, np.where(index >= 0, y[index], np.nan), shading="nearest")
            figure.colorbar(mesh, ax=panel, label=name)
            panel.set(xlabel=keys[0], ylabel=keys[1])
            continue
        x_name = numeric[0] if len(numeric) == 1 else "row"
        _curves(panel, [k for k in keys if k != x_name] if x_name != "row" else [], x_name, table, y)
        panel.set(xlabel=x_name, ylabel=name)
    for panel in panels[len(drawn) :]:
        panel.set_axis_off()
    if panels[0].get_legend_handles_labels()[1]:
        key_below(figure, panels[0], columns=3)
    return figure


def _curves(panel: Any, others: Sequence[str], x_name: str, table: Mapping[str, Sequence[Any]], y: np.ndarray) -> None:
    x = _numbers(table[x_name])
    groups: dict[str, list[int]] = {}
    for k in range(len(x)):
        groups.setdefault(", ".join(f"{key} = {table[key][k]}" for key in others), []).append(k)
    if len(groups) > len(COLOURS):
        groups = {"": list(range(len(x)))}
    for n, (label, members) in enumerate(groups.items()):
        at = sorted(members, key=lambda k: x[k])
        style = curve(n) if x_name != "row" and len(groups) * 2 <= len(x) else curve(n) | {"linestyle": "none"}
        panel.plot(x[at], y[at], marker=".", label=label or None, **style)
    if len(lost := x[np.isnan(y)]):
        panel.plot(lost, np.zeros(len(lost)), "x", color="0.4", transform=panel.get_xaxis_transform(), clip_on=False)


def _grid(table: Mapping[str, Sequence[Any]], keys: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """The two axes of a grid and the row at each node (-1: none); None if half of the nodes have no row."""
    u, i = np.unique(_numbers(table[keys[0]]), return_inverse=True)
    v, j = np.unique(_numbers(table[keys[1]]), return_inverse=True)
    index = np.full((len(v), len(u)), -1)
    index[j, i] = np.arange(len(i))
    return (u, v, index) if 2 * np.count_nonzero(index >= 0) > index.size else None


def _numeric(values: Sequence[Any]) -> bool:
    present = [x for x in values if x is not None]
    return bool(present) and all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in present)


def _varies(values: Sequence[Any]) -> bool:
    return _numeric(values) and len({x for x in values if x is not None}) > 1


def _numbers(values: Sequence[Any]) -> np.ndarray:
    return np.array([np.nan if x is None else x for x in values], float)
