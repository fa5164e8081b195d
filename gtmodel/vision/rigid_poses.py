"""Poses as seven numbers: a unit quaternion, scalar first, and a translation; p_outer = R(q) p_own + t."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..inference.bundle.unknown_group import UnknownGroup, rotation_vectors

POSE = ("qw", "qx", "qy", "qz", "x", "y", "z")
POSE_UNITS = ("rad", "rad", "rad", "m", "m", "m")


def matrices_of(poses: np.ndarray) -> np.ndarray:
    """Rotations (n, 3, 3) of poses (n, 7)."""
    w, x, y, z = np.asarray(poses, float)[:, :4].T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=1,
    )


def poses_of(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Poses (n, 7) of rotations (n, 3, 3), projected on proper ones, and translations (n, 3)."""
    U, _, Vt = np.linalg.svd(R)
    sign = np.ones((len(R), 3))
    sign[:, 2] = np.sign(np.linalg.det(U @ Vt))
    R = (U * sign[:, None, :]) @ Vt
    # the eigenvector of the largest eigenvalue: well-conditioned for all rotations (Bar-Itzhack 2000)
    K = np.zeros((len(R), 4, 4))
    K[:, 0, 0] = np.trace(R, axis1=1, axis2=2)
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=-1)
    K[:, 0, 1:] = K[:, 1:, 0] = axis
    K[:, 1:, 1:] = R + R.transpose(0, 2, 1) - K[:, :1, :1] * np.eye(3)
    q = np.linalg.eigh(K)[1][:, :, -1]
    return np.hstack([np.where(q[:, :1] < 0, -q, q), t])


def composed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """First b, then a: poses (n, 7)."""
    Ra = matrices_of(a)
    return poses_of(Ra @ matrices_of(b), np.einsum("nij,nj->ni", Ra, b[:, 4:]) + a[:, 4:])


def inverse_poses(a: np.ndarray) -> np.ndarray:
    """Poses (n, 7) that undo a."""
    R = matrices_of(a).transpose(0, 2, 1)
    return poses_of(R, -np.einsum("nij,nj->ni", R, a[:, 4:]))


def applied(pose: ca.SX, p: ca.SX) -> ca.SX:
    """R(q) p + t of symbols."""
    q, twice = pose[:4], 2 * ca.cross(pose[1:4], p)
    return p + q[0] * twice + ca.cross(q[1:], twice) + pose[4:7]


def pose_group(name: str, poses: np.ndarray, keys: tuple[str, ...] = (), *, local: bool = False,
               fixed: np.ndarray | None = None) -> UnknownGroup:  # fmt: skip
    """Poses (n, 7) as unknowns of a bundle."""
    return UnknownGroup(name, poses, POSE, keys=keys, turn=0, local=local, fixed=fixed, units=POSE_UNITS)


__all__ = [
    "POSE", "applied", "composed", "inverse_poses", "matrices_of", "pose_group", "poses_of", "rotation_vectors",
]  # fmt: skip
