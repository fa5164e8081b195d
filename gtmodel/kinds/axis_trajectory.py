"""Kind "axis_trajectory": time- or energy-optimal motion of the F1, free between positions of its axes or on a path."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from gtmodel.motion import axes, options
from gtmodel.motion.axes import options as axis_options
from gtmodel.problem_files.base import Call, Context
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.problem_files.keys import RobotProblem

from .trajectory.keys import PATH_ARGUMENTS, PathSection, Point

RESULT = "gtmodel.motion.AxisStudy"


class AxisPathSection(PathSection):
    """The path to follow, from start to goal, and the direction of the tool."""

    tool_axis: Point = Field([1.0, 0.0, 0.0], description="direction of the tool in plate coordinates")
    tool: list[Made[axis_options.ToolDirection]] = Field(
        [], description="tool directions between start and goal; the tool turns smoothly from each to the next"
    )

    def course(self) -> axis_options.ToolCourse:
        """Return the directions of the tool along the path."""
        return axis_options.ToolCourse(self.tool_axis, [direction.options() for direction in self.tool])


class Schema(RobotProblem):
    """Optimal motion of the F1 from rest to rest, free between two positions of its axes or along a path."""

    degrees_of_freedom: Literal[5, 6] = Field(5, description="5 keeps q4 = -q5 throughout, 6 leaves all axes free")
    start: Made[axis_options.AxisEnd]
    goal: Made[axis_options.AxisEnd]
    limits: Made[options.AxisLimits]
    path: AxisPathSection | None = Field(default=None, description="the path to follow; free motion if left out")
    cost: Made[axis_options.AxisCost] = Made[axis_options.AxisCost].left_out()
    mesh: Made[axis_options.AxisMesh] = Made[axis_options.AxisMesh].left_out()
    solver: Made[axis_options.AxisSolver] = Made[axis_options.AxisSolver].left_out()


ARGUMENTS = PATH_ARGUMENTS | {
    "start.carts": "start.q_m", "start.axes": "start.q_deg", "goal.carts": "goal.q_m", "goal.axes": "goal.q_deg",
    "tool.axis": "path.tool_axis", "tool.through": "path.tool", "earlier": "--start",
}  # fmt: skip


def call(problem: Schema, context: Context) -> Call:
    """Return the library call that solves the motion."""
    return Call(axes.axis_study, **_arguments(problem, context))


def _arguments(problem: Schema, context: Context) -> dict[str, Any]:
    path = problem.path
    return dict(
        robot=problem.model(context), path=None if path is None else path.options(context),
        tool=None if path is None else path.course(), degrees_of_freedom=problem.degrees_of_freedom,
        **options_of(problem), earlier=context.guess(), title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the optimisation: states, controls, unknowns without a closed form, bounds."""
    from gtmodel.optimize.formulation.problem import build  # here: the keys alone need no engine

    arguments = {name: value for name, value in _arguments(problem, context).items() if value is not None}
    plan = axes.plan_of(axes.AxisProblem(**arguments))
    built = build(plan.optimization, problem.solver.options().formulation)
    mesh, (low, high) = plan.problem.mesh, plan.strokes
    further = list(dict.fromkeys(m.key for m in plan.guard.margins))
    strokes = [f"q{k + 1} {_shown(k, low[k])} to {_shown(k, high[k])}" for k in range(len(low))
               if np.isfinite(low[k]) or np.isfinite(high[k])]  # fmt: skip
    return "\n".join(
        [
            f"{problem.title or 'motion'}: {built.formulation} form, {mesh.elements} elements x "
            f"{mesh.points} Radau points, {problem.degrees_of_freedom} degrees of freedom",
            f"  states: {', '.join(built.state_names)}",
            f"  controls: {', '.join(built.control_names)}; forces within {plan.motors[0]:g} N, torques within "
            f"{plan.motors[-1]:g} N.m",
            f"  unknown at each point: {', '.join(built.point_names)}",
            f"  free: {', '.join(built.free_names)}",
            *(
                [f"  along: {problem.path.shape} of {plan.course.path.length:.4g} m"]
                if problem.path and plan.course
                else []
            ),
            *([f"  strokes: {'; '.join(strokes)}"] if strokes else []),
            *([f"  further limits: {', '.join(further)}"] if further else []),
        ]
    )


def _shown(k: int, x: float) -> str:
    return f"{x:g} m" if k < axes.plan.CARTS else f"{np.degrees(x):g} deg"
