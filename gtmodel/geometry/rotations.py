"""Cross matrices and rotation matrices; each rotation takes frame coordinates to those the frame is given in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .entries import entries, is_column, matrix, vector

UNIT = np.eye(3)
SMALL = 1e-2  # rad: below it the Jacobians of rotation vectors are their series, to round-off


def cross_matrix(v: Any) -> Any:
    """The matrix (..., 3, 3) that gives v x b for any b; v (..., 3)."""
    if isinstance(v, np.ndarray) and v.ndim > 1:
        K = np.zeros((*v.shape, 3))
        K[..., 0, 1], K[..., 1, 2], K[..., 2, 0] = -v[..., 2], -v[..., 0], -v[..., 1]
        return K - np.swapaxes(K, -1, -2)
    x, y, z = entries(v)
    return matrix([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_about(axis: Any, angle: Any) -> Any:
    """Rodrigues' formula, (..., 3, 3): rotation by `angle` [rad] about `axis` (..., 3), which must have length 1."""
    c, s = np.cos(angle), np.sin(angle)
    if is_column(axis):
        dyad = axis @ axis.T
    elif isinstance(axis, (np.ndarray, list, tuple)):
        axis = np.asarray(axis)
        dyad = axis[..., :, None] * axis[..., None, :]
        if isinstance(angle, np.ndarray):
            c, s = c[..., None, None], s[..., None, None]
    else:
        dyad = vector([axis[i] * axis for i in range(3)])
    return c * (UNIT - dyad) + s * cross_matrix(axis) + dyad


def rotation_by(vector: ArrayLike) -> np.ndarray:
    """Rotations (..., 3, 3) by rotation vectors (..., 3) [rad]."""
    import scipy

    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(np.asarray(vector, float)).as_matrix())


def shortest_rotation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The smallest rotation (3, 3) that takes the unit vector a to b, which is not -a."""
    k = cross_matrix(np.cross(a, b))
    return UNIT + k + k @ k / (1.0 + a @ b)


def right_handed(direction: ArrayLike) -> np.ndarray:
    """Orthonormal rows (3, 3): along a direction, across it and the axis that lies least along it, across both."""
    v = np.asarray(direction, float)
    n = v / np.linalg.norm(v)
    second = np.cross(n, UNIT[int(np.argmin(np.abs(n)))])
    second /= np.linalg.norm(second)
    return np.array([n, second, np.cross(n, second)])


def angle_between(R: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Angle [rad] of the rotations between R (..., 3, 3) and S (..., 3, 3); accurate near zero too."""
    return 2 * np.arcsin(np.minimum(np.linalg.norm(R - S, axis=(-2, -1)) / np.sqrt(8), 1.0))


def left_jacobian(v: np.ndarray) -> np.ndarray:
    """d log(exp(v + d) exp(-v)) / dd at d = 0, (n, 3, 3) for rotation vectors (n, 3)."""
    square, near, angle = _small(v)
    first = np.where(near, 0.5 - square / 24 * (1 - square / 30), (1 - np.cos(angle)) / angle**2)
    second = np.where(near, 1 / 6 - square / 120, (angle - np.sin(angle)) / angle**3)
    return _polynomial(v, square, first[:, None, None], second)


def inverse_right_jacobian(v: np.ndarray) -> np.ndarray:
    """d log(exp(v) exp(d)) / dd at d = 0, (n, 3, 3) for rotation vectors (n, 3) shorter than a whole turn."""
    square, near, angle = _small(v)
    second = np.where(near, 1 / 12 + square / 720, (1 - angle / 2 / np.tan(angle / 2)) / angle**2)
    return _polynomial(v, square, 0.5, second)


def _small(v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Squares of angles (n,), whether these are small, and angles, 1 for small ones."""
    square = np.einsum("nk,nk->n", v, v)
    near = square < SMALL**2
    return square, near, np.sqrt(np.where(near, 1.0, square))


def _polynomial(v: np.ndarray, square: np.ndarray, first: Any, second: np.ndarray) -> np.ndarray:
    """1 + first K + second K K, (n, 3, 3), of cross matrices K; K K = v v' - |v|^2."""
    dyad = (second[:, None] * v)[:, :, None] * v[:, None, :]
    return first * cross_matrix(v) + dyad + (1 - second * square)[:, None, None] * UNIT
