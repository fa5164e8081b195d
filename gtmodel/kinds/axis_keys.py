"""The keys of an axis trajectory problem: from which axis positions to which, within what, at which cost."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from gtmodel.motion.options import AxisLimits
from gtmodel.problem_files.base import Section
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.path_keys import PathSection, Point
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.problem_files.solver_keys import Barrier, MostElements


class End(Section):
    """Where the robot stands at rest: the positions of its axes, or, on a path, its tool centre point."""

    q_m: Point | None = Field(None, description="carts q1, q2, q3")
    q_deg: Point | None = Field(None, description="rotary axes q4, q5, q6; with five degrees of freedom q5 = -q4")
    tcp_m: Point | None = Field(None, description="with [path], instead of the axes: tool centre point")
    tool: Point | None = Field(
        None,
        description="with tcp_m and five degrees of freedom: tool direction in the robot's frame; left out, the other "
        "end's, so that it is constant",
    )


class ToolDirection(Section):
    """A tool direction on the way."""

    at: float = Field(gt=0, lt=1, description="fraction of the way")
    direction: Point = Field(description="tool direction there, in the robot's frame")


class AxisPathSection(PathSection):
    """The path to follow, from start to goal, and how the tool is held."""

    tool_axis: Point = Field([1.0, 0.0, 0.0], description="direction of the tool in plate coordinates")
    tool: list[ToolDirection] = Field(
        [], description="tool directions between start and goal; the tool turns smoothly from each to the next"
    )


@made_from(AxisLimits)
class Limits(Made):
    """What the motion must keep; what is left out is unlimited."""


class Cost(Section):
    """What is minimised: time * T + energy * sum over the motors of int (tau / limit)^2 dt."""

    time: NonNegativeFloat = Field(1.0, description="weight of the final time")
    energy: NonNegativeFloat = Field(0.0, description="weight of the energy")


class Mesh(Section):
    """Where the equations are collocated (Radau)."""

    elements: PositiveInt = Field(20, le=10000, description="number of elements of the horizon")
    most_elements: MostElements = 80
    points: int = Field(3, ge=1, le=9, description="collocation points per element")
    control: Literal["linear", "constant", "polynomial"] = Field(
        "linear",
        description="accelerations of the axes per element: a continuous line, one value, or a polynomial, whose "
        "forces keep their limits at the points only",
    )


class Solver(Section):
    """When the solver stops."""

    tolerance: PositiveFloat = Field(1e-8, description="on the scaled optimality conditions")
    max_iterations: PositiveInt = Field(300, description="limit of iterations, of all attempts together")
    barrier: Barrier = "auto"
    formulation: Literal["torn", "dae"] = Field(
        "torn", description="which equations are collocated: those of the plate's pose alone, or all as they stand"
    )


class AxisTrajectoryProblem(RobotProblem):
    """Optimal motion of the F1 from rest to rest, free between two positions of its axes or along a path."""

    degrees_of_freedom: Literal[5, 6] = Field(5, description="5 keeps q4 = -q5 all the way, 6 leaves all axes free")
    start: End
    goal: End
    limits: Limits
    path: AxisPathSection | None = Field(default=None, description="the path to follow; free if it is left out")
    cost: Cost = Cost()  # type: ignore[call-arg]
    mesh: Mesh = Mesh()  # type: ignore[call-arg]
    solver: Solver = Solver()  # type: ignore[call-arg]
