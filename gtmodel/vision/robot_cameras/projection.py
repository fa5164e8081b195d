"""Residual functions of the bundle: corners, second device, and the closure equations of the robot as functions of its
free parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from ...calibrate.closure import Closure, closure_equations
from ...calibrate.options import Choice
from ...calibrate.unknowns import Parameters, Unknowns, unknowns
from ...compiler.causal import compile_causal, flat_of
from ...compiler.rows import map_columns
from ...geometry.pinhole import LENS, pixel
from ...geometry.quaternions import quaternion_matrix
from ...lang.model import Model
from ...results.refusal import ArgumentError

CAMERA = (*LENS, "qw", "qx", "qy", "qz", "x", "y", "z")
TARGET = ("qw", "qx", "qy", "qz", "x", "y", "z", "scale")
TURN = 9  # index of the first entry of a camera's quaternion


def seen(camera: ca.SX, X: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return u, v [pixel] of a point, and margins that are positive if the camera model is valid: in front of the
    camera, and within the radius at which the lens folds the picture over."""
    return pixel(quaternion_matrix(camera[TURN : TURN + 4]).T @ (X - camera[13:16]), camera[:TURN])


def mark(target: ca.SX, pose: ca.SX, p: ca.SX, on_tool: bool) -> ca.SX:
    """Return a mark in the frame that carries the cameras: the base if the target is on the tool, else the tool."""
    m = target[4:7] + target[7] * (quaternion_matrix(target[:4]) @ p)
    T = pose[:3]
    if pose.numel() == 3:
        return T + m if on_tool else m - T
    R = quaternion_matrix(pose[3:])
    return T + R @ m if on_tool else R.T @ (m - T)


def corner_function(pose_size: int, on_tool: bool) -> ca.Function:
    """Return (camera, target, pose, data) -> predicted minus measured [pixel], and margins; data: mark (3), u, v."""
    c, t, z, d = (ca.SX.sym(n, k) for n, k in (("c", 16), ("t", 8), ("z", pose_size), ("d", 5)))
    uv, margin = seen(c, mark(t, z, d[:3], on_tool))
    return ca.Function("corners", [c, t, z, d], [uv - d[3:], margin])


def device_function(pose_size: int) -> ca.Function:
    """Return (device frame, pose, data) -> predicted minus measured position in the device's frame [m]; data: (3)."""
    f, z, d = ca.SX.sym("f", 7), ca.SX.sym("z", pose_size), ca.SX.sym("d", 3)
    return ca.Function("device", [f, z, d], [quaternion_matrix(f[:4]).T @ (z[:3] - f[4:]) - d])


def links_function(residual: ca.Function, noise: float, late: bool = False) -> ca.Function:
    """Return (robot, pose, data) -> length errors, whitened for the noise [m] of the actuators; data: actuators.

    If `late`: (robot, clock, pose, data) with the delay [s] and, in the data, the actuator rates. The whitening depends
    on the parameters, so that these residuals do not change if all lengths grow by one factor.
    """
    x, z, q = (ca.SX.sym(n, residual.size1_in(k)) for k, n in enumerate("xzq"))
    delay, rate = ca.SX.sym("delay"), ca.SX.sym("rate", q.numel())
    r = ca.SX(residual(x, z, q + delay * rate if late else q))
    by_q = ca.densify(noise * ca.jacobian(r, q))
    R = ca.chol(ca.densify(by_q @ by_q.T))
    white = list[ca.SX]()  # R' white = r, row by row
    for i in range(r.numel()):
        white.append((r[i] - sum((R[j, i] * white[j] for j in range(i)), ca.SX(0))) / R[i, i])
    inputs = [x, delay, z, ca.vertcat(q, rate)] if late else [x, z, q]
    return ca.Function("links", inputs, [ca.vertcat(*white)], {"cse": True})


ROUNDS, ARRIVED = 40, 1e-12  # of Newton's method; m and rad
SINGULAR = 1e-6  # smallest singular value of normalised rows


