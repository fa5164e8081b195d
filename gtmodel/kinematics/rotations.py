"""Angles of rotation matrices, many at once: ZYZ, and rotation vectors from a reference. All in rad."""

from __future__ import annotations

from typing import Any

import numpy as np

# below this sine of the second angle ZYZ keeps fewer than ten digits of the other two: round-off over the sine
SINGULAR_SINE = 1e-6
# below this cosine of half the angle the sense of a turn is round-off
HALF_TURN = 1e-15


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
        a, b, c, d = np.moveaxis(o / np.linalg.norm(o, axis=-1, keepdims=True), -1, 0)
    rows = [
        [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (a * c + b * d)],
        [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
        [2 * (b * d - a * c), 2 * (a * b + c * d), a * a - b * b - c * c + d * d],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


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
    scalar, vector = _quaternions(matrices(orientation) @ matrices(reference).T)
    length = np.linalg.norm(vector, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.where(length > 0, 2 * np.arctan2(length, scalar) / length, 2.0)  # -> 2 at no turn
    return factor[..., None] * vector


def _quaternions(D: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scalar (...), not negative, and vector (..., 3) of unit quaternions, from the largest of their components: all
    four to round-off at any angle. Of half turns the first component of the vector that is not zero is positive."""
    diagonal = np.diagonal(D, axis1=-2, axis2=-1)
    trace = diagonal.sum(axis=-1)
    skew = np.stack([D[..., 2, 1] - D[..., 1, 2], D[..., 0, 2] - D[..., 2, 0], D[..., 1, 0] - D[..., 0, 1]], axis=-1)
    # four times the quaternion by each of its components
    Q = np.empty((*D.shape[:-2], 4, 4))
    Q[..., 0, 0], Q[..., 0, 1:], Q[..., 1:, 0] = 1 + trace, skew, skew
    Q[..., 1:, 1:] = D + np.swapaxes(D, -1, -2) + (1 - trace)[..., None, None] * np.eye(3)
    largest = np.argmax(np.diagonal(Q, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(Q, largest[..., None, None], axis=-2)[..., 0, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    half = np.abs(q[..., 0]) < HALF_TURN
    q[..., 0] = np.where(half, 0.0, q[..., 0])
    there = np.abs(q[..., 1:]) > HALF_TURN
    first = np.take_along_axis(q[..., 1:], np.argmax(there, axis=-1)[..., None], axis=-1)[..., 0]
    q = np.where((np.where(half, first, q[..., 0]) < 0)[..., None], -q, q)
    return q[..., 0], q[..., 1:]
