"""Kinematic calibration of any model on its own closure equations. Knows no robot but the Gantry-Tau's parameters.

study, CalibrationStudy   a robot on measured poses: were they read right, fit, held-out errors, intervals, verdict
Fit, Known                which parameters move, what is known of them before
Poses, read_poses, Measured, MeasuredSignal, FrameStart, Sag   measured poses, and how they stand in a CSV file
Synthetic, made_poses     made-up measurements of a robot with known errors
CartPoints, read_cart_points   guideways through measured points
Origin                    where a robot comes from, for its calibrated file

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
from .calibration_study import study
from .candidates import Candidates, candidates, regular_grid
from .closure import Closure, closure_equations
from .devices import Camera, Device, LaserTracker, LineOfSight
from .held_out import judge_held_out
from .measured import CartPoints, FrameStart, Measured, MeasuredSignal, Poses, Sag, read_cart_points, read_poses
from .measurements import Correction, Measurements, Pose
from .options import Fit, Known
from .partial_devices import seen_by_distance, seen_by_plane
from .plan import PlanStudy, plan_study
from .pose_information import PoseInformation, pose_information
from .pose_numbers import ErrorCurve, Point, error_curve, grid_point, sufficient_number
from .pose_selection import Selection, condition_removal, exchange, spread
from .positioning import Positioning, PredictedErrors, positioning
from .problem import COSTS, Cost, Problem, prepare
from .synthetic import Synthetic, made_poses
from .told.result import CalibrationStudy
from .told.robot_file import Origin
from .unknowns import Choice

__all__ = [
    "COSTS",
    "Calibration",
    "CalibrationStudy",
    "Camera",
    "Candidates",
    "CartPoints",
    "Choice",
    "Closure",
    "Correction",
    "Cost",
    "Device",
    "ErrorCurve",
    "Fit",
    "FrameStart",
    "Known",
    "LaserTracker",
    "LineOfSight",
    "Measured",
    "MeasuredSignal",
    "Measurements",
    "Origin",
    "PlanStudy",
    "Point",
    "Pose",
    "PoseInformation",
    "Poses",
    "Positioning",
    "PredictedErrors",
    "Problem",
    "Sag",
    "Selection",
    "Synthetic",
    "calibrate",
    "candidates",
    "closure_equations",
    "condition_removal",
    "error_curve",
    "exchange",
    "grid_point",
    "judge_held_out",
    "made_poses",
    "plan_study",
    "pose_information",
    "positioning",
    "prepare",
    "read_cart_points",
    "read_poses",
    "regular_grid",
    "seen_by_distance",
    "seen_by_plane",
    "spread",
    "study",
    "sufficient_number",
]  # fmt: skip
