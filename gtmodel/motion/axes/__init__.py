"""Motions of all axes of a robot, carts and rotary ones, as forces of its motors.

axis_study           the optimal motion of the F1, tried with all six axes free: `AxisStudy`
AxisEnd, ToolDirection, ToolCourse, AxisCost, AxisMesh, AxisSolver   what it is asked to be, besides `AxisLimits`

AxisProblem, plan_of, AxisPlan   all that is asked; checked, as an Optimization with its guess
PathOrientation, turning      the way of a plate along a path, as equations
free_run             forces of a motion applied with all axes free
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .motion_study import FreeRun as FreeRun, axis_study as axis_study, free_run as free_run
    from .options import (
        AxisCost as AxisCost,
        AxisEnd as AxisEnd,
        AxisMesh as AxisMesh,
        AxisSolver as AxisSolver,
        AxisStudy as AxisStudy,
        ToolCourse as ToolCourse,
        ToolDirection as ToolDirection,
    )
    from .plan import (
        AxisPlan as AxisPlan,
        AxisProblem as AxisProblem,
        PathOrientation as PathOrientation,
        turning as turning,
    )
    from .planning import plan_of as plan_of

public(__name__)
