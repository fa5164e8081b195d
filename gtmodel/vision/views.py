"""Pixel residuals for bundles, intersection of points from several cameras with covariance, and gauge motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from ..compiler.rows import map_columns
from ..geometry.expressions import applied
from ..geometry.pinhole import LENS, pixel, undistort
from ..geometry.rotations import matrices_of
from ..inference.bundle.undetermined import GaugeMotion
from ..results.refusal import ArgumentError
from ..results.status import Status


def board_view() -> ca.Function:
    """Return the function (lens (9,), camera pose (7,), board pose (7,), data (5,): X, Y, Z on the board, u, v) ->
    (error (2,) [pixel], margins (2,)).

    The camera pose maps outer coordinates to camera coordinates, the board pose maps board coordinates to outer ones.
    The error is the predicted minus the measured pixel.

    >>> f = gt.vision.board_view()
    >>> lens, still = [500.0, 500.0, 320.0, 240.0, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0, 0]
    >>> error, margins = f(lens, still, [1.0, 0, 0, 0, 0, 0, 2.0], [0.1, 0.0, 0.0, 344.0, 240.0])
    >>> error.full().ravel()
    array([1., 0.])
    """
    lens, camera, board, data = _symbols(7, 5)
    uv, margins = pixel(applied(camera, applied(board, data[:3])), lens)
    return ca.Function("board_view", [lens, camera, board, data], [uv - data[3:], margins])


def point_view() -> ca.Function:
    """Return the function (lens (9,), camera pose (7,), point (3,), data (2,): u, v) -> (error (2,) [pixel], margins
    (2,)), with the point in outer coordinates; otherwise as board_view().

    >>> f = gt.vision.point_view()
    >>> lens, still = [500.0, 500.0, 320.0, 240.0, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, 0, 0, 0]
    >>> f(lens, still, [0.1, 0, 2.0], [344.0, 240.0])[0].full().ravel()
    array([1., 0.])
    """
    lens, camera, point, data = _symbols(3, 2)
    uv, margins = pixel(applied(camera, point), lens)
    return ca.Function("point_view", [lens, camera, point, data], [uv - data, margins])


def mark_view() -> ca.Function:
    """Return the function (lens (9,), camera pose (7,), frame pose (7,), mark (3,), data (2,): u, v) -> (error (2,)
    [pixel], margins (2,)) of a mark with unknown coordinates in a moving frame; otherwise as board_view().

    >>> gt.vision.mark_view().n_in()
    5
    """
    lens, camera, frame, data = _symbols(7, 2)
    mark = ca.SX.sym("mark", 3)
    uv, margins = pixel(applied(camera, applied(frame, mark)), lens)
    return ca.Function("mark_view", [lens, camera, frame, mark, data], [uv - data, margins])


def _symbols(seen: int, data: int) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    return ca.SX.sym("lens", len(LENS)), ca.SX.sym("camera", 7), ca.SX.sym("seen", seen), ca.SX.sym("data", data)


AXES = "xyz"
FIX = "fix a camera, or measure where a mark is"
LENGTH = "give one known length: between two marks, of a board, or between two cameras"


def similarity_motions(cameras: Sequence[str] = ("camera",), frames: Sequence[str] = (),
                       points: Sequence[str] = (), marks: Sequence[str] = ()) -> list[GaugeMotion]:  # fmt: skip
    """Return the seven motions of a whole scene that leave all pixels unchanged, each with its remedy: translations,
    rotations, and growth by one factor.

    The arguments are names of groups of unknowns of `gt.inference.bundle`: cameras, whose poses map outer coordinates
    to camera coordinates; frames (boards or platforms), whose poses map their coordinates to outer ones; points in
    outer coordinates; marks, points in coordinates of the frames. The first seven numbers of cameras and frames are
    the pose: quaternion, scalar first, and translation.

    >>> for motion in gt.vision.similarity_motions(["camera"], points=["point"])[::3]:
    ...     print(f"{motion.words}: {motion.remedy}")
    all cameras and points move together along x: fix a camera, or measure where a mark is
    all cameras and points turn together about x: fix a camera, or measure where a mark is
    everything grows by one factor: give one known length: between two marks, of a board, or between two cameras
    """
    observed = "points" if points else "boards"

    def shift(axis: int, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        step = {}
        for name in cameras:
            step[name] = _still(values[name])
            step[name][:, 3:6] = -matrices_of(values[name])[:, :, axis]
        for name in frames:
            step[name] = _still(values[name])
            step[name][:, 3 + axis] = 1.0
        for name in points:
            step[name] = np.tile(np.eye(3)[axis], (len(values[name]), 1))
        return step

    def turn(axis: int, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        w, step = np.eye(3)[axis], {}
        for name in cameras:
            step[name] = _still(values[name])
            step[name][:, :3] = -w
        for name in frames:
            step[name] = _still(values[name])
            step[name][:, :3] = matrices_of(values[name])[:, axis, :]
            step[name][:, 3:6] = np.cross(w, values[name][:, 4:7])
        for name in points:
            step[name] = np.cross(w, values[name])
        return step

    def growth(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        step = {}
        for name in (*cameras, *frames):
            step[name] = _still(values[name])
            step[name][:, 3:6] = values[name][:, 4:7]
        for name in (*points, *marks):
            step[name] = values[name].copy()
        return step

    def along(axis: int) -> GaugeMotion:
        words = f"all cameras and {observed} move together along {AXES[axis]}"
        return GaugeMotion(words, FIX, lambda values: shift(axis, values))

    def about(axis: int) -> GaugeMotion:
        words = f"all cameras and {observed} turn together about {AXES[axis]}"
        return GaugeMotion(words, FIX, lambda values: turn(axis, values))

    scale = GaugeMotion("everything grows by one factor", LENGTH, growth)
    return [*(along(k) for k in range(3)), *(about(k) for k in range(3)), scale]


def _still(values: np.ndarray) -> np.ndarray:
    return np.zeros((len(values), values.shape[1] - 1))


ROUNDS, ARRIVED = 20, 1e-12
PARALLEL = 1e-10  # smallest eigenvalue of the rays' normal equations for a point at a finite distance
MOVES = len(LENS) + 6  # increments of a camera: lens, rotation and translation


@dataclass(frozen=True, eq=False)
class IntersectedPoints:
    """Points p (n, 3) [m], their `covariance` (n, 3, 3) [m2], the residuals `errors` (n, cameras, 2) [pixel], predicted
    minus measured, and status codes (n,); NaN for points without a solution."""

    p: np.ndarray
    covariance: np.ndarray
    errors: np.ndarray
    status: np.ndarray


def intersect(
    uv: np.ndarray,
    lenses: np.ndarray,
    cameras: np.ndarray,
    sigma: float | Sequence[float],
    camera_covariance: np.ndarray | None = None,
) -> IntersectedPoints:
    """Intersect points in outer coordinates from pixels uv (n, cameras, 2) by least squares on the pixels; pixels are
    NaN if a camera does not see the point.

    lenses (cameras, 9) as for project(); cameras (cameras, 7): poses, outer to camera coordinates. sigma [pixel]: noise
    of u and v, one for all or one per camera. camera_covariance (cameras * 15, cameras * 15): for each camera lens,
    rotation about its own axes [rad] and translation, as the increments of a bundle. With it, the covariance of each
    point includes the errors of the cameras. These also correlate the errors of different points; the result does not
    contain this correlation.

    Status.SINGULAR: fewer than two cameras see the point, or their rays are parallel. NOT_CONVERGED or OUT_OF_RANGE:
    there is no such point in front of all cameras. Raises ArgumentError for shapes that do not match.

    >>> lens = np.array([500.0, 500.0, 320.0, 240.0, 0, 0, 0, 0, 0])
    >>> pair = np.array([[1.0, 0, 0, 0, 0, 0, 0], [1.0, 0, 0, 0, -0.5, 0, 0]])
    >>> seen = gt.vision.intersect(np.array([[[345.0, 240.0], [220.0, 240.0]]]), np.stack([lens, lens]), pair, 0.1)
    >>> seen.p.round(9) + 0.0, np.sqrt(np.diag(seen.covariance[0])).round(5)
    (array([[0.1, 0. , 2. ]]), array([0.00033, 0.00028, 0.00226]))
    """
    uv, lenses, cameras = (np.asarray(a, float) for a in (uv, lenses, cameras))
    n, many = uv.shape[:2]
    if uv.shape != (n, many, 2) or lenses.shape != (many, len(LENS)) or cameras.shape != (many, 7):
        raise ArgumentError(
            f"found pixels {uv.shape}, lenses {lenses.shape} and cameras {cameras.shape}; expected (n, cameras, 2), "
            f"(cameras, {len(LENS)}) and (cameras, 7)"
        )
    noise = np.broadcast_to(np.asarray(sigma, float), (many,))
    mask = np.asarray(np.all(np.isfinite(uv), axis=2), bool)
    p, status = _rays(uv, lenses, cameras, mask)
    size = np.full(n, np.inf)
    J, r, margin = np.zeros((n, many, 2, 3)), np.zeros((n, many, 2)), np.zeros((n, many))
    by_camera = np.zeros((n, many, 2, MOVES))
    with np.errstate(all="ignore"):
        for _ in range(ROUNDS):
            J, r, margin, by_camera = _linearised(p, uv, lenses, cameras, mask)
            white, rows = J / noise[:, None, None], r / noise[:, None]
            H = np.einsum("ncij,ncik->njk", white, white)
            g = np.einsum("ncij,nci->nj", white, rows)
            step = np.linalg.solve(_safe(H), g[:, :, None])[:, :, 0]
            p = p - step
            size = np.abs(step).max(axis=1) / np.maximum(np.abs(p).max(axis=1), 1e-300)
            if np.nanmax(np.where(status == Status.OK, size, 0.0), initial=0.0) <= ARRIVED:
                break
        J, r, margin, by_camera = _linearised(p, uv, lenses, cameras, mask)
        white = J / noise[:, None, None]
        H = np.einsum("ncij,ncik->njk", white, white)
        C = np.linalg.inv(_safe(H))
        arrived = size <= 1e-8
    if camera_covariance is not None:
        D = np.einsum("njk,ncik->ncji", C, white) / noise[:, None, None]
        G = np.einsum("ncji,ncim->njcm", D, by_camera).reshape(n, 3, many * MOVES)
        C = C + G @ np.asarray(camera_covariance, float) @ G.transpose(0, 2, 1)
    front = np.where(mask, margin, 1.0).min(axis=1, initial=1.0) > 0
    status = np.where((status == Status.OK) & ~arrived, int(Status.NOT_CONVERGED), status)
    status = np.where((status == Status.OK) & ~front, int(Status.OUT_OF_RANGE), status)
    bad = status != Status.OK
    errors = np.where(mask[:, :, None], r, np.nan)
    p[bad], C[bad], errors[bad] = np.nan, np.nan, np.nan
    return IntersectedPoints(p, C, errors, status)


def _rays(uv: np.ndarray, lenses: np.ndarray, cameras: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points nearest to all rays, and a first status."""
    n, many = mask.shape
    A, b = np.zeros((n, 3, 3)), np.zeros((n, 3))
    R = matrices_of(cameras)
    good = mask.copy()
    for c in range(many):
        xy, code = undistort(np.where(mask[:, c, None], uv[:, c], lenses[c, 2:4]), lenses[c])
        good[:, c] &= code == Status.OK
        ray = np.column_stack([np.nan_to_num(xy), np.ones(n)]) @ R[c]
        ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
        across = (np.eye(3) - ray[:, :, None] * ray[:, None, :]) * good[:, c, None, None]
        A += across
        b += across @ (-R[c].T @ cameras[c, 4:])
    apart = np.linalg.eigvalsh(A)[:, 0] > PARALLEL
    status = np.where((good.sum(axis=1) >= 2) & apart, int(Status.OK), int(Status.SINGULAR))
    status = np.where((mask & ~good).any(axis=1), int(Status.NOT_CONVERGED), status)
    return np.linalg.solve(_safe(np.where(apart[:, None, None], A, np.eye(3))), b[:, :, None])[:, :, 0], status


