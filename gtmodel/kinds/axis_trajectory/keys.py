"""The keys of kind "axis_trajectory": from which axis positions to which, within what, at which cost."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtmodel.motion import options
from gtmodel.motion.axes import options as axes
from gtmodel.problem_files.base import Section
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.path_keys import PathSection, Point
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.results.quantity import converted


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

    def options(self) -> axes.AxisEnd:
        """As the study takes it."""
        turned = None if self.q_deg is None else converted(self.q_deg, "deg", "rad").tolist()
        return axes.AxisEnd(self.q_m, turned, self.tcp_m, self.tool)


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
    start: End
    goal: End
    limits: Made[options.AxisLimits]
    path: AxisPathSection | None = Field(default=None, description="the path to follow; free if it is left out")
    cost: Made[axes.AxisCost] = Made[axes.AxisCost]()
    mesh: Made[axes.AxisMesh] = Made[axes.AxisMesh]()
    solver: Made[axes.AxisSolver] = Made[axes.AxisSolver]()