@dataclass(frozen=True, eq=False)
class RobotLinks:
    """Length errors of a robot's links as a function of its free parameters, its pose and its actuators.

    `pose`: variables of the end-effector, the position first, then a quaternion if it rotates; `unknowns`: the free
    parameters; `residual`: (parameters, pose, actuators) -> length errors [m].
    """

    robot: Model
    actuators: str
    pose: tuple[str, ...]
    closure: Closure
    unknowns: Unknowns
    residual: ca.Function
    made: dict[int, ca.Function] = field(default_factory=dict, repr=False)

    @property
    def turns(self) -> bool:
        """Whether the end-effector rotates."""
        return len(self.pose) > 1

    @property
    def pose_size(self) -> int:
        """Number of entries of a pose."""
        return 7 if self.turns else 3

    @cached_property
    def slopes(self) -> ca.Function:
        """Length errors with their Jacobians with respect to parameters, pose and actuators."""
        x, z, q = (ca.SX.sym(f"a{k}", self.residual.size1_in(k)) for k in range(3))
        r = self.residual(x, z, q)
        return ca.Function("slopes", [x, z, q], [r, *(ca.densify(ca.jacobian(r, s)) for s in (x, z, q))], {"cse": True})

    def at(self, x: np.ndarray, poses: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return length errors (n, m) and Jacobians (n, m, .) at parameters (k,) or (n, k)."""
        n = len(q)
        x = np.broadcast_to(x, (n, np.shape(x)[-1]))
        out = map_columns(self.slopes, [x.T, poses.T, q.T], self.made)
        m = out[0].shape[0]
        return tuple([out[0].T, *(o.T.reshape(n, -1, m).transpose(0, 2, 1) for o in out[1:])])

    def forward(self, x: np.ndarray, q: np.ndarray, near: np.ndarray) -> np.ndarray:
        """Solve the closure equations for the poses (n, pose) by Newton's method from `near`; NaN without a solution.

        The steps of a quaternion keep its length to first order, and it is normalised after each step.
        """
        z = np.array(np.broadcast_to(near, (len(q), self.pose_size)), float)
        size = np.full(len(q), np.inf)
        with np.errstate(all="ignore"):
            for _ in range(ROUNDS):
                r, _, B, _ = self.at(x, z, q)
                if self.turns:
                    unit = np.concatenate([np.zeros((len(z), 1, 3)), z[:, None, 3:]], axis=2)
                    B, r = np.concatenate([B, unit], axis=1), np.concatenate([r, np.zeros((len(z), 1))], axis=1)
                bad = ~np.isfinite(B).all(axis=(1, 2)) | (np.abs(np.linalg.det(np.nan_to_num(B))) < 1e-12)
                B[bad] = np.eye(B.shape[1])
                step = np.linalg.solve(B, r[..., None])[..., 0]
                step[bad] = np.nan
                z = z - step
                if self.turns:
                    z[:, 3:] /= np.linalg.norm(z[:, 3:], axis=1, keepdims=True)
                size = np.abs(step).max(axis=1)
                if np.all((size < ARRIVED) | np.isnan(size)):
                    break
        z[~(size < 1e-9)] = np.nan
        return z

    def start(self, q: np.ndarray) -> np.ndarray:
        """Return the poses (n, pose) of the uncalibrated robot at q. Raises ArgumentError if a row has no pose."""
        forward = compile_causal(self.robot, known=[self.actuators], targets=list(self.pose))
        *parts, status = forward(q)
        unsolved = np.flatnonzero(np.asarray(status) != 0)
        if len(unsolved):
            raise ArgumentError(
                f"the uncalibrated robot has no pose for actuator row {unsolved[0] + 1}; check units and columns",
                self.actuators,
            )
        return np.concatenate([np.asarray(p).reshape(len(q), -1) for p in parts], axis=1)

    def require_all_links(self, x: np.ndarray, poses: np.ndarray, q: np.ndarray, noise: float) -> None:
        """Raise ArgumentError if a combination of closure equations does not depend on the actuators."""
        _, _, _, by_q = self.at(x, poses, q)
        by_q = by_q / np.maximum(np.linalg.norm(by_q, axis=2, keepdims=True), 1e-12)
        least = np.linalg.svd(by_q, compute_uv=False)[:, -1] if by_q.shape[1] <= by_q.shape[2] else np.zeros(1)
        if not noise > 0 or not np.all(least > SINGULAR):
            raise ArgumentError(
                "at some pose a closure equation does not depend on the measured actuators and has no noise: an "
                "actuator is not measured, or the pose is singular",
                "actuator_noise",
            )


def robot_side(robot: Model, choice: Choice, actuators: str = "q", pose: Sequence[str] = ()) -> RobotLinks:
    """Return the closure equations of a robot with a known pose. Raises ArgumentError and ModelError."""
    flat = flat_of(robot)
    pose = tuple(pose) or tuple(n for n in ("T", "e") if n in flat.groups)
    missing = [n for n in (actuators, *pose) if n not in flat.groups]
    if missing or not pose:
        raise ArgumentError(
            f"the robot has no variable '{missing[0] if missing else 'T'}'; expected actuators q and a pose T", "robot"
        )
    closure = closure_equations(flat, known=[actuators, *pose])
    u = unknowns(Parameters.of(flat, closure.touched), choice)
    (lengths,) = u.substituted([closure.lengths])
    z = ca.vertcat(*[closure.symbols[n] for n in pose])
    residual = ca.Function("lengths", [u.x, z, closure.symbols[actuators]], [lengths], {"cse": True})
    return RobotLinks(robot, actuators, pose, closure, u, residual)
