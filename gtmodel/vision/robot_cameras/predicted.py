"""Prediction of the error over the workspace due to noise, before or after the measurement, and placement of two
cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ...calibrate.positioning import PredictedErrors
from ...geometry.quaternions import turn_matrix
from ...geometry.rotations import cross_matrix
from ...lang.model import Model
from ...results.refusal import ArgumentError
from .joint import JointFit, joint_fit
from .options import CameraPlaces, RobotCameras, SyntheticRobotCameras
from .synthetic import made_pictures


@dataclass(frozen=True, eq=False)
class PredictedPositions(PredictedErrors):
    """Predicted errors of a calibrated robot at positions (n, 3) [m]: covariance (n, 3, 3) [m2], after the best fit of
    the reference frame to all positions."""

    positions: np.ndarray


def predicted_positions(joint: JointFit, actuators: ArrayLike) -> PredictedPositions:
    """Propagate the covariance of the robot parameters to the tool centre point at rows of the actuators.

    A common rotation and translation of all positions is not counted as an error, because the frame of a reference
    device is arbitrary. Raises ArgumentError for rows at which the closure equations have no solution.

    >>> V = gt.vision.robot_cameras
    >>> made = V.made_pictures(V.SyntheticRobotCameras(counts=[3, 3, 3]))
    >>> joint = V.joint_fit(made.robot, made.pictures, made.cameras)
    >>> inside = V.predicted_positions(joint, made.pictures.actuators).rms
    >>> 0.02e-3 < inside < 0.5e-3
    True
    """
    q = np.asarray(actuators, float).reshape(-1, joint.pictures.actuators.shape[1])
    side, x = joint.side, joint.fit.values["robot"][0]
    poses = side.forward(x, q, side.start(q))
    unsolved = np.flatnonzero(~np.all(np.isfinite(poses), axis=1))
    if len(unsolved):
        raise ArgumentError(f"the closure equations have no solution at row {unsolved[0] + 1}", "actuators")
    _, by_x, by_z, _ = side.at(x, poses, q)
    if side.turns:
        e = poses[:, 3:]
        # rotation increments in the frame of the plate
        G = np.zeros((len(e), 7, 6))
        G[:, :3, :3] = np.eye(3)
        G[:, 3:, 3:] = turn_matrix(e)
        by_z = by_z @ G
    P = -np.linalg.solve(by_z, by_x)[:, :3]
    T = poses[:, :3] - poses[:, :3].mean(axis=0)
    turns = -cross_matrix(T)
    frame = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2)
    Q = np.linalg.qr(frame.reshape(-1, 6))[0]
    flat = P.reshape(len(T) * 3, -1)
    flat = flat - Q @ (Q.T @ flat)
    names = list(joint.estimate.names)
    columns = [names.index(f"robot.{n}") for n in side.unknowns.names]
    C = joint.estimate.covariance[np.ix_(columns, columns)]
    P = flat.reshape(len(T), 3, -1)
    return PredictedPositions(P @ C @ P.transpose(0, 2, 1), poses[:, :3])


@dataclass(frozen=True, eq=False)
class PlacedCameras:
    """One placement with its simulated calibration and the errors that this predicts; if `predicted` is None, `why`
    states the reason."""

    baseline: float
    distance: float
    predicted: PredictedPositions | None
    focal_deviation: float = np.nan
    why: str = ""
    joint: JointFit | None = None


def camera_places(
    robot: Model, scene: SyntheticRobotCameras, places: CameraPlaces, setting: RobotCameras | None = None
) -> list[PlacedCameras]:
    """Predict the errors for each baseline and distance, smallest first; placements that lose the target come last.

    The pictures are simulated without errors, for the uncalibrated robot, but weighted with their noise. To first order
    the covariance is that of the future calibration. Raises ArgumentError if no placement sees the target at every
    pose.

    >>> V = gt.vision.robot_cameras
    >>> robot, scene = gt.robots.gantry_tau("l1_tape"), V.SyntheticRobotCameras(counts=[3, 3, 3])
    >>> best, worst = V.camera_places(robot, scene, V.CameraPlaces(baselines=[0.5, 1.5], distances=[3.2]))
    >>> best.baseline, bool(best.predicted.rms < worst.predicted.rms)
    (1.5, True)
    """
    rows = [_placed(robot, scene, b, d, setting or RobotCameras()) for d in places.distances for b in places.baselines]
    if all(r.predicted is None for r in rows):
        raise ArgumentError(f"no placement sees the target at every pose: {rows[0].why}", "distances")
    return sorted(rows, key=lambda r: np.inf if r.predicted is None else r.predicted.rms)


def _placed(
    robot: Model, scene: SyntheticRobotCameras, baseline: float, distance: float, setting: RobotCameras
) -> PlacedCameras:
    still = replace(scene, baseline=baseline, distance=distance, robot_error=0.0, pixel_noise=0.0, actuator_noise=0.0,
                    turned_pictures=[], wrong_corners=0.0)  # fmt: skip
    try:
        synthetic = made_pictures(still, robot)
    except ArgumentError as error:
        return PlacedCameras(baseline, distance, None, why=error.message)
    pictures = replace(synthetic.pictures, sigma=np.full(len(synthetic.pictures), scene.pixel_noise))
    joint = joint_fit(synthetic.robot, pictures, synthetic.cameras, replace(setting, removal=0.0))
    if not joint.fit.status.ok:
        return PlacedCameras(baseline, distance, None, why=joint.fit.message)
    names = list(joint.estimate.names)
    focal = f"{pictures.cameras[0]}.fx"
    deviation = float(joint.estimate.std[names.index(focal)]) if focal in names else 0.0
    return PlacedCameras(baseline, distance, predicted_positions(joint, pictures.actuators), deviation, joint=joint)
