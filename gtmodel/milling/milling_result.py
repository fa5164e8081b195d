"""What a milling study returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ..results import Quantity, Row, Study

Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MillingStudy(Study):
    """Where to mill: the best angles about the spindle, and their deflections.

    What needs dynamics is None without them, and in a study that was stopped before its search was complete; one that
    was stopped before the static index has no values at all. `table` holds the rows for people.
    """

    reachable: Annotated[
        Array | None,
        Quantity(
            "rad", "runs of the angle that some branch reaches within the joint limits: first and last of each",
            written="deg",
        ),
    ] = None  # fmt: skip
    static_angle: Annotated[
        float | None, Quantity("rad", "of the least static index among all reachable angles", written="deg")
    ] = None
    static_index: Annotated[
        float | None, Quantity("m", "there, under the peak force; for ranking, not for millimetres", written="mm")
    ] = None
    static_choice: Annotated[
        float | None,
        Quantity(
            "rad", "of the least static index among angles with dynamics, or as given; null without dynamics",
            written="deg",
        ),
    ] = None  # fmt: skip
    dynamic_angle: Annotated[
        float | None, Quantity("rad", "of the least dynamic index, refined; null without dynamics", written="deg")
    ] = None
    dynamic_index: Annotated[
        float | None, Quantity("m", "there: largest deflection over two seconds from rest", written="mm")
    ] = None
    dynamic_mean: Annotated[
        float | None, Quantity("m", "there: mean deflection without transients", written="mm")
    ] = None  # fmt: skip
    static_choice_index: Annotated[
        float | None, Quantity("m", "dynamic index of the static choice", written="mm")
    ] = None  # fmt: skip
    ratio: Annotated[float | None, Quantity("", "the latter over the least dynamic index on the grid")] = None
    refined: Annotated[
        Sequence[Any] | None,
        Quantity(
            "", "after the NLP: angle [deg], dynamic index [mm], whether it converged; best grid angle first"
        ),
    ] = None  # fmt: skip
    free_speed: Annotated[
        Sequence[float] | None,
        Quantity(
            "",
            "angle [deg], speed [rpm] and dynamic index [mm] of an NLP over both; null without speed_range_rpm",
        ),
    ] = None
    combinations: Annotated[
        Sequence[Mapping[str, Any]] | None,
        Quantity("", "least dynamic index by place, feed direction and speed, with its angle [deg]"),
    ] = None
    change_1_Hz: Annotated[
        Sequence[float] | None,
        Quantity("%", "of the dynamic index where all modes are 1 Hz lower, and higher", key="change_1_Hz_percent"),
    ] = None
    mode_coupling: Annotated[str | None, Quantity("", "verdict in words")] = None
    spectral_radius: Annotated[
        float | None,
        Quantity(
            "",
            "of the linear model with regeneration at the dynamic angle; below 1 stable; null: too slow",
        ),
    ] = None
    guideline: Annotated[Sequence[str] | None, Quantity("", "the answer in sentences")] = None
    compensation_rms: Annotated[
        Sequence[float] | None,
        Quantity(
            "m", "error of the tool by offset: none, static, dynamic, and dynamic within the bandwidth", written="mm"
        ),
    ] = None
    printed_mean: Annotated[
        Mapping[str, Any] | None,
        Quantity("mm", "predicted means of the twelve printed tests, by feed direction"),
    ] = None
    dynamics: Annotated[str | None, Quantity("", "where the dynamics come from")] = None
    table: Sequence[Row] = ()

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        return list(self.table)
