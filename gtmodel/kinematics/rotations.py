"""Angles of rotation matrices, many at once: ZYZ, and rotation vectors from a reference. All in rad."""

from __future__ import annotations

from typing import Any

import numpy as np

# below this sine of the second angle ZYZ keeps fewer than ten digits of the other two: round-off over the sine
SINGULAR_SINE = 1e-6
# below this sine of a turn near pi its skew part is round-off and cannot tell the axis
HALF_TURN_SINE = 1e-12


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

    beta is in [0, pi], alpha and gamma within pi of those in `about` (3,), zero by default: a reference keeps a small
    range from being torn apart at +-pi. Singular at beta = 0 and pi: there only alpha + gamma or alpha - gamma is
    determined; gamma is set to 0 and the row is flagged (sin beta < 1e-6).

    Raises ValueError for a shape that is no orientation. Rows that are not finite become NaN, unflagged.
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
    two axes: within round-off of it the one is taken whose first component that is not zero is positive. `reference` is
    one orientation. Raises ValueError for a shape that is no orientation.
    """
    D = matrices(orientation) @ matrices(reference).T
    twice = np.stack([D[..., 2, 1] - D[..., 1, 2], D[..., 0, 2] - D[..., 2, 0], D[..., 1, 0] - D[..., 0, 1]], axis=-1)
    sine = np.linalg.norm(twice, axis=-1) / 2
    angle = np.arctan2(sine, (np.trace(D, axis1=-2, axis2=-1) - 1) / 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.where(sine > 0, angle / (2 * sine), 0.5)  # angle / sine -> 1 at no turn
    half = (sine < HALF_TURN_SINE) & (angle > 1.0)
    return np.where(half[..., None], angle[..., None] * _half_turn_axis(D), factor[..., None] * twice)


def _half_turn_axis(D: np.ndarray) -> np.ndarray:
    """Unit axes (..., 3) of half turns D = 2 a a' - 1: the longest column of D + 1, first component positive."""
    S = D + np.swapaxes(D, -1, -2) + 2.0 * np.eye(3)
    longest = np.argmax(np.diagonal(S, axis1=-2, axis2=-1), axis=-1)
    column = np.take_along_axis(S, longest[..., None, None], axis=-1)[..., 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        axis = column / np.linalg.norm(column, axis=-1, keepdims=True)
    there = np.abs(axis) > HALF_TURN_SINE
    first = np.take_along_axis(axis, np.argmax(there, axis=-1)[..., None], axis=-1)
    return np.where(first < 0, -axis, axis)
