"""The error over the workspace that noise will leave, before anything is measured or after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...calibrate.positioning import PredictedErrors
from ...geometry.quaternions import turn_matrix
from ...geometry.rotations import cross_matrix
from ...results.refusal import ArgumentError
from .joint import JointFit


@dataclass(frozen=True, eq=False)
class PredictedPositions(PredictedErrors):
    """Of positions (n, 3) [m]: covariance (n, 3, 3) [m2] of the error that the calibration leaves, once the frame in
    which the robot is judged is laid through all of them."""

    positions: np.ndarray


def predicted_positions(joint: JointFit, actuators: ArrayLike) -> PredictedPositions:
    """What the covariance of the robot's parameters means for the tool centre point at rows of the actuators.

    Rotation and shift of all positions together are no error: another device sees them from a frame of its own. Raises
    ArgumentError for rows at which the robot does not close.

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
    lost = np.flatnonzero(~np.all(np.isfinite(poses), axis=1))
    if len(lost):
        raise ArgumentError(f"the robot does not close at row {lost[0] + 1}", "actuators")
    _, by_x, by_z, _ = side.at(x, poses, q)
    if side.turns:
        e = poses[:, 3:]
        # increments of the quaternion in its own frame
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
    at = [names.index(f"robot.{n}") for n in side.unknowns.names]
    C = joint.estimate.covariance[np.ix_(at, at)]
    P = flat.reshape(len(T), 3, -1)
    return PredictedPositions(P @ C @ P.transpose(0, 2, 1), poses[:, :3])
