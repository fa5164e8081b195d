"""Cross matrices, rotations and poses; a rotation matrix maps coordinates of a frame to those of its outer frame.

A pose is seven numbers: a unit quaternion, scalar first, and a translation; p_outer = R(q) p_own + t.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .entries import entries, is_column, matrix, vector
from .quaternions import logarithm, quaternion_matrix, quaternion_of

UNIT = np.eye(3)
X, Y, Z = UNIT
# below this sine of the second ZYZ angle the other two have fewer than ten digits: round-off over the sine
SINGULAR_SINE = 1e-6
SMALL = 1e-2  # rad: below this angle the Jacobians of rotation vectors use series, exact to round-off


def cross_matrix(v: Any) -> Any:
    """Return the matrix K (..., 3, 3) of v (..., 3) with K b = v x b.

    >>> from gtmodel.geometry.rotations import cross_matrix
    >>> cross_matrix(np.array([1.0, 0.0, 0.0])) @ [0.0, 1.0, 0.0]  # x by y is z
    array([0., 0., 1.])
    """
    if isinstance(v, np.ndarray) and v.ndim > 1:
        K = np.zeros((*v.shape, 3))
        K[..., 0, 1], K[..., 1, 2], K[..., 2, 0] = -v[..., 2], -v[..., 0], -v[..., 1]
        return K - np.swapaxes(K, -1, -2)
    x, y, z = entries(v)
    return matrix([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_about(axis: Any, angle: Any) -> Any:
    """Return the rotation (..., 3, 3) by `angle` [rad] about the unit vector `axis` (..., 3): Rodrigues' formula."""
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
    """Return rotations (..., 3, 3) by rotation vectors (..., 3) [rad]."""
    import scipy

    return np.asarray(scipy.spatial.transform.Rotation.from_rotvec(np.asarray(vector, float)).as_matrix())


def nearest_rotation(M: np.ndarray, hand: float = 1.0) -> np.ndarray:
    """Return the rotation (..., 3, 3) nearest to M (..., 3, 3), or with `hand` -1 the nearest reflection.

    Wahba's problem: for rows a (n, 3) and b (n, 3), nearest_rotation(a.T @ b) is the R that fits a = b R' best.
    """
    U, _, Vt = np.linalg.svd(M)
    U[..., 2] *= hand * np.linalg.det(U @ Vt)[..., None]
    return U @ Vt


def shortest_rotation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the smallest rotation (3, 3) from the unit vector a to the unit vector b; for b = -a one of them."""
    if a @ b <= -1.0:
        return rotation_about(right_handed(a)[2], np.pi)
    k = cross_matrix(np.cross(a, b))
    return UNIT + k + k @ k / (1.0 + a @ b)


def right_handed(direction: ArrayLike) -> np.ndarray:
    """Return orthonormal rows (3, 3): a direction, a vector perpendicular to it and to the least aligned coordinate
    axis, and their cross product."""
    v = np.asarray(direction, float)
    n = v / np.linalg.norm(v)
    second = np.cross(n, UNIT[int(np.argmin(np.abs(n)))])
    second /= np.linalg.norm(second)
    return np.array([n, second, np.cross(n, second)])


def angle_between(R: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Return the angle [rad] of the rotations between R (..., 3, 3) and S (..., 3, 3); accurate also near zero."""
    return 2 * np.arcsin(np.minimum(np.linalg.norm(R - S, axis=(-2, -1)) / np.sqrt(8), 1.0))


def left_jacobian(v: np.ndarray) -> np.ndarray:
    """Return d log(exp(v + d) exp(-v)) / dd at d = 0, (n, 3, 3), for rotation vectors (n, 3)."""
    square, near, angle = _small(v)
    first = np.where(near, 0.5 - square / 24 * (1 - square / 30), (1 - np.cos(angle)) / angle**2)
    second = np.where(near, 1 / 6 - square / 120, (angle - np.sin(angle)) / angle**3)
    return _polynomial(v, square, first[:, None, None], second)


def inverse_right_jacobian(v: np.ndarray) -> np.ndarray:
    """Return d log(exp(v) exp(d)) / dd at d = 0, (n, 3, 3), for rotation vectors (n, 3) shorter than a full turn."""
    square, near, angle = _small(v)
    second = np.where(near, 1 / 12 + square / 720, (1 - angle / 2 / np.tan(angle / 2)) / angle**2)
    return _polynomial(v, square, 0.5, second)


