"""The keys of kind "axis_trajectory": from which axis positions to which, within what, at which cost."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtmodel.motion import options
from gtmodel.motion.axes import options as axes
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.path_keys import PathSection, Point
from gtmodel.problem_files.robot_keys import RobotProblem


@made_from(axes.AxisEnd)
class End(Made):
    """Where the robot stands at rest: the positions of its axes, or, on a path, its tool centre point."""


@made_from(axes.ToolDirection)
class ToolDirection(Made):
    """A tool direction on the way."""


class AxisPathSection(PathSection):
    """The path to follow, from start to goal, and how the tool is held."""

    tool_axis: Point = Field([1.0, 0.0, 0.0], description="direction of the tool in plate coordinates")
    tool: list[ToolDirection] = Field(
        [], description="tool directions between start and goal; the tool turns smoothly from each to the next"
    )

    def held(self) -> axes.ToolCourse:
        """How the tool is held."""
        return axes.ToolCourse(self.tool_axis, [one.options() for one in self.tool])


@made_from(options.AxisLimits)
class Limits(Made):
    """What the motion must keep; what is left out is unlimited."""


@made_from(axes.AxisCost)
class Cost(Made):
    """What is minimised: time * T + energy * sum over the motors of int (tau / limit)^2 dt."""


@made_from(axes.AxisMesh)
class Mesh(Made):
    """Where the equations are collocated (Radau)."""


@made_from(axes.AxisSolver)
class Solver(Made):
    """When the solver stops."""


class Schema(RobotProblem):
    """Optimal motion of the F1 from rest to rest, free between two positions of its axes or along a path."""

    degrees_of_freedom: Literal[5, 6] = Field(5, description="5 keeps q4 = -q5 all the way, 6 leaves all axes free")
    start: End
    goal: End
    limits: Limits
    path: AxisPathSection | None = Field(default=None, description="the path to follow; free if it is left out")
    cost: Cost = Cost()
    mesh: Mesh = Mesh()
    solver: Solver = Solver()
