"""Motions of all axes of a robot, carts and rotary ones, as forces of its motors.

axis_study           the optimal motion of the F1, tried with all six axes free: `AxisStudy`
AxisEnd, ToolDirection, ToolCourse, AxisCost, AxisMesh, AxisSolver   what it is asked to be, besides `AxisLimits`

AxisProblem, plan_of, AxisPlan   all that is asked; checked, as an Optimization with its guess
Course, turning      the way of a plate along a path, as equations
free_run             forces of a motion applied with all axes free
"""

from .course import Course, turning
from .free_run import FreeRun, free_run
from .motion_study import axis_study
from .options import AxisCost, AxisEnd, AxisMesh, AxisSolver, ToolCourse, ToolDirection
from .plan import AxisPlan
from .planning import plan_of
from .problem import AxisProblem
from .result import AxisStudy

__all__ = [
    "AxisCost", "AxisEnd", "AxisMesh", "AxisPlan", "AxisProblem", "AxisSolver", "AxisStudy", "Course", "FreeRun",
    "ToolCourse", "ToolDirection", "axis_study", "free_run", "plan_of", "turning",
]  # fmt: skip
