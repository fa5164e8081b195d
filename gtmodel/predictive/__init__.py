"""Optimal control over a horizon, solved again in every cycle.

HorizonStage, LimitedRow       one stage of a horizon: step, quadratic cost, and rows with limits, as CasADi expressions
StageQP          the quadratic program of a horizon: an interior point method that exploits its stages
ControllerQP     the same as a step function, for C code in a control loop
StageSolution    states, inputs, cost, status and residuals of one solution
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .controller_qp import ControllerQP as ControllerQP
    from .stage import HorizonStage as HorizonStage, LimitedRow as LimitedRow
    from .stage_qp import StageQP as StageQP, StageSolution as StageSolution

public(__name__)
