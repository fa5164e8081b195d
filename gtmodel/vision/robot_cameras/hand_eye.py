"""Where a camera sits on an arm, or beside it: hand-eye calibration as a bundle of pixels and the arm's poses."""

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
ALIKE = 0.05  # rad: turns between pictures that say little of where the camera is


@dataclass(frozen=True, eq=False)
class HandEye:
    """`camera` (7,) and `target` (7,): quaternion scalar first and place [m] of each on what carries it, the arm's
    plate or its base. `estimate`: of these, named "camera.x", "target.turn_x" ..., and of the lens. `residuals` (n, 2)
    [pixel].
    """

    fit: BundleFit
    camera: np.ndarray
    target: np.ndarray
    residuals: np.ndarray

    @property
    def estimate(self) -> Estimate:
        """Raises ArgumentError unless solved."""
        if self.fit.estimate is None:
            raise ArgumentError(f"a fit that is not solved has no estimate: {self.fit.message}")
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
    """Place of a camera on an arm's plate that looks at a standing target, or of one that stands and looks at it.

    pictures: of one camera; their `actuators` (N, 7) are the arm's poses as its controller says them, x, y, z [m] and
    the quaternion of the plate, scalar first. camera: the lens as known before. estimate: what of the lens is
    estimated, nothing if left out. position_noise [m], turn_noise [rad]: of the arm's poses, each of which is
    estimated within them and eliminated. loss: of a corner, linear or huber.

    It starts from A X = Y B in closed form. Source: Shah 2013, "Solving the robot-world/hand-eye calibration problem
    using the Kronecker product". Raises ArgumentError for fewer than three pictures, and for turns that leave the place
    open.

    >>> V = gt.vision.robot_cameras
    >>> made = V.made_hand_eye(seed=1)
    >>> eye = V.hand_eye(made.pictures, made.cameras[0])
    >>> bool(np.abs(eye.camera[4:] - made.true_cameras[0, 13:]).max() < 1e-3)
    True
    """
    p = pictures
    if len(p.cameras) != 1 or np.shape(p.actuators)[1:] != (7,):
        raise ArgumentError(
            f"expected one camera and poses (N, 7); found {len(p.cameras)} and {np.shape(p.actuators)}", "pictures"
        )
    poses = p.actuators.copy()
    length = np.linalg.norm(poses[:, 3:], axis=1)
    if np.any(np.abs(length - 1) > 1e-3):
        raise ArgumentError("the quaternions of the poses are not of length one", "pictures")
    poses[:, 3:] /= length[:, None]
    lens = np.array(camera.start)
    on_tool = mounted == "fixed"
    carried, standing = _started(p, poses, lens, on_tool)
    own, target = (standing, carried) if on_tool else (carried, standing)
    held = {n for group, entries in INTRINSICS.items() if group not in (estimate or []) for n in entries}
    fixed = [n in held or n == "k3" for n in (*CAMERA[:TURN], *["turn"] * 3, *CAMERA[13:])]
    groups = [
        UnknownGroup("camera", np.concatenate([lens, own])[None], CAMERA, ["camera"], turn=TURN, fixed=fixed,
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
    """(pose, data) -> pose less what the controller says: place [m], and turn [rad] in the plate's frame."""
    z, d = ca.SX.sym("z", 7), ca.SX.sym("d", 7)
    turn = 2 * product(conjugate(d[3:]), z[3:])[1:]
    return ca.Function("arm", [z, d], [ca.vertcat(z[:3] - d[:3], turn)])


def _started(p: RobotPictures, poses: np.ndarray, lens: np.ndarray, on_tool: bool) -> tuple[np.ndarray, np.ndarray]:
    """X (7,) on the plate and Y (7,) in the base with A X = Y B for the arm's poses A and what the pictures say, B."""
    seen, rows = list[np.ndarray](), list[int]()
    for k in range(len(poses)):
        own = p.pose == k
        if own.sum() >= 4:
            seen.append(board_pose(p.target[p.mark[own]], p.uv[own], lens))
            rows.append(k)
    if len(rows) < LEAST:
        raise ArgumentError(f"{len(rows)} pictures show four marks or more; expected {LEAST}", "pictures")
    B = np.array(seen) if on_tool else inverse_poses(np.array(seen))
    A = np.column_stack([poses[rows, 3:], poses[rows, :3]])
    RA, RB = matrices_of(A), matrices_of(B)
    axes = logarithm(quaternion_of(RA[0].T @ RA[1:]))  # rotation vectors from the first to the others
    if np.linalg.svd(axes, compute_uv=False)[1] < ALIKE:
        raise ArgumentError(
            "the arm turns about one axis at most between the pictures, which leaves the place of what it carries open "
            "along it; turn about two axes, by 20 degrees or more",
            "pictures",
        )
    # R_A X = Y R_B for all pictures: the pair that does so best
    eye = np.eye(3)
    M = np.concatenate([np.hstack([np.kron(a, eye), -np.kron(eye, b.T)]) for a, b in zip(RA, RB, strict=True)])
    v = np.linalg.svd(M)[2][-1]
    X, Y = v[:9].reshape(3, 3), v[9:].reshape(3, 3)
    sign = np.sign(np.linalg.det(X))
    turns = matrices_of(poses_of(np.stack([sign * X, sign * Y]), np.zeros((2, 3))))
    left = np.concatenate([np.hstack([a, -eye]) for a in RA])
    right = (np.einsum("ij,nj->ni", turns[1], B[:, 4:]) - A[:, 4:]).reshape(-1)
    t = np.linalg.lstsq(left, right, rcond=None)[0]
    out = poses_of(turns, t.reshape(2, 3))
    return out[0], out[1]
