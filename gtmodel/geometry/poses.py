"""Poses as seven numbers: a unit quaternion, scalar first, and a translation; p_outer = R(q) p_own + t."""

from __future__ import annotations

import numpy as np

from .quaternions import quaternion_matrix, quaternion_of


def matrices_of(poses: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) of poses (n, 7)."""
    return quaternion_matrix(np.asarray(poses, float)[:, :4])


def poses_of(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Poses (n, 7) of rotations (n, 3, 3), projected on proper ones, and translations (n, 3)."""
    U, _, Vt = np.linalg.svd(R)
    sign = np.ones((len(R), 3))
    sign[:, 2] = np.sign(np.linalg.det(U @ Vt))
    return np.hstack([quaternion_of((U * sign[:, None, :]) @ Vt), t])


def composed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """First b, then a: poses (n, 7)."""
    Ra = matrices_of(a)
    return poses_of(Ra @ matrices_of(b), np.einsum("nij,nj->ni", Ra, b[:, 4:]) + a[:, 4:])


def inverse_poses(a: np.ndarray) -> np.ndarray:
    """Poses (n, 7) that undo a."""
    R = matrices_of(a).transpose(0, 2, 1)
    return poses_of(R, -np.einsum("nij,nj->ni", R, a[:, 4:]))
