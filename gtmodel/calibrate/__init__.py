"""Kinematic calibration of any model on its own closure equations. Knows no robot.

Measurements, Pose, Correction   measured poses, their noise, and what lies between sensor and model
Choice                           which parameters are free, fixed, tied, unit quaternions, with priors
prepare, Problem                 equations, unknowns and slopes; identifiability before anything is measured
calibrate, Calibration           parameters with confidence, residuals per link and pose, errors on other poses
judge_held_out                   held-out errors against what a sound model has of them
closure_equations                what closes, as symbols

Before anything is measured
    pose_information                 what each pose would tell; covariance, O1 to O5 of any selection
    positioning                      slopes of the tool centre point: predicted errors over the workspace
    exchange, condition_removal, spread   which poses to measure
    error_curve, grid_point, sufficient_number   how many
    candidates                       a grid in what the robot reaches and the device sees
    LaserTracker, Camera, LineOfSight   where devices see, and how well
    seen_by_distance, seen_by_plane  robots that a partial device measures
    plan_study                       all of these, from a room to the poses to measure: a PlanStudy; what it is asked
                                     for in `plan`
"""

from .calibration import Calibration, calibrate
from .candidates import Candidates, candidates, regular_grid
from .closure import Closure, closure_equations
from .devices import Camera, Device, LaserTracker, LineOfSight
from .held_out import judge_held_out
from .measurements import Correction, Measurements, Pose
from .partial_devices import seen_by_distance, seen_by_plane
from .plan import PlanStudy, plan_study
from .pose_information import PoseInformation, pose_information
from .pose_numbers import ErrorCurve, Point, error_curve, grid_point, sufficient_number
from .pose_selection import Selection, condition_removal, exchange, spread
from .positioning import Positioning, PredictedErrors, positioning
from .problem import COSTS, Cost, Problem, prepare
from .unknowns import Choice

__all__ = [
    "COSTS", "Calibration", "Camera", "Candidates", "Choice", "Closure", "Correction", "Cost", "Device", "ErrorCurve",
    "LaserTracker", "LineOfSight", "Measurements", "PlanStudy", "Point", "Pose", "PoseInformation", "Positioning",
    "PredictedErrors", "Problem", "Selection", "calibrate", "candidates", "closure_equations", "condition_removal",
    "error_curve", "exchange", "grid_point", "judge_held_out", "plan_study", "pose_information", "positioning",
    "prepare", "regular_grid", "seen_by_distance", "seen_by_plane", "spread", "sufficient_number",
]  # fmt: skip
