"""Starting values of the bundle: cameras by the direct linear transformation, the target from rays to its marks."""

from __future__ import annotations

import numpy as np
import scipy

from ...calibrate.measured.column_checks import aligned
from ...geometry.quaternions import quaternion_matrix, quaternion_of
from ...geometry.rotations import rotation_by
from ...inference.nonlinear import by_differences, nonlinear_fit
from ...results.refusal import ArgumentError
from ..starts import linear_projection
from .pictures import RobotPictures

LEAST = 8  # pictures of a camera: two more than the direct linear transformation needs
SIZES = (0.5, 2.0)  # plausible ratios of the stated to the observed size of a target
ON_A_LINE = 1e-3  # smallest width of a target over its length
FLAT = 5e-3  # smallest thickness of the poses over their size that separates focal length and distance
LOOSE = 0.15  # largest median deviation, relative to the spread of the mean corners, if pictures and poses match
PLAUSIBLE = (0.2, 20.0)  # focal length in widths of the picture


def camera_starts(p: RobotPictures, places: np.ndarray, intrinsics: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Compute cameras (K, 16) from the mean corner of each picture and the positions `places` (N, 3) of the target [m].

    `intrinsics` (K, 9): initial lenses; `known` (K,): whether their focal length is known. Raises ArgumentError.
    """
    cameras = []
    for k, name in enumerate(p.cameras):
        pose, corners = p.pose[p.camera == k], p.uv[p.camera == k]
        rows = np.unique(pose)
        if len(rows) < LEAST:
            raise ArgumentError(f"{name} has {len(rows)} pictures; expected at least {LEAST}", "corners")
        count = np.bincount(pose, minlength=len(p.poses))[rows]
        uv = np.stack([np.bincount(pose, corners[:, j], minlength=len(p.poses))[rows] / count for j in (0, 1)], 1)
        K, R, c = _resection(places[rows], uv, name)
        start = intrinsics[k].copy()
        width = 2 * start[2] + 1
        if not known[k] and PLAUSIBLE[0] * width < K[0, 0] < PLAUSIBLE[1] * width:
            start[:2] = (K[0, 0] + K[1, 1]) / 2
        # the pose that reproduces the mean corners with this focal length
        turn, place = _placed(start, places[rows], uv, R, c)
        ray = (places[rows] - place) @ quaternion_matrix(turn)
        with np.errstate(all="ignore"):
            off = np.linalg.norm(start[:2] * ray[:, :2] / ray[:, 2:] + start[2:4] - uv, axis=1)
        spread = float(np.median(np.linalg.norm(uv - np.median(uv, axis=0), axis=1)))
        if not float(np.median(off)) < LOOSE * spread:
            raise ArgumentError(
                f"no pose of {name} reproduces its pictures: the median deviation is {np.median(off):.3g} pixel, their "
                f"spread {spread:.3g}; the rows of the actuators do not belong to the pictures, or the robot model is "
                "wrong",
                "actuators",
            )
        cameras.append(np.concatenate([start, turn, place]))
    return np.array(cameras)


def _resection(X: np.ndarray, uv: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return intrinsics, rotation (camera to base) and position of the camera that projects points X to uv."""
    middle, size = X.mean(axis=0), np.linalg.norm(X - X.mean(axis=0), axis=1).mean()
    if np.linalg.svd(X - middle, compute_uv=False)[-1] < FLAT * size * np.sqrt(len(X)):
        raise ArgumentError(f"the poses observed by {name} lie in a plane; add poses at other distances", "corners")
    P, _ = linear_projection(X, uv)
    P *= np.sign(np.linalg.det(P[:, :3]))
    K, R = scipy.linalg.rq(P[:, :3])
    sign = np.diag(np.sign(np.diag(K)))
    K, R = K @ sign, sign @ R
    c = -np.linalg.solve(P[:, :3], P[:, 3])
    if ((X - c) @ R.T)[:, 2].mean() < 0:
        raise ArgumentError(
            f"{name} sees the target from behind: its pictures are mirrored, or the rows of the actuators do not "
            "belong to its pictures",
            "corners",
        )
    return K / K[2, 2], R.T, c


def _placed(start: np.ndarray, X: np.ndarray, uv: np.ndarray, R: np.ndarray, c: np.ndarray) -> list[np.ndarray]:
    """Return quaternion and position for intrinsics that may differ from those of the resection."""

    def residual(x: np.ndarray) -> np.ndarray:
        p = (X - c - x[3:]) @ (R @ rotation_by(x[:3]))
        z = np.where(np.abs(p[:, 2:]) < 1e-6, 1e-6, p[:, 2:])
        return (start[:2] * p[:, :2] / z + start[2:4] - uv).reshape(-1)

    scale = [0.1] * 3 + [1.0] * 3
    x = nonlinear_fit(
        by_differences(residual, uv.size), np.zeros(6), "uvwxyz", scale=scale, sigma=1.0, hold_undetermined=True
    ).x
    return [quaternion_of(R @ rotation_by(x[:3])), c + x[3:]]


def target_start(
    p: RobotPictures, cameras: np.ndarray, poses: np.ndarray, on_tool: bool, known: bool = False
) -> np.ndarray:
    """Compute the target (8,): rotation, position and scale 1, by intersecting the rays to each mark in the frame of
    the target's carrier.

    The intersection is robust against corners far off, such as those of a picture counted from the other end. Raises
    ArgumentError for marks on one line, and if the size of the target is `known` and differs strongly from that in the
    pictures.
    """
    c, R = cameras[p.camera, 13:], quaternion_matrix(cameras[p.camera, 9:13])
    f = cameras[p.camera]
    ray = np.column_stack([(p.uv[:, 0] - f[:, 2]) / f[:, 0], (p.uv[:, 1] - f[:, 3]) / f[:, 1], np.ones(len(p))])
    ray = np.einsum("nij,nj->ni", R, ray)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    T = poses[p.pose, :3]
    turn = quaternion_matrix(poses[p.pose, 3:]) if poses.shape[1] == 7 else np.broadcast_to(np.eye(3), (len(p), 3, 3))
    if on_tool:  # base: T + turn m = c + s ray
        origin, ray = np.einsum("nji,nj->ni", turn, c - T), np.einsum("nji,nj->ni", turn, ray)
    else:  # tool: turn' (m - T) = c + s ray
        origin, ray = T + np.einsum("nij,nj->ni", turn, c), np.einsum("nij,nj->ni", turn, ray)
    across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
    marks = np.zeros((len(p.marks), 3))
    for k in np.unique(p.mark):
        rows = np.flatnonzero(p.mark == k)
        weight = np.ones(len(rows))
        for _ in range(8):
            A = np.einsum("n,nij->ij", weight, across[rows])
            b = np.einsum("n,nij,nj->i", weight, across[rows], origin[rows])
            marks[k] = np.linalg.lstsq(A, b, rcond=None)[0]
            off = np.linalg.norm(np.einsum("nij,nj->ni", across[rows], marks[k] - origin[rows]), axis=1)
            weight = 1 / np.maximum(off, 0.1 * np.median(off) + 1e-12)
    visible = np.isin(np.arange(len(marks)), p.mark)
    extent = np.linalg.svd(p.target[visible] - p.target[visible].mean(axis=0), compute_uv=False)
    if visible.sum() < 3 or extent[1] < ON_A_LINE * extent[0]:
        raise ArgumentError(
            f"the {int(visible.sum())} visible marks of the target lie on one line, so that its rotation is "
            "undetermined; use three or more marks that do not",
            "target",
        )
    stated, observed = (float(np.linalg.norm(x[visible] - x[visible].mean(axis=0))) for x in (p.target, marks))
    if known and not SIZES[0] < stated / max(observed, 1e-12) < SIZES[1]:
        raise ArgumentError(
            f"the stated size of the target is {stated / max(observed, 1e-12):.3g} times its size in the pictures; "
            "check its unit and that of the actuators",
            "target",
        )
    t, Rt, _ = aligned(p.target[visible], marks[visible])
    return np.concatenate([quaternion_of(Rt), t, [1.0]])
