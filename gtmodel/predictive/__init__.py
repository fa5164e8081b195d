"""Optimal control over a horizon, solved again in every cycle.

controller       a model of components as a predictive controller, in Python, as a sampled block, and in C
Controller, ControllerRun, CycleResult    the controller, a running instance, and the result of one cycle
ControlHorizon, Measurement, AxisServo    stages, period and delay; the noise of a measured variable; the servo of axes
ConvergedPlan    the optimum that the cycles approach
HorizonStage, LimitedRow       one stage of a horizon: step, quadratic cost, and rows with limits, as CasADi expressions
StageQP          the quadratic program of a horizon: an interior point method that exploits its stages
ControllerQP     the same as a step function, for C code in a control loop
StageSolution    states, inputs, cost, status and residuals of one solution
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .controller import (
        Controller as Controller,
        ControllerRun as ControllerRun,
        CycleResult as CycleResult,
        controller as controller,
    )
    from .controller_qp import ControllerQP as ControllerQP
    from .converged import ConvergedPlan as ConvergedPlan
    from .options import AxisServo as AxisServo, ControlHorizon as ControlHorizon, Measurement as Measurement
    from .stage import HorizonStage as HorizonStage, LimitedRow as LimitedRow
    from .stage_qp import StageQP as StageQP, StageSolution as StageSolution

public(__name__)
