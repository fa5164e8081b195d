"""Options of a motion of six axes, except its limits, and the result of its study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from ...results import Long, Options, Quantity, Row, Study, Unit, Within
from ..options import Barrier, MostElements


@dataclass(frozen=True)
class AxisEnd(Options):
    """An end of the motion, at rest: the positions of the axes or, on a path, the tool centre point.

    >>> goal = gt.motion.AxisEnd(carts=[0.9, 0.5, 0.35], axes=np.radians([10.0, -10.0, -5.0]).tolist())
    >>> gt.motion.AxisEnd(carts=[0.9, 0.5])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: carts: expected 3 numbers; found 2
    """

    carts: Annotated[list[float] | None, Unit("m", key="q_m"), Long(3), "carts q1, q2, q3"] = None
    axes: Annotated[
        list[float] | None, Unit("rad", written="deg", key="q_deg"), Long(3),
        "rotary axes q4, q5, q6; with five degrees of freedom q5 = -q4",
    ] = None  # fmt: skip
    tcp: Annotated[
        list[float] | None, Unit("m"), Long(3), "tool centre point, instead of the axes along a path"
    ] = None  # fmt: skip
    tool: Annotated[
        list[float] | None, Long(3),
        "tool direction in the robot's frame, with tcp and five degrees of freedom; default: that of the other end, so "
        "that it is constant",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class ToolDirection(Options):
    """A prescribed tool direction at a point of the path.

    >>> upright = gt.motion.ToolDirection(at=0.5, direction=[0.0, 0.0, 1.0])
    >>> gt.motion.ToolDirection(at=1.0, direction=[0.0, 0.0, 1.0])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: at: must be more than 0 and less than 1; found 1
    """

    at: Annotated[float, Within(above=0.0, below=1.0), "fraction of the path"]
    direction: Annotated[list[float], Long(3), "tool direction there, in the robot's frame"]


@dataclass(frozen=True)
class ToolCourse(Options):
    """The tool's orientation along a path: its axis in the plate, and directions between start and goal.

    >>> upright = gt.motion.ToolDirection(at=0.5, direction=[0.0, 0.0, 1.0])
    >>> course = gt.motion.ToolCourse(axis=[0.0, 0.0, 1.0], through=[upright])
    >>> [d.at for d in course.through]
    [0.5]
    """

    axis: Annotated[list[float], Long(3), "direction of the tool in plate coordinates"] = field(
        default_factory=lambda: [1.0, 0.0, 0.0]
    )
    through: Annotated[
        list[ToolDirection],
        "tool directions between start and goal; the tool turns smoothly from each to the next",
    ] = field(default_factory=list)


@dataclass(frozen=True)
class AxisCost(Options):
    """The cost time * T + energy * sum over the motors of int (tau / limit)^2 dt; T is the final time.

    >>> gt.motion.AxisCost(energy=0.1).time
    1.0
    >>> gt.motion.AxisCost(energy=-0.1)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: energy: must be at least 0; found -0.1
    """

    time: Annotated[float, Within(least=0.0), "weight of the final time"] = 1.0
    energy: Annotated[float, Within(least=0.0), "weight of the energy"] = 0.0


@dataclass(frozen=True)
class AxisMesh(Options):
    """The collocation mesh (Radau).

    >>> gt.motion.AxisMesh(control="cubic")
    Traceback (most recent call last):
        ...
    gtmodel.results.agreement.WrongKind: control: expected one of linear, constant, polynomial; found 'cubic'
    """

    elements: Annotated[int, Within(above=0, most=10000), "number of elements of the horizon"] = 20
    most_elements: MostElements = 80
    points: Annotated[int, Within(least=1, most=9), "collocation points per element"] = 3
    control: Annotated[
        Literal["linear", "constant", "polynomial"],
        "accelerations of the axes on each element: linear and continuous, constant, or polynomial, whose forces keep "
        "their limits at the points only",
    ] = "linear"


@dataclass(frozen=True)
class AxisSolver(Options):
    """Limits and formulation of the solver.

    >>> gt.motion.AxisSolver(barrier="monotone").max_iterations
    300
    """

    tolerance: Annotated[float, Within(above=0.0), "tolerance of the scaled optimality conditions"] = 1e-8
    max_iterations: Annotated[int, Within(above=0), "limit of iterations over all attempts"] = 300
    barrier: Barrier = "auto"
    formulation: Annotated[
        Literal["torn", "dae"],
        "formulation of the collocated equations: those of the plate's pose only, or all of them",
    ] = "torn"


Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AxisStudy(Study):
    """An optimal motion of six axes, re-simulated and verified with all of them free; if no optimum was found, only the
    final time has a value.

    refined: whether the mesh was refined.
    """

    final_time: Annotated[float | None, Quantity("s", "final time of the optimum")] = None
    elements: Annotated[int | None, "number of mesh elements; more than requested if the mesh was refined"] = None
    energy: Annotated[
        float | None, Quantity("s", "sum over motors of int (tau / limit)^2 dt [s]", key="energy")
    ] = None  # fmt: skip
    saturation: Annotated[Sequence[float], "share of time in which each motor is within 1 % of its limit"] = ()
    peak_share: Annotated[
        Sequence[float],
        "largest force of each motor relative to its limit at any instant of the re-simulated motion",
    ] = ()
    tcp: Annotated[Array | None, Quantity("m", "tool centre point at start and goal")] = None
    turned: Annotated[
        float | None, Quantity("rad", "angle between the plate's orientations at start and goal", written="deg")
    ] = None
    end_error: Annotated[
        float | None,
        Quantity("m", "distance of the tool centre point from the goal if the forces act on all six free axes"),
    ] = None
    end_angle: Annotated[
        float | None,
        Quantity("rad", "angle between the plate and the goal in that run", key="end_error_deg", written="deg"),
    ] = None
    uncoupled: Annotated[
        float | None,
        Quantity("rad", "largest |q4 + q5| in that run; null with six degrees of freedom", written="deg"),
    ] = None
    pose_apart: Annotated[
        float | None,
        Quantity("m", "largest distance between the optimum's tool centre points and its forward kinematics"),
    ] = None
    defect: Annotated[
        float | None,
        "largest difference of re-simulated and collocated states at an element edge, in nominals",
    ] = None
    path_length: Annotated[
        float | None, Quantity("m", "length of the path; null for a free motion")
    ] = None  # fmt: skip
    path_error: Annotated[
        float | None,
        Quantity("m", "largest distance of the tool centre point from the path at its s; null for a free motion"),
    ] = None
    cross_check_time: Annotated[
        float | None,
        Quantity("s", "final time along the path with squared speeds as unknowns; null if free or jerk-limited"),
    ] = None
    margins: Annotated[
        Mapping[str, float] | None,
        "smallest margin to each further limit, by key: in m for positions, else relative to the limit",
    ] = None
    clearance: Annotated[
        Sequence[float], Quantity("m", "smallest distance of tool centre point and links from each obstacle")
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
            rows.append(Row("mesh elements after refinement", self.elements))
        return rows