def _safe(H: np.ndarray) -> np.ndarray:
    good = np.asarray(np.all(np.isfinite(H), axis=(1, 2)))
    H = np.where(good[:, None, None], H, np.eye(3))
    flat = np.abs(np.linalg.det(H)) < 1e-300
    return np.where(flat[:, None, None], np.eye(3), H)


def _linearised(p: np.ndarray, uv: np.ndarray, lenses: np.ndarray, cameras: np.ndarray,
                mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return the Jacobian of the errors with respect to the point (n, cameras, 2, 3), the errors, the smallest margins
    (n, cameras), and the Jacobian with respect to the camera (n, cameras, 2, 15); zero if a camera does not see it."""
    n, many = mask.shape
    f = _derivatives()
    J, r, margin = np.zeros((n, many, 2, 3)), np.zeros((n, many, 2)), np.ones((n, many))
    by_camera = np.zeros((n, many, 2, MOVES))
    for c in range(many):
        k = np.flatnonzero(mask[:, c])
        if not len(k):
            continue
        columns = [
            np.repeat(lenses[c][:, None], len(k), 1),
            np.repeat(cameras[c][:, None], len(k), 1),
            p[k].T,
            uv[k, c].T,
        ]
        error, margins, dpoint, dcamera = (a.T.reshape(len(k), -1) for a in map_columns(f, columns))
        r[k, c], margin[k, c] = error, margins.min(axis=1)
        J[k, c], by_camera[k, c] = dpoint.reshape(-1, 2, 3), dcamera.reshape(-1, 2, MOVES)
    return J, r, margin, by_camera


@cache
def _derivatives() -> ca.Function:
    from ..inference.bundle.residual_block import UnknownGroup  # imported late: only intersect() needs it

    lens, camera, point, data = (ca.SX.sym("x", k) for k in (len(LENS), 7, 3, 2))
    move = ca.SX.sym("move", MOVES)
    still = UnknownGroup("camera", np.eye(1, 7), ["w", "i", "j", "k", "x", "y", "z"], turn=0)
    moved = still.moved_sx(camera, move[len(LENS) :])
    error, margin = point_view().call([lens + move[: len(LENS)], moved, point, data])
    by_point, by_camera = ca.jacobian(error, point), ca.jacobian(error, move)
    out = ca.substitute([error, margin, by_point.T, by_camera.T], [move], [ca.DM.zeros(MOVES)])
    return ca.Function("intersection", [lens, camera, point, data], [ca.densify(e) for e in out], {"cse": True})
