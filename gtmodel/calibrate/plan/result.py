"""What a calibration plan says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from ...results import Quantity, Row, Study

Array = np.ndarray
Places = Sequence[Mapping[str, float]]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlanStudy(Study):
    """A calibration planned before anything is measured (Dressler 2012, Fig. 5.21).

    commanded: (n, 3) poses in the order in which they are measured, rows of T [m]; (n, 7) of an F1, the plate's
    quaternion behind. purpose: of each, "calibrate" or "verify". actuators: (n, m) of each [m, rad].
    """

    approved: Annotated[bool, Quantity("", "whether all criteria are met")] = False
    verdict: Annotated[str, Quantity("", "that in a sentence")] = ""
    stages: Annotated[
        Mapping[str, int],
        Quantity("", "grid points left after each stage: workspace, obstacles, safety, device, safety distance"),
    ] = field(default_factory=dict)
    workspace_left: Annotated[
        float | None, Quantity("", "share of the workspace's points that are left for calibration")
    ] = None  # fmt: skip
    poses: Annotated[int, Quantity("", "number of poses to calibrate with")] = 0
    held_out: Annotated[int, Quantity("", "number of poses to judge the result by")] = 0
    rounds: Annotated[Sequence[int], Quantity("", "numbers of poses that were tried")] = ()
    parameters: Annotated[int | None, Quantity("", "number of parameters to calibrate")] = None
    rank: Annotated[int | None, Quantity("", "how many combinations of them the poses determine")] = None
    determined_no_better: Annotated[
        int | None, Quantity("", "how many of these they determine no better than they were known")
    ] = None  # fmt: skip
    condition: Annotated[
        float | None, Quantity("", "condition number of the derivatives, in expected errors per noise")
    ] = None  # fmt: skip
    o1: Annotated[
        float | None,
        Quantity("", "observability index O1, geometric mean of singular values by the root of the number of poses"),
    ] = None
    o2: Annotated[float | None, Quantity("", "O2, least by greatest singular value")] = None
    o3: Annotated[float | None, Quantity("", "O3, least singular value")] = None
    o4: Annotated[
        float | None, Quantity("", "O4, noise amplification: least singular value squared by the greatest")
    ] = None  # fmt: skip
    o5: Annotated[float | None, Quantity("", "O5, 1 / sum of 1 / singular values")] = None
    identifiability: Annotated[Sequence[str], Quantity("", "what is determined and what is not, in sentences")] = ()
    parameter_std: Annotated[
        Mapping[str, float | None],
        Quantity("", "predicted standard deviation by parameter, SI; null where not determined"),
    ] = field(default_factory=dict)
    predicted_error: Annotated[
        float | None,
        Quantity("m", "predicted rms positioning error over the workspace after calibration, from noise alone"),
    ] = None
    predicted_greatest: Annotated[float | None, Quantity("m", "the same at the worst place")] = None
    worst_place: Annotated[Array | None, Quantity("m", "where that is")] = None
    simulated_error: Annotated[
        float | None, Quantity("m", "rms positioning error of the simulated calibrations; synthetic")
    ] = None  # fmt: skip
    simulations_lost: Annotated[int, Quantity("", "simulated calibrations that did not end")] = 0
    curve: Annotated[Places, Quantity("", "for selected poses: poses, predicted_error_m, greatest_m")] = ()
    grid_curve: Annotated[Places, Quantity("", "the same for regular grids")] = ()
    enough_poses: Annotated[
        int | None,
        Quantity(
            "", "least number of selected poses with the wanted accuracy; null if more than four times poses.most"
        ),
    ] = None
    assumptions: Annotated[Sequence[str], Quantity("", "what was assumed, in sentences")] = ()
    commanded: Array = field(default_factory=lambda: np.zeros((0, 3)))
    purpose: Sequence[str] = ()
    actuators: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row(f"points after {name}", count) for name, count in self.stages.items()]
        rows += [
            Row("share of the workspace left", self.workspace_left),
            Row("poses to calibrate with", self.poses),
            Row("poses held out", self.held_out),
            Row("parameters determined", self._determined()),
            Row("condition number", self.condition),
            *(Row(f"observability O{k}", getattr(self, f"o{k}")) for k in range(1, 6)),
        ]
        if self.predicted_error is not None and self.predicted_greatest is not None:
            rows += [
                Row("predicted rms error", 1e3 * self.predicted_error, "mm"),
                Row("at the worst place", 1e3 * self.predicted_greatest, "mm"),
            ]
        if self.simulated_error is not None:
            rows.append(Row("simulated rms error (synthetic)", 1e3 * self.simulated_error, "mm"))
        if self.curve:
            enough = self.enough_poses
            rows.append(Row("poses that suffice", "more than looked at" if enough is None else enough))
        for curve, kind in ((self.curve, "selected"), (self.grid_curve, "of a grid")):
            rows += [Row(f"error with {p['poses']} {kind}", 1e3 * p["predicted_error_m"], "mm") for p in curve]
        if self.rank != self.parameters or self.determined_no_better:
            rows += [Row("undetermined", sentence) for sentence in self.identifiability[1:]]
        return rows + [Row("assumed", sentence) for sentence in self.assumptions]

    def _determined(self) -> str | None:
        if self.rank is None or not (weak := self.determined_no_better):
            return None if self.rank is None else f"{self.rank} of {self.parameters}"
        return f"{self.rank - weak} of {self.parameters}, {weak} more no better than they were known"
