"""Rotations of URDF: roll, pitch and yaw about fixed axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

Array = np.ndarray
X, Y, Z = np.eye(3)


def rotation_of_rpy(rpy: ArrayLike) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll), (3, 3)."""
    roll, pitch, yaw = (float(x) for x in np.asarray(rpy, float))
    return np.asarray(_about(Z, yaw) @ _about(Y, pitch) @ _about(X, roll))


def rpy_of_rotation(R: Array) -> Array:
    """Roll, pitch, yaw (3,) of a rotation; at a pitch of 90 degrees, where only their difference counts, yaw is 0."""
    yaw = float(np.arctan2(R[1, 0], R[0, 0])) if np.hypot(R[0, 0], R[1, 0]) > 1e-12 else 0.0
    rest = _about(Z, -yaw) @ R
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw])


def _about(axis: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return c * (np.eye(3) - np.outer(axis, axis)) + s * cross + np.outer(axis, axis)
