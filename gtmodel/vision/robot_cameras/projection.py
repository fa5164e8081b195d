"""The bundle's functions: a corner, a robot's links and a second device, of cameras, target and pose."""

from __future__ import annotations

import casadi as ca

from ...geometry.pinhole import LENS, pixel
from ...geometry.quaternions import quaternion_matrix

CAMERA = (*LENS, "qw", "qx", "qy", "qz", "x", "y", "z")
TARGET = ("qw", "qx", "qy", "qz", "x", "y", "z", "scale")
TURN = 9  # where a camera's quaternion begins


def seen(camera: ca.SX, X: ca.SX) -> tuple[ca.SX, ca.SX]:
    """u, v [pixel] of a point, and margins that are positive where the camera's model holds: in front of it, and within
    the radius at which the lens folds the picture over."""
    return pixel(quaternion_matrix(camera[TURN : TURN + 4]).T @ (X - camera[13:16]), camera[:TURN])


def mark(target: ca.SX, pose: ca.SX, p: ca.SX, on_tool: bool) -> ca.SX:
    """A mark where cameras are: of a target on the tool, in the base; of one that stands, in the tool's frame."""
    own = target[4:7] + target[7] * (quaternion_matrix(target[:4]) @ p)
    T = pose[:3]
    if pose.numel() == 3:
        return T + own if on_tool else own - T
    R = quaternion_matrix(pose[3:])
    return T + R @ own if on_tool else R.T @ (own - T)


def corner_function(pose_size: int, on_tool: bool) -> ca.Function:
    """(camera, target, pose, data) -> seen less measured [pixel], with margins; data: the mark (3), u, v."""
    c, t, z, d = (ca.SX.sym(n, k) for n, k in (("c", 16), ("t", 8), ("z", pose_size), ("d", 5)))
    uv, margin = seen(c, mark(t, z, d[:3], on_tool))
    return ca.Function("corners", [c, t, z, d], [uv - d[3:], margin])


def device_function(pose_size: int) -> ca.Function:
    """(device frame, pose, data) -> position less measured, in the device's frame [m]; data: what was measured (3)."""
    f, z, d = ca.SX.sym("f", 7), ca.SX.sym("z", pose_size), ca.SX.sym("d", 3)
    return ca.Function("device", [f, z, d], [quaternion_matrix(f[:4]).T @ (z[:3] - f[4:]) - d])


def links_function(residual: ca.Function, noise: float, late: bool = False) -> ca.Function:
    """(robot, pose, data) -> length errors made white for noise [m] of the actuators, which are the data; where the
    cameras are `late` (robot, clock, pose, data) with the delay [s] and the actuators' rates behind them.

    The whitening moves with the parameters, so that these rows see no common growth of all lengths.
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
