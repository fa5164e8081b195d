"""Optimal motions of all axes of a robot, carts and rotary axes, with the forces of its motors.

axis_study           the optimal motion of the F1, verified with all six axes free: `AxisStudy`
AxisEnd, ToolDirection, ToolCourse, AxisCost, AxisMesh, AxisSolver   its options, with `AxisLimits`

AxisProblem, plan_of, AxisPlan   the whole problem; its check; the checked problem as an Optimization with a guess
PathOrientation, turning      the orientation of a plate along a path, as equations
free_run             forward dynamics of all axes under the forces of a motion
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
