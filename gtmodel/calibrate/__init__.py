"""Kinematic calibration of any model on its own closure equations; only `Synthetic` is made for the Gantry-Tau.

study, CalibrationStudy   calibrate a robot: check the readings, fit, predict held-out poses, intervals, verdict
Fit, Known                which parameters are free, and prior knowledge of them
MeasuredPoses, read_poses, Measured, MeasuredSignal, MeasuredPoint, FrameStart, Sag   measured poses and the columns of
                                   their file
Refit                     parameters specific to a held-out recording: refitted on some of its poses, judged on the rest
Synthetic, made_poses     synthetic measurements of a robot with known errors
CartPoints, read_cart_points   guideways through measured points
Origin                    where the robot model comes from, for the file of the calibrated robot

Measurements, Pose, Correction   measured poses, whole or partial, their noise, and corrections of the sensors
FixedPoint                       a reflector on the end-effector, or the fixed end of a ball-bar
Choice                           which parameters are free, fixed, tied or unit quaternions, with priors
prepare, CalibrationProblem      equations, unknowns and Jacobians; identifiability before anything is measured
calibrate, Calibration           parameters with confidence, residuals per link and pose, errors on other poses
judge_held_out                   compare held-out errors with those of a sound model
against_noise, pattern           compare errors with the stated noise, and look for patterns over the pose
leave_out, folds_of              cross-validation: leave out single poses or folds
closure_equations                the closure equations as symbols

Before anything is measured
    pose_information                 information of each pose; covariance, O1 to O5 of any selection
    positioning                      Jacobian of the tool centre point: predicted errors over the workspace
    exchange, condition_removal, spread   which poses to measure
    error_curve, grid_point, sufficient_number   how many
    candidates                       a grid in what the robot reaches and the device sees
    LaserTracker, Camera, LineOfSight   where devices see, and how well
    seen_by_distance, seen_by_plane  robots that a partial device measures
    seen_with_quaternion            robots whose rotation R is measured as a quaternion
    plan_study                       all of these, from a room to the poses to measure: a PlanStudy; its options are
                                     in `plan`
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .calibration import Calibration as Calibration, calibrate as calibrate
    from .calibration_study import study as study
    from .closure import Closure as Closure, closure_equations as closure_equations
    from .devices import (
        Camera as Camera,
        Device as Device,
        LaserTracker as LaserTracker,
        LineOfSight as LineOfSight,
        seen_by_distance as seen_by_distance,
        seen_by_plane as seen_by_plane,
        seen_with_quaternion as seen_with_quaternion,
    )
    from .held_out import (
        PosesLeftOut as PosesLeftOut,
        folds_of as folds_of,
        judge_held_out as judge_held_out,
        leave_out as leave_out,
    )
    from .measured import (
        CartPoints as CartPoints,
        FrameStart as FrameStart,
        Measured as Measured,
        MeasuredPoint as MeasuredPoint,
        MeasuredPoses as MeasuredPoses,
        MeasuredSignal as MeasuredSignal,
        Refit as Refit,
        Sag as Sag,
        read_cart_points as read_cart_points,
        read_poses as read_poses,
    )
    from .measurements import (
        Correction as Correction,
        FixedPoint as FixedPoint,
        Measurements as Measurements,
        Pose as Pose,
    )
    from .options import COSTS as COSTS, Choice as Choice, Cost as Cost, Fit as Fit, Known as Known
    from .plan import PlanStudy as PlanStudy, plan_study as plan_study
    from .pose_information import PoseInformation as PoseInformation, pose_information as pose_information
    from .pose_selection import (
        Candidates as Candidates,
        Selection as Selection,
        candidates as candidates,
        condition_removal as condition_removal,
        exchange as exchange,
        regular_grid as regular_grid,
        spread as spread,
    )
    from .positioning import (
        ErrorCurve as ErrorCurve,
        Point as Point,
        Positioning as Positioning,
        PredictedErrors as PredictedErrors,
        error_curve as error_curve,
        grid_point as grid_point,
        positioning as positioning,
        sufficient_number as sufficient_number,
    )
    from .problem import CalibrationProblem as CalibrationProblem, prepare as prepare
    from .report.diagnostics import against_noise as against_noise, pattern as pattern
    from .report.result import CalibrationStudy as CalibrationStudy
    from .report.robot_file import Origin as Origin
    from .synthetic import Synthetic as Synthetic, made_poses as made_poses

public(__name__)
