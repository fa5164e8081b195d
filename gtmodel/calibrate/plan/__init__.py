"""Plan a calibration before anything is measured (Dressler 2012, Fig. 5.21).

plan_study           select poses for a device and predict the accuracy of the calibration: a PlanStudy
Room, Safety, PlanLimits                 where to look for poses, and their limits
Tracker, PatternCamera, Wire, Gauge      measuring devices
PosesToMeasure, Evaluation, PlanSimulation, Criteria   number of poses, evaluation points, simulations, criteria
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
