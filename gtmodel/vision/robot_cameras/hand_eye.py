"""Hand-eye calibration of a camera on an arm, or of a fixed camera, as a bundle of pixels and arm poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from ...geometry.quaternions import conjugate, logarithm, product, quaternion_of
from ...geometry.rotations import inverse_poses, matrices_of, poses_of
from ...inference.bundle import BundleFit, ResidualBlock, UnknownGroup, bundle_fit
from ...results.estimate import Estimate
from ...results.refusal import ArgumentError
from ..starts import board_pose
from .joint import CAMERA_UNITS, HUBER, INTRINSICS
from .options import CameraStart, Estimated
from .pictures import RobotPictures
from .projection import CAMERA, TARGET, TURN, corner_function

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
LEAST = 3  # pictures
ALIKE = 0.05  # rad: rotations between pictures that are too small to determine the camera's place


@dataclass(frozen=True, eq=False)
class HandEye:
    """Result of a hand-eye calibration.

    `camera` (7,) and `target` (7,): pose (quaternion, scalar first, and position [m]) on the arm's plate or base,
    whichever carries it. `estimate`: of these poses, named "camera.x", "target.turn_x" ..., and of the lens.
    `residuals` (n, 2) [pixel].
    """

    fit: BundleFit
    camera: np.ndarray
    target: np.ndarray
    residuals: np.ndarray

    @property
    def estimate(self) -> Estimate:
        """Estimate of the fit. Raises ArgumentError if the fit failed."""
        if self.fit.estimate is None:
            raise ArgumentError(f"the fit failed and has no estimate: {self.fit.message}")
        return self.fit.estimate


def hand_eye(
    pictures: RobotPictures,
    camera: CameraStart,
    estimate: list[Estimated] | None = None,
    *,
    mounted: Literal["plate", "fixed"] = "plate",
    position_noise: float = 1e-4,
    turn_noise: float = 1e-4,
    loss: str = "linear",
    stop: Callable[[], bool] | None = None,
) -> HandEye:
    """Fit the pose of a camera on an arm's plate that observes a fixed target, or of a fixed camera that observes a
    target on the plate.

    pictures: of one camera; their `actuators` (N, 7) are the poses of the arm from its controller: x, y, z [m] and the
    quaternion of the plate, scalar first. camera: the lens as known beforehand. estimate: estimated parts of the lens,
    none if left out. position_noise [m], turn_noise [rad]: standard deviations of the arm poses, which are estimated
    too and eliminated. loss: of a corner, linear or huber.

    The starting value is the closed-form solution of A X = Y B. Source: Shah 2013, "Solving the robot-world/hand-eye
    calibration problem using the Kronecker product". Raises ArgumentError for fewer than three pictures, and if the arm
    does not rotate about two axes.

    >>> V = gt.vision.robot_cameras
    >>> made = V.made_hand_eye(seed=1)
    >>> eye = V.hand_eye(made.pictures, made.cameras[0])
    >>> bool(np.abs(eye.camera[4:] - made.true_cameras[0, 13:]).max() < 1e-3)
    True
    """
    p = pictures
    if len(p.cameras) != 1 or np.shape(p.actuators)[1:] != (7,):
        raise ArgumentError(
            f"found {len(p.cameras)} cameras and poses {np.shape(p.actuators)}; expected one and (N, 7)", "pictures"
        )
    poses = p.actuators.copy()
    length = np.linalg.norm(poses[:, 3:], axis=1)
    if np.any(np.abs(length - 1) > 1e-3):
        raise ArgumentError("the quaternions of the poses are not unit quaternions", "pictures")
    poses[:, 3:] /= length[:, None]
    lens = np.array(camera.start)
    on_tool = mounted == "fixed"
    carried, standing = _started(p, poses, lens, on_tool)
    camera_pose, target = (standing, carried) if on_tool else (carried, standing)
    held = {n for group, entries in INTRINSICS.items() if group not in (estimate or []) for n in entries}
    fixed = [n in held or n == "k3" for n in (*CAMERA[:TURN], *["turn"] * 3, *CAMERA[13:])]
    groups = [
        UnknownGroup("camera", np.concatenate([lens, camera_pose])[None], CAMERA, ["camera"], turn=TURN, fixed=fixed,
                     units=CAMERA_UNITS),
        UnknownGroup("target", np.concatenate([target, [1.0]])[None], TARGET, turn=0, fixed=[False] * 6 + [True],
                     units=("rad",) * 3 + ("m",) * 3 + ("1",)),
        UnknownGroup("pose", poses, POSE, [f"pose {k}" for k in p.poses], turn=3, local=True),
    ]  # fmt: skip
    blocks = [
        ResidualBlock("corners", corner_function(7, on_tool), [("camera", 0), ("target", 0), ("pose", p.pose)],
                      np.column_stack([p.target[p.mark], p.uv]), sigma=p.sigma, loss=loss, width=HUBER),
        ResidualBlock("arm", _arm_function(), [("pose", np.arange(len(poses)))], poses,
                      sigma=np.tile([position_noise] * 3 + [turn_noise] * 3, (len(poses), 1))),
    ]  # fmt: skip
    fit = bundle_fit(groups, blocks, stop=stop)
    return HandEye(fit, fit.values["camera"][0, TURN:], fit.values["target"][0, :7], fit.residuals["corners"])


def _arm_function() -> ca.Function:
    """Return the function (pose, data) -> deviation from the controller's pose: position [m], and rotation [rad] in the
    frame of the plate."""
    z, d = ca.SX.sym("z", 7), ca.SX.sym("d", 7)
    turn = 2 * product(conjugate(d[3:]), z[3:])[1:]
    return ca.Function("arm", [z, d], [ca.vertcat(z[:3] - d[:3], turn)])


def _started(p: RobotPictures, poses: np.ndarray, lens: np.ndarray, on_tool: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return X (7,) on the plate and Y (7,) in the base with A X = Y B, for arm poses A and poses B from pictures."""
    views, rows = list[np.ndarray](), list[int]()
    for k in range(len(poses)):
        corners = p.pose == k
        if corners.sum() >= 4:
            views.append(board_pose(p.target[p.mark[corners]], p.uv[corners], lens))
            rows.append(k)
    if len(rows) < LEAST:
        raise ArgumentError(f"{len(rows)} pictures show at least four marks; expected at least {LEAST}", "pictures")
    B = np.array(views) if on_tool else inverse_poses(np.array(views))
    A = np.column_stack([poses[rows, 3:], poses[rows, :3]])
    RA, RB = matrices_of(A), matrices_of(B)
    axes = logarithm(quaternion_of(RA[0].T @ RA[1:]))  # rotation vectors from the first to the others
    if np.linalg.svd(axes, compute_uv=False)[1] < ALIKE:
        raise ArgumentError(
            "between the pictures the arm rotates about at most one axis, and the position along this axis is "
            "undetermined; rotate about two axes, by 20 degrees or more",
            "pictures",
        )
    # least-squares solution of R_A X = Y R_B over all pictures
    eye = np.eye(3)
    M = np.concatenate([np.hstack([np.kron(a, eye), -np.kron(eye, b.T)]) for a, b in zip(RA, RB, strict=True)])
    v = np.linalg.svd(M)[2][-1]
    X, Y = v[:9].reshape(3, 3), v[9:].reshape(3, 3)
    sign = np.sign(np.linalg.det(X))
    turns = matrices_of(poses_of(np.stack([sign * X, sign * Y]), np.zeros((2, 3))))
    J = np.concatenate([np.hstack([a, -eye]) for a in RA])
    rhs = (np.einsum("ij,nj->ni", turns[1], B[:, 4:]) - A[:, 4:]).reshape(-1)
    t = np.linalg.lstsq(J, rhs, rcond=None)[0]
    out = poses_of(turns, t.reshape(2, 3))
    return out[0], out[1]
