"""The table and the pictures of a causality on many points."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from ...compiler.causal import CausalSignal
from ..orientation import OrientationMap
from . import point_table
from .options import Orientation, PointGrid
from .result import CausalityStudy

Array = np.ndarray


def csv_of(pairs: Sequence[tuple[CausalSignal, Array]], study: CausalityStudy, orientation: Orientation | None) -> str:
    """The table of all points as CSV."""
    columns = [(point_table.columns(s), s.unit, values) for s, values in pairs]
    if orientation is not None:
        columns.append(([f"zyz[{k}]" for k in range(3)], "deg", np.degrees(study.orientation.zyz).reshape(-1, 3)))
        if orientation.rotation_vector:
            vector = np.degrees(study.orientation.rotation_vector).reshape(-1, 3)
            columns.append(([f"rotation_vector[{k}]" for k in range(3)], "deg", vector))
    return point_table.text(columns, study.words)


def figures_of(
    pairs: Sequence[tuple[CausalSignal, Array]], study: CausalityStudy, box: PointGrid | None, title: str
) -> dict[str, Any]:
    """Pictures by name."""
    shown = [(s.name, s.unit, values) for s, values in pairs]
    figures: dict[str, Any] = {"targets": partial(_targets_figure, shown, study.ok, title)}
    if study.orientation is not None and np.any(study.orientation.ok):
        figures["orientation_points"] = partial(_sequence_figure, study.orientation, title)
        if box is not None and min(box.counts[1:]) > 1:
            figures["orientation_layers"] = partial(_layers_figure, study.orientation, box, title)
    return figures


def _targets_figure(shown: list[tuple[str, str, Array]], ok: Array, title: str) -> Any:
    from ...plot.workspace import points_figure

    return points_figure(shown, ok, title)


def _sequence_figure(orientation: OrientationMap, title: str) -> Any:
    from ...plot.workspace import sequence_figure

    return sequence_figure(orientation.zyz, title)


def _layers_figure(orientation: OrientationMap, box: PointGrid, title: str) -> Any:
    from ...plot.workspace import layers_figure

    return layers_figure(orientation.zyz, box.half_width, box.directions, title)
