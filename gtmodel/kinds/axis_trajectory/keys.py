"""The keys of kind "axis_trajectory": from which axis positions to which, within what, at which cost."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtmodel.motion import options
from gtmodel.motion.axes import options as axes
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.path_keys import PathSection, Point
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = "gtmodel.motion.AxisStudy"


class AxisPathSection(PathSection):
    """The path to follow, from start to goal, and how the tool is held."""

    tool_axis: Point = Field([1.0, 0.0, 0.0], description="direction of the tool in plate coordinates")
    tool: list[Made[axes.ToolDirection]] = Field(
        [], description="tool directions between start and goal; the tool turns smoothly from each to the next"
    )

    def held(self) -> axes.ToolCourse:
        """How the tool is held."""
        return axes.ToolCourse(self.tool_axis, [one.options() for one in self.tool])


class Schema(RobotProblem):
    """Optimal motion of the F1 from rest to rest, free between two positions of its axes or along a path."""

    degrees_of_freedom: Literal[5, 6] = Field(5, description="5 keeps q4 = -q5 all the way, 6 leaves all axes free")
    start: Made[axes.AxisEnd]
    goal: Made[axes.AxisEnd]
    limits: Made[options.AxisLimits]
    path: AxisPathSection | None = Field(default=None, description="the path to follow; free if it is left out")
    cost: Made[axes.AxisCost] = Made[axes.AxisCost].left_out()
    mesh: Made[axes.AxisMesh] = Made[axes.AxisMesh].left_out()
    solver: Made[axes.AxisSolver] = Made[axes.AxisSolver].left_out()
