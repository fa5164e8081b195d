"""What a study of a motion of six axes returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...results import Quantity, Row, Study

Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AxisStudy(Study):
    """An optimal motion of six axes, re-simulated and tried with all of them free; where no optimum was found, only the
    final time has a value.

    refined: whether the mesh is finer than the given one.
    """

    final_time: Annotated[float | None, Quantity("s", "final time of the optimum")] = None
    elements: Annotated[int | None, "elements of the mesh: those of the file, or more where a check failed on them"] = (
        None
    )
    energy: Annotated[
        float | None, Quantity("s", "sum over motors of int (tau / limit)^2 dt [s]", key="energy")
    ] = None  # fmt: skip
    saturation: Annotated[Sequence[float], "share of the time in which each motor is within 1 % of its limit"] = ()
    peak_share: Annotated[
        Sequence[float],
        "largest force over its limit at any instant of the re-simulated motion, of each motor",
    ] = ()
    tcp: Annotated[Array | None, Quantity("m", "tool centre point at start and goal")] = None
    turned: Annotated[
        float | None, Quantity("rad", "angle between the plate's orientations at start and goal", written="deg")
    ] = None
    end_error: Annotated[
        float | None,
        Quantity("m", "distance of the tool centre point from the goal when all six axes are free and get the forces"),
    ] = None
    end_angle: Annotated[
        float | None,
        Quantity("rad", "angle of the plate from that at the goal, then", key="end_error_deg", written="deg"),
    ] = None
    uncoupled: Annotated[
        float | None,
        Quantity("rad", "largest |q4 + q5| on that way; null with six degrees of freedom", written="deg"),
    ] = None
    pose_apart: Annotated[
        float | None,
        Quantity("m", "largest distance of the optimum's tool centre points from the forward kinematics of its axes"),
    ] = None
    defect: Annotated[
        float | None,
        "largest difference of re-simulated and collocated states at an element's edge, in nominals",
    ] = None
    path_length: Annotated[
        float | None, Quantity("m", "length of the path to follow; null for a free motion")
    ] = None  # fmt: skip
    path_error: Annotated[
        float | None,
        Quantity("m", "largest distance of the tool centre point from the path at its s; null for a free motion"),
    ] = None
    cross_check_time: Annotated[
        float | None,
        Quantity("s", "final time along the path with squared speeds as unknowns; null if free or with a jerk"),
    ] = None
    margins: Annotated[
        Mapping[str, float] | None,
        "least margin to each further limit, by key: in m for positions, else a share of the limit",
    ] = None
    clearance: Annotated[
        Sequence[float], Quantity("m", "least distance of tool centre point and links from each obstacle")
    ] = ()
    refined: bool = False

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("final time", self.final_time, "s")] if self.final_time is not None else []
        if self.turned is None:
            return rows
        rows += [
            Row("cost", self.objective, ""),
            Row("energy", self.energy, "s"),
            Row("plate turned by", np.degrees(self.turned), "deg"),
        ]
        rows += [Row(f"motor {k + 1} at its limit", 100 * x, "% of the time") for k, x in enumerate(self.saturation)]
        rows.append(Row("largest force at any instant", 100 * max(self.peak_share), "% of its limit"))
        if self.end_error is not None and self.end_angle is not None:
            rows += [
                Row("all six axes free: end error", 1e3 * self.end_error, "mm"),
                Row("all six axes free: end error", np.degrees(self.end_angle), "deg"),
            ]
        if self.path_length is not None:
            rows.append(Row("length of the path", self.path_length, "m"))
        if self.cross_check_time is not None:
            rows.append(Row("final time by squared speeds", self.cross_check_time, "s"))
        rows += [Row(f"margin to {name}", x, "") for name, x in (self.margins or {}).items()]
        rows += [Row(f"distance from obstacle {n}", 1e3 * x, "mm") for n, x in enumerate(self.clearance)]
        if self.uncoupled is not None:
            rows.append(Row("all six axes free: largest |q4 + q5|", np.degrees(self.uncoupled), "deg"))
        if self.refined:
            rows.append(Row("elements of the mesh, refined", self.elements))
        return rows
