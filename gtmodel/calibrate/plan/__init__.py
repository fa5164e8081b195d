"""A calibration planned before anything is measured (Dressler 2012, Fig. 5.21).

plan_study           which poses to measure with which device, and what the calibration will be worth: a PlanStudy
Room, Safety, PlanLimits                 where poses are looked for, and what they keep
Tracker, PatternCamera, Wire, Gauge      what measures
PosesToMeasure, Evaluation, Simulation, Criteria   how many poses, where the robot must be accurate, and how much
"""

from .options import (
    Criteria,
    Evaluation,
    Gauge,
    PatternCamera,
    PlanLimits,
    PosesToMeasure,
    Room,
    Safety,
    Simulation,
    Tracker,
    Wire,
)
from .planned import plan_study
from .result import PlanStudy

__all__ = [
    "Criteria", "Evaluation", "Gauge", "PatternCamera", "PlanLimits", "PlanStudy", "PosesToMeasure", "Room", "Safety",
    "Simulation", "Tracker", "Wire", "plan_study",
]  # fmt: skip