def _small(v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Squared angles (n,), whether they are small, and the angles, or 1 if small."""
    square = np.einsum("nk,nk->n", v, v)
    near = square < SMALL**2
    return square, near, np.sqrt(np.where(near, 1.0, square))


def _polynomial(v: np.ndarray, square: np.ndarray, first: Any, second: np.ndarray) -> np.ndarray:
    """1 + first K + second K K, (n, 3, 3), with cross matrices K; K K = v v' - |v|^2."""
    dyad = (second[:, None] * v)[:, :, None] * v[:, None, :]
    return first * cross_matrix(v) + dyad + (1 - second * square)[:, None, None] * UNIT


def within_pi(angle: Any, about: Any = 0.0) -> Any:
    """Return the angles shifted by full turns to within pi of `about` [rad]."""
    return angle - 2 * np.pi * np.round((angle - about) / (2 * np.pi))


def matrices(orientation: Any) -> np.ndarray:
    """Return rotation matrices (..., 3, 3) from matrices or quaternions (..., 4), scalar first, of any nonzero length.

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
    """Return ZYZ Euler angles (..., 3) [rad], R = Rz(alpha) Ry(beta) Rz(gamma), and flags (...) of singular rows.

    `orientation`: rotation matrices (..., 3, 3), or quaternions (..., 4), scalar first, of any nonzero length.

    beta is in [0, pi]; alpha and gamma are within pi of those in `about` (3,), zero by default, which avoids jumps at
    +-pi in a small range around a reference. The angles are singular at beta = 0 and pi, where only alpha + gamma or
    alpha - gamma is determined: if sin beta < 1e-6, gamma is set to 0 and the row is flagged.

    Raises ValueError for another shape. Rows that are not finite become NaN, unflagged.

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
        angles[..., ::2] = within_pi(angles[..., ::2], np.asarray(about, dtype=float)[..., ::2])
    return angles, singular


def rotation_vector(orientation: Any, reference: Any) -> np.ndarray:
    """Return rotation vectors (..., 3) [rad], in world coordinates, from the reference to each orientation.

    They are not singular for rotations below pi; for small rotations the components are rotations about x, y and z. A
    half turn has two axes: within round-off of it the axis with a positive first nonzero component is used.
    Orientations are matrices (..., 3, 3) or quaternions (..., 4), scalar first; `reference` is a single one. Raises
    ValueError for another shape.

    >>> angle = np.radians(30.0)
    >>> turned = [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]  # about z
    >>> np.degrees(gt.kinematics.rotation_vector(turned, np.eye(3))).round(6)
    array([ 0.,  0., 30.])
    """
    return logarithm(quaternion_of(matrices(orientation) @ matrices(reference).T))


def rotation_of_rpy(rpy: ArrayLike) -> np.ndarray:
    """Return Rz(yaw) Ry(pitch) Rx(roll), (3, 3): rotations about fixed axes, as in URDF."""
    roll, pitch, yaw = (float(x) for x in np.asarray(rpy, float))
    return np.asarray(rotation_about(Z, yaw) @ rotation_about(Y, pitch) @ rotation_about(X, roll))


def rpy_of_rotation(R: np.ndarray) -> np.ndarray:
    """Return roll, pitch, yaw (3,) of a rotation; yaw is 0 at a pitch of +-90 degrees, where it depends on roll."""
    yaw = float(np.arctan2(R[1, 0], R[0, 0])) if np.hypot(R[0, 0], R[1, 0]) > 1e-12 else 0.0
    rest = rotation_about(Z, -yaw) @ R
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw])


def matrices_of(poses: np.ndarray) -> np.ndarray:
    """Return the rotations (n, 3, 3) of poses (n, 7)."""
    return quaternion_matrix(np.asarray(poses, float)[:, :4])


def poses_of(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the poses (n, 7) of rotations (n, 3, 3), which are projected to SO(3), and translations (n, 3)."""
    return np.hstack([quaternion_of(nearest_rotation(R)), t])


def composed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the composed poses (n, 7), first b, then a."""
    Ra = matrices_of(a)
    return poses_of(Ra @ matrices_of(b), np.einsum("nij,nj->ni", Ra, b[:, 4:]) + a[:, 4:])


def inverse_poses(a: np.ndarray) -> np.ndarray:
    """Return the inverse poses (n, 7)."""
    R = matrices_of(a).transpose(0, 2, 1)
    return poses_of(R, -np.einsum("nij,nj->ni", R, a[:, 4:]))
