"""Angles of rotations, many at once: ZYZ, roll pitch yaw, and rotation vectors from a reference. All in rad."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .quaternions import logarithm, quaternion_matrix, quaternion_of
from .rotations import rotation_about

# below this sine of the second angle ZYZ keeps fewer than ten digits of the other two: round-off over the sine
SINGULAR_SINE = 1e-6
X, Y, Z = np.eye(3)


def matrices(orientation: Any) -> np.ndarray:
    """Rotation matrices (..., 3, 3) from matrices or quaternions (..., 4), scalar first, of any length but zero.

    Raises ValueError for another shape. Rows that are not finite, and zero quaternions, become NaN.
    """
    o = np.asarray(orientation, dtype=float)
    if o.ndim >= 2 and o.shape[-2:] == (3, 3):
        return o
    if o.ndim < 1 or o.shape[-1] != 4:
        raise ValueError(f"expected quaternions (..., 4) or rotation matrices (..., 3, 3); found shape {o.shape}")
    with np.errstate(invalid="ignore", divide="ignore"):
        return quaternion_matrix(o / np.linalg.norm(o, axis=-1, keepdims=True))


def zyz(orientation: Any, about: Any = None) -> tuple[np.ndarray, np.ndarray]:
    """ZYZ Euler angles (..., 3) [rad], R = Rz(alpha) Ry(beta) Rz(gamma), and where they are singular (...).

    `orientation`: rotation matrices (..., 3, 3), or quaternions (..., 4), scalar first, of any length but zero.

    beta is in [0, pi], alpha and gamma within pi of those in `about` (3,), zero by default: a reference keeps a small
    range from being torn apart at +-pi. Singular at beta = 0 and pi: there only alpha + gamma or alpha - gamma is
    determined; gamma is set to 0 and the row is flagged (sin beta < 1e-6).

    Raises ValueError for a shape that is no orientation. Rows that are not finite become NaN, unflagged.

    >>> angle = np.radians(30.0)
    >>> angles, singular = gt.kinematics.zyz([np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0])  # about y
    >>> np.degrees(angles).round(6), singular
    (array([ 0., 30.,  0.]), np.False_)
    >>> gt.kinematics.zyz(np.eye(3))[1]  # beta = 0
    np.True_
    """
    R = matrices(orientation)
    sine = np.hypot(R[..., 0, 2], R[..., 1, 2])
    beta = np.arctan2(sine, R[..., 2, 2])
    singular = sine < SINGULAR_SINE
    flip = np.where(R[..., 2, 2] < 0, -1.0, 1.0)
    alone = np.arctan2(flip * R[..., 1, 0], flip * R[..., 0, 0])
    alpha = np.where(singular, alone, np.arctan2(R[..., 1, 2], R[..., 0, 2]))
    gamma = np.where(singular, 0.0, np.arctan2(R[..., 2, 1], -R[..., 2, 0]))
    gamma = np.where(np.isnan(alpha), np.nan, gamma)
    angles = np.stack([alpha, beta, gamma], axis=-1)
    if about is not None:
        turn = 2 * np.pi * np.array([1.0, 0.0, 1.0])
        angles = angles - turn * np.round((angles - np.asarray(about, dtype=float)) / (2 * np.pi))
    return angles, singular


def rotation_vector(orientation: Any, reference: Any) -> np.ndarray:
    """Rotation vectors (..., 3) [rad], world coordinates, that turn the reference into each orientation.

    Nowhere singular for turns below pi; for small ones the three numbers are turns about x, y and z. A half turn has
    two axes: within round-off of it the one is taken whose first component that is not zero is positive. Orientations
    are matrices (..., 3, 3) or quaternions (..., 4), scalar first; `reference` is a single one. Raises ValueError for a
    shape that is no orientation.

    >>> angle = np.radians(30.0)
    >>> turned = [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]  # about z
    >>> np.degrees(gt.kinematics.rotation_vector(turned, np.eye(3))).round(6)
    array([ 0.,  0., 30.])
    """
    return logarithm(quaternion_of(matrices(orientation) @ matrices(reference).T))


def rotation_of_rpy(rpy: ArrayLike) -> np.ndarray:
    """Rz(yaw) Ry(pitch) Rx(roll), (3, 3): rotations about fixed axes, as URDF has them."""
    roll, pitch, yaw = (float(x) for x in np.asarray(rpy, float))
    return np.asarray(rotation_about(Z, yaw) @ rotation_about(Y, pitch) @ rotation_about(X, roll))


def rpy_of_rotation(R: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw (3,) of a rotation; at a pitch of 90 degrees, where only their difference counts, yaw is 0."""
    yaw = float(np.arctan2(R[1, 0], R[0, 0])) if np.hypot(R[0, 0], R[1, 0]) > 1e-12 else 0.0
    rest = rotation_about(Z, -yaw) @ R
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw])
