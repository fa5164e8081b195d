"""Projection, derivatives and intersections against OpenCV."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtmodel.geometry.quaternions import logarithm
from gtmodel.geometry.rotations import matrices_of, poses_of
from gtmodel.vision import intersect, project, undistort
from gtmodel.vision.views import board_view

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'gtmodel[vision]'")

LENS = np.array([812.0, 805.0, 331.0, 228.0, -0.28, 0.09, 1.2e-3, -7e-4, 0.02])
SLOPES = 1e-9  # of the largest derivative


def matrix(lens: np.ndarray) -> np.ndarray:
    return np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1.0]])


@pytest.fixture(scope="module")
def scene() -> tuple[np.ndarray, np.ndarray]:
    """Marks (50, 3) and rotation vector and translation (6,), synthetic."""
    rng = np.random.default_rng(6)
    return rng.uniform(-0.5, 0.5, (50, 3)), np.array([0.3, -0.4, 0.2, 0.05, -0.1, 2.0])


def test_pixels_are_opencv_s(scene) -> None:
    X, move = scene
    uv, _ = cv2.projectPoints(X, move[:3], move[3:], matrix(LENS), LENS[4:])
    own, status = project(X @ Rotation.from_rotvec(move[:3]).as_matrix().T + move[3:], LENS)
    assert not status.any() and np.abs(own - uv[:, 0]).max() < 1e-10
    back = cv2.undistortPoints(uv, matrix(LENS), LENS[4:], criteria=(3, 200, 1e-15)) if cv2 else None
    assert np.abs(undistort(own, LENS)[0] - np.asarray(back)[:, 0]).max() < 1e-9


def test_derivatives_are_opencv_s(scene) -> None:
    X, move = scene
    _, J = cv2.projectPoints(X, move[:3], move[3:], matrix(LENS), LENS[4:])
    f = board_view()
    x = [ca.SX.sym("x", f.size1_in(k)) for k in range(4)]
    turn = ca.SX.sym("turn", 3)
    angle = ca.norm_2(turn)
    q = ca.vertcat(ca.cos(angle / 2), ca.sin(angle / 2) * turn / angle)
    lens, place = ca.SX.sym("lens", 9), ca.SX.sym("place", 3)
    error = f.call([lens, x[1], ca.vertcat(q, place), x[3]])[0]
    own = ca.Function("J", [lens, turn, place, x[1], x[3]], [ca.jacobian(error, ca.vertcat(turn, place, lens))])
    still, none = [1.0, 0, 0, 0, 0, 0, 0], [0.0, 0.0]
    rows = np.vstack([own(LENS, move[:3], move[3:], still, [*p, *none]).full() for p in X])
    # OpenCV: rotation, translation, fx, fy, cx, cy, k1, k2, p1, p2, k3
    assert np.abs(rows - J[:, :15]).max() <= SLOPES * np.abs(J[:, :15]).max()


def test_increments_are_rotation_vectors_as_opencv_has_them(scene) -> None:
    q = poses_of(Rotation.from_rotvec([scene[1][:3]]).as_matrix(), np.zeros((1, 3)))
    assert np.allclose(logarithm(q[:, :4])[0], cv2.Rodrigues(matrices_of(q)[0])[0].ravel(), atol=1e-12)


def test_exact_pixels_intersect_where_opencv_says(scene) -> None:
    X = scene[0] + [0, 0, 2.0]
    pair = np.array([[1.0, 0, 0, 0, 0, 0, 0], [np.cos(0.05), 0, np.sin(0.05), 0, -0.4, 0.01, 0.02]])
    uv = np.stack([project(X @ matrices_of(c[None])[0].T + c[4:], LENS)[0] for c in pair], axis=1)
    P = [np.hstack([matrices_of(c[None])[0], c[4:, None]]) for c in pair]
    xy = [undistort(uv[:, c], LENS)[0].T for c in range(2)]
    h = cv2.triangulatePoints(P[0], P[1], xy[0], xy[1])
    assert np.abs(intersect(uv, np.stack([LENS, LENS]), pair, 0.1).p - (h[:3] / h[3]).T).max() < 1e-9
