"""Starting values: homographies of flat boards, focal lengths of them (Zhang), poses of known points.

Source: Zhang 2000, "A flexible new technique for camera calibration", appendices A and B; Hartley and Zisserman 2004,
"Multiple view geometry", algorithm 4.2 (normalised direct linear transformation).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.pinhole import undistort
from ..geometry.rotations import nearest_rotation, poses_of
from ..results.refusal import ArgumentError

FLAT = 1e-6  # of the spread of points: thinner than this they lie in a plane
TILT = 1e-4  # of Zhang's equations: a smallest singular value below this part determines no focal length


def homography(X: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """H (3, 3) with (u, v, 1) ~ H (X, Y, 1), of at least four points X (n, 2) and uv (n, 2), by least squares.

    Raises ArgumentError for fewer, or for points on one line.

    >>> X = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
    >>> H = gt.vision.homography(X, 100 * X + 7)
    >>> (H / H[2, 2]).round(6) + 0.0
    array([[100.,   0.,   7.],
           [  0., 100.,   7.],
           [  0.,   0.,   1.]])
    """
    X, uv = np.asarray(X, float), np.asarray(uv, float)
    if len(X) < 4:
        raise ArgumentError(f"{len(X)} points do not determine a homography; expected at least 4")
    H, sizes = linear_projection(X, uv)
    if sizes[7] < 1e-9 * sizes[0]:
        raise ArgumentError("the points lie on one line, which does not determine a homography")
    return H


def focal_length(H: Sequence[np.ndarray], principal: Sequence[float]) -> float:
    """Focal length [pixel] from homographies (3, 3) of flat boards, the principal point (2,) known; square pixels.

    Raises ArgumentError where no board is tilted against the picture plane.

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
            "no board is tilted against the picture plane: the focal length and the distances cannot be told apart; "
            "tilt it by 20 degrees or more in some pictures, or give a starting value"
        )
    return 1 / float(np.sqrt(inverse))


def board_pose(X: np.ndarray, uv: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Pose (7,) of known points X (n, 3) in camera coordinates, from their pixels uv (n, 2): of points in a plane z = 0
    by their homography, of others, at least six, by direct linear transformation. All lie in front of the camera.

    A start, not an estimate. Raises ArgumentError for too few points, and where the pixels have no directions.

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
        raise ArgumentError(f"{len(X)} points with a direction do not determine a pose; expected at least 4")
    if np.ptp(X[:, 2]) <= FLAT * np.ptp(X[:, :2]):
        H = homography(X[:, :2], xy)
        H = H / np.sqrt(np.linalg.norm(H[:, 0]) * np.linalg.norm(H[:, 1]))
        if H[2] @ [*X[:, :2].mean(axis=0), 1.0] < 0:
            H = -H
        R = np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])])
        return poses_of(R[None], H[:, 2][None] - X[0, 2] * R[:, 2][None])[0]
    if len(X) < 6:
        raise ArgumentError(f"{len(X)} points that do not lie in a plane do not determine a pose; expected at least 6")
    P, _ = linear_projection(X, xy)
    P = P / np.cbrt(np.linalg.det(P[:, :3]))
    R, middle = nearest_rotation(P[:, :3]), X.mean(axis=0)
    return poses_of(R[None], (P @ [*middle, 1.0] - R @ middle)[None])[0]


def linear_projection(X: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """P (3, k + 1) with (u, v, 1) ~ P (X, 1) of points X (n, k) and uv (n, 2) by least squares of normalised linear
    equations, and the singular values of these."""
    A, a = _normalised(X)
    B, b = _normalised(uv)
    one = np.hstack([a, np.ones((len(a), 1))])
    zero = np.zeros_like(one)
    rows = np.vstack([np.hstack([one, zero, -b[:, :1] * one]), np.hstack([zero, one, -b[:, 1:] * one])])
    _, sizes, Vt = np.linalg.svd(rows)
    return np.linalg.inv(B) @ Vt[-1].reshape(3, -1) @ A, sizes


def _normalised(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A (k + 1, k + 1) that takes points (n, k) to middle zero and size sqrt 2, and these."""
    middle, A = p.mean(axis=0), np.eye(p.shape[1] + 1)
    spread = float(np.mean(np.linalg.norm(p - middle, axis=1)))
    A[:-1] *= np.sqrt(2) / (spread if spread > 0 else 1.0)
    A[:-1, -1] = -A[0, 0] * middle
    return A, A[0, 0] * (p - middle)
