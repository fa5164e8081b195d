"""What a motion of six axes is asked to be, besides its limits (`gtmodel.motion.AxisLimits`) and path."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from ...results import Long, Options, Unit, Within
from ..options import Barrier, MostElements


@dataclass(frozen=True)
class AxisEnd(Options):
    """Where the robot stands at rest: the positions of its axes, or, on a path, its tool centre point.

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
        list[float] | None, Unit("m"), Long(3), "along a path, instead of the axes: tool centre point"
    ] = None  # fmt: skip
    tool: Annotated[
        list[float] | None, Long(3),
        "with tcp and five degrees of freedom: tool direction in the robot's frame; left out, the other end's, so that "
        "it is constant",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class ToolDirection(Options):
    """A direction that the tool has somewhere on its way along the path.

    >>> upright = gt.motion.ToolDirection(at=0.5, direction=[0.0, 0.0, 1.0])
    >>> gt.motion.ToolDirection(at=1.0, direction=[0.0, 0.0, 1.0])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: at: must be more than 0 and less than 1; found 1
    """

    at: Annotated[float, Within(above=0.0, below=1.0), "fraction of the way"]
    direction: Annotated[list[float], Long(3), "tool direction there, in the robot's frame"]


@dataclass(frozen=True)
class ToolCourse(Options):
    """How the tool is held along a path: its axis in the plate, and directions between start and goal.

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
    """What is minimised: time * T + energy * sum over the motors of int (tau / limit)^2 dt, T the final time.

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
    """Where the equations are collocated (Radau).

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
        "accelerations of the axes per element: a continuous line, one value, or a polynomial, whose forces keep their "
        "limits at the points only",
    ] = "linear"


@dataclass(frozen=True)
class AxisSolver(Options):
    """When the solver stops, and which equations it is given.

    >>> gt.motion.AxisSolver(barrier="monotone").max_iterations
    300
    """

    tolerance: Annotated[float, Within(above=0.0), "on the scaled optimality conditions"] = 1e-8
    max_iterations: Annotated[int, Within(above=0), "limit of iterations, of all attempts together"] = 300
    barrier: Barrier = "auto"
    formulation: Annotated[
        Literal["torn", "dae"],
        "which equations are collocated: those of the plate's pose alone, or all as they stand",
    ] = "torn"
