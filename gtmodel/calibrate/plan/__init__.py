"""A calibration planned before anything is measured (Dressler 2012, Fig. 5.21).

plan_study           which poses to measure with which device, and what the calibration will be worth: a PlanStudy
Room, Safety, PlanLimits                 where poses are looked for, and what they keep
Tracker, PatternCamera, Wire, Gauge      what measures
PosesToMeasure, Evaluation, PlanSimulation, Criteria   how many poses, where the robot must be accurate, and how much
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from . import device as device, steps as steps
    from .options import (
        Criteria as Criteria,
        Evaluation as Evaluation,
        Gauge as Gauge,
        PatternCamera as PatternCamera,
        PlanLimits as PlanLimits,
        PlanSimulation as PlanSimulation,
        PlanStudy as PlanStudy,
        PosesToMeasure as PosesToMeasure,
        Room as Room,
        Safety as Safety,
        Tracker as Tracker,
        Wire as Wire,
    )
    from .study import plan_study as plan_study

public(__name__)
