"""Starting values: homographies of planar boards, focal lengths from them (Zhang), poses of known points.

Source: Zhang 2000, "A flexible new technique for camera calibration", appendices A and B; Hartley and Zisserman 2004,
"Multiple view geometry", algorithm 4.2 (normalised direct linear transformation).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.pinhole import undistort
from ..geometry.rotations import nearest_rotation, poses_of
from ..results.refusal import ArgumentError

FLAT = 1e-6  # thickness of planar points, relative to their spread
TILT = 1e-4  # norm of Zhang's equations below which they do not determine the focal length


def homography(X: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Fit H (3, 3) with (u, v, 1) ~ H (X, Y, 1) to at least four points X (n, 2) and uv (n, 2) by least squares.

    Raises ArgumentError for fewer points, or for points on one line.

    >>> X = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
    >>> H = gt.vision.homography(X, 100 * X + 7)
    >>> (H / H[2, 2]).round(6) + 0.0
    array([[100.,   0.,   7.],
           [  0., 100.,   7.],
           [  0.,   0.,   1.]])
    """
    X, uv = np.asarray(X, float), np.asarray(uv, float)
    if len(X) < 4:
        raise ArgumentError(f"found {len(X)} points; a homography needs at least 4")
    H, sizes = linear_projection(X, uv)
    if sizes[7] < 1e-9 * sizes[0]:
        raise ArgumentError("the points are collinear and do not determine a homography")
    return H


def focal_length(H: Sequence[np.ndarray], principal: Sequence[float]) -> float:
    """Compute the focal length [pixel] from homographies (3, 3) of planar boards and the known principal point (2,).

    Pixels are assumed square. Raises ArgumentError if no board is tilted against the picture plane.

    >>> K = np.diag([800.0, 800.0, 1.0])
    >>> H = K @ np.array([[0.8, 0.0, 0.1], [0.0, 1.0, 0.2], [0.6, 0.0, 5.0]])
    >>> round(gt.vision.focal_length([H], [0.0, 0.0]), 6)
    800.0
    """
    shift = np.array([[1.0, 0.0, -principal[0]], [0.0, 1.0, -principal[1]], [0.0, 0.0, 1.0]])
    rows, right = [], []
    for each in H:
        G = shift @ each
        a, b = G[:, 0], G[:, 1]
        size = np.hypot(np.linalg.norm(a[:2]), np.linalg.norm(b[:2])) / np.sqrt(2)
        a, b = a / size, b / size
        rows += [a[0] * b[0] + a[1] * b[1], a[0] ** 2 + a[1] ** 2 - b[0] ** 2 - b[1] ** 2]
        right += [-a[2] * b[2], -(a[2] ** 2) + b[2] ** 2]
    A, y = np.array(rows), np.array(right)
    inverse = float(A @ y) / max(float(A @ A), 1e-300)  # 1 / f^2
    if not np.linalg.norm(A) > TILT or not inverse > 0:
        raise ArgumentError(
            "no board is tilted against the picture plane, so focal length and distance cannot be separated; "
            "tilt it by 20 degrees or more in some pictures, or give a starting value"
        )
    return 1 / float(np.sqrt(inverse))


def board_pose(X: np.ndarray, uv: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Compute the pose (7,) of known points X (n, 3) in camera coordinates from their pixels uv (n, 2).

    Points of constant z use a homography, others (at least six) the direct linear transformation. All must be in front
    of the camera. The pose is a starting value, not an estimate. Raises ArgumentError if too few points have a pixel
    that can be undistorted.

    >>> lens = np.array([500.0, 500.0, 320.0, 240.0, 0, 0, 0, 0, 0])
    >>> X = gt.vision.Board(3, 2, square=0.1).points
    >>> uv, _ = gt.vision.project(X + [0.1, 0.0, 2.0], lens)
    >>> gt.vision.board_pose(X, uv, lens).round(6) + 0.0
    array([1. , 0. , 0. , 0. , 0.1, 0. , 2. ])
    """
    X = np.asarray(X, float)
    xy, status = undistort(uv, lens)
    good = status == 0
    X, xy = X[good], xy[good]
    if len(X) < 4:
        raise ArgumentError(f"found {len(X)} points whose pixels can be undistorted; a pose needs at least 4")
    if np.ptp(X[:, 2]) <= FLAT * np.ptp(X[:, :2]):
        H = homography(X[:, :2], xy)
        H = H / np.sqrt(np.linalg.norm(H[:, 0]) * np.linalg.norm(H[:, 1]))
        if H[2] @ [*X[:, :2].mean(axis=0), 1.0] < 0:
            H = -H
        R = np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])])
        return poses_of(R[None], H[:, 2][None] - X[0, 2] * R[:, 2][None])[0]
    if len(X) < 6:
        raise ArgumentError(f"found {len(X)} points that do not lie in a plane z = const; a pose needs at least 6")
    P, _ = linear_projection(X, xy)
    P = P / np.cbrt(np.linalg.det(P[:, :3]))
    R, middle = nearest_rotation(P[:, :3]), X.mean(axis=0)
    return poses_of(R[None], (P @ [*middle, 1.0] - R @ middle)[None])[0]


def linear_projection(X: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit P (3, k + 1) with (u, v, 1) ~ P (X, 1) to points X (n, k) and uv (n, 2) by normalised linear least squares;
    also return the singular values of the equations."""
    A, a = _normalised(X)
    B, b = _normalised(uv)
    one = np.hstack([a, np.ones((len(a), 1))])
    zero = np.zeros_like(one)
    rows = np.vstack([np.hstack([one, zero, -b[:, :1] * one]), np.hstack([zero, one, -b[:, 1:] * one])])
    _, sizes, Vt = np.linalg.svd(rows)
    return np.linalg.inv(B) @ Vt[-1].reshape(3, -1) @ A, sizes


def _normalised(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return A (k + 1, k + 1) that maps points (n, k) to mean zero and mean size sqrt 2, and the mapped points."""
    middle, A = p.mean(axis=0), np.eye(p.shape[1] + 1)
    spread = float(np.mean(np.linalg.norm(p - middle, axis=1)))
    A[:-1] *= np.sqrt(2) / (spread if spread > 0 else 1.0)
    A[:-1, -1] = -A[0, 0] * middle
    return A, A[0, 0] * (p - middle)
