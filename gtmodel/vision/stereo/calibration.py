"""Lenses and poses of cameras from pictures of a board: a fit of all corners, and robust fits that identify wrong
corners and pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...geometry.pinhole import LENS, project
from ...geometry.quaternions import angle_between
from ...geometry.rotations import composed, inverse_poses, matrices_of, poses_of
from ...inference.bundle import BundleFit, ResidualBlock, UnknownGroup, bundle_fit
from ...results.refusal import ArgumentError, naming
from ..corner_table import CornerTable
from ..residuals import SETTLED, SPREAD, GrossErrors, gross_errors
from ..starts import board_pose, focal_length, homography
from ..views import board_view
from .options import BoardPictures, CameraFit, StereoStart

TURNED = np.deg2rad(90.0)  # a larger deviation suggests that the board was counted from the other end
LIKE = np.deg2rad(45.0)  # a smaller deviation is agreement: starting values are rough
CLEARLY = 0.5  # all boards are reversed if that reduces the median deviation below this factor
ROUGH = np.deg2rad(5.0)  # accuracy of camera rotations from homographies: smaller deviations prove nothing
LEAST = 4  # corners that determine the pose of a board
UNITS = ("pixel",) * 4 + ("1",) * 5
POSE = ("qw", "qx", "qy", "qz", "x", "y", "z")
POSE_UNITS = ("rad", "rad", "rad", "m", "m", "m")


def pose_group(name: str, poses: np.ndarray, keys: tuple[str, ...] = (), *, local: bool = False,
               fixed: np.ndarray | None = None) -> UnknownGroup:  # fmt: skip
    """Return poses (n, 7) as unknowns of a bundle."""
    return UnknownGroup(name, poses, POSE, keys=keys, turn=0, local=local, fixed=fixed, units=POSE_UNITS)


@dataclass(frozen=True, eq=False)
class CameraStarts:
    """Starting values: lenses (cameras, 9), poses of cameras (cameras, 7) and of the board (pictures, 7)."""

    lenses: np.ndarray
    cameras: np.ndarray
    boards: np.ndarray


def camera_starts(table: CornerTable, pictures: BoardPictures, start: StereoStart) -> CameraStarts:
    """Compute starting values from homographies of the board, in the frame of the first camera.

    Raises ArgumentError for too few corners, a board that was never tilted, a camera that shares no picture with the
    others, and a board whose corners two cameras count from opposite ends.

    >>> board = gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6)
    >>> table, lenses, cameras = gt.vision.stereo.made_corners(gt.vision.stereo.SyntheticBoards(), board)
    >>> begin = gt.vision.stereo.camera_starts(table, board, gt.vision.StereoStart(focal_pixel=640.0))
    >>> begin.lenses[0, :2], begin.boards.shape
    (array([640., 640.]), (13, 7))
    """
    n = len(table.cameras)
    middle = (pictures.width_pixel - 1) / 2, (pictures.height_pixel - 1) / 2
    lenses = np.zeros((n, len(LENS)))
    for c in range(n):
        f = start.focal_pixel or _focal(table, c, middle)
        lenses[c, :4] = f, f, *middle
    views = _views(table, lenses)
    if n > 1:
        _refuse_turned(table, lenses, views)
    cameras = _camera_poses(table, views)
    if start.translation is not None:
        if n < 2:
            raise ArgumentError("needs two cameras; found corners of one", "start.translation")
        cameras[1, 4:] = start.translation
    boards = np.tile(np.eye(1, 7), (len(table.pictures), 1))
    for p in range(len(table.pictures)):
        c = next((c for c in range(n) if (c, p) in views), None)
        if c is None:
            raise ArgumentError(f"picture {table.pictures[p]} shows fewer than {LEAST} corners; remove it", "corners")
        boards[p] = composed(inverse_poses(cameras[c][None]), views[c, p][None])[0]
    return CameraStarts(lenses, cameras, boards)


def _focal(table: CornerTable, camera: int, middle: tuple[float, float]) -> float:
    H = []
    for p in range(len(table.pictures)):
        rows = (table.camera == camera) & (table.picture == p)
        if rows.sum() >= LEAST:
            H.append(homography(table.X[rows, :2], table.uv[rows]))
    with naming("start.focal_pixel", before=f"{table.cameras[camera]}: "):
        return focal_length(H, middle)


def _views(table: CornerTable, lenses: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
    """Return the pose of the board in camera coordinates, by camera and picture."""
    views = {}
    for c in range(len(table.cameras)):
        for p in range(len(table.pictures)):
            rows = (table.camera == c) & (table.picture == p)
            if rows.sum() >= LEAST:
                views[c, p] = board_pose(table.X[rows], table.uv[rows], lenses[c])
    return views


def _between(views: dict[tuple[int, int], np.ndarray], a: int, b: int, pictures: int) -> tuple[list[int], np.ndarray]:
    """Return the pictures of both cameras, and for each the relative pose: p_b = R p_a + t."""
    both = [p for p in range(pictures) if (a, p) in views and (b, p) in views]
    if not both:
        return both, np.zeros((0, 7))
    return both, composed(np.array([views[b, p] for p in both]), inverse_poses(np.array([views[a, p] for p in both])))


def _angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the angles (n, m) [rad] between the rotations of poses (n, 7) and (m, 7)."""
    return angle_between(a[:, None, :4], b[:, :4])


def _medoid(poses: np.ndarray) -> int:
    return int(np.argmin(np.median(_angles(poses, poses), axis=1)))


def _refuse_turned(table: CornerTable, lenses: np.ndarray, views: dict[tuple[int, int], np.ndarray]) -> None:
    """Raise ArgumentError for boards counted from the other end: their relative camera pose agrees with the usual one
    only if the corners are reversed."""
    for b in range(1, len(table.cameras)):
        both, counted = _between(views, 0, b, len(table.pictures))
        if len(both) < 3:
            continue
        turned = np.empty_like(counted)
        for k, p in enumerate(both):
            rows = (table.camera == b) & (table.picture == p)
            X = table.X[rows]
            other = board_pose(X.max(axis=0) + X.min(axis=0) - X, table.uv[rows], lenses[b])
            turned[k] = composed(other[None], inverse_poses(views[0, p][None]))[0]
        candidates = np.vstack([counted, turned])
        off = np.stack([_angles(candidates, counted), _angles(candidates, turned)])  # (order, candidate, picture)
        median = np.median(off.min(axis=0), axis=1)
        usual = int(np.argmin(median[: len(both)]))
        all_turned = len(both) + int(np.argmin(median[len(both) :]))
        if median[all_turned] < CLEARLY * median[usual] and median[usual] > ROUGH:
            usual = all_turned
        odd = np.flatnonzero((off[0, usual] > TURNED) & (off[1, usual] < LIKE))
        if len(odd):
            which = f"picture {', '.join(table.pictures[both[k]] for k in odd)}"
            which = "all pictures" if len(odd) == len(both) else which
            raise ArgumentError(
                f"{which}: {table.cameras[b]} counts the corners from the opposite end of the board to "
                f"{table.cameras[0]} (turned by 180 degrees); reverse their order there, or remove the picture",
                "corners",
            )


def _camera_poses(table: CornerTable, views: dict[tuple[int, int], np.ndarray]) -> np.ndarray:
    cameras = np.tile(np.eye(1, 7), (len(table.cameras), 1))
    placed = {0}
    while len(placed) < len(cameras):
        options = [
            (a, b, *_between(views, a, b, len(table.pictures)))
            for a in placed
            for b in set(range(len(cameras))) - placed
        ]
        a, b, both, between = max(options, key=lambda o: (len(o[2]), -o[0], -o[1]))
        if not both:
            rest = ", ".join(table.cameras[c] for c in range(len(cameras)) if c not in placed)
            raise ArgumentError(f"{rest} and the other cameras never see the board in the same picture", "corners")
        usual = between[_medoid(between)]
        like = _angles(between, usual[None])[:, 0] < LIKE
        translation = np.median(between[like, 4:], axis=0)
        relative = poses_of(matrices_of(usual[None]), translation[None])
        cameras[b] = composed(relative, cameras[a][None])[0]
        placed.add(b)
    return cameras


def calibrated(
    table: CornerTable,
    start: CameraStarts,
    fit: CameraFit,
    *,
    loss_sigma: float | None = None,
    stop: Callable[[], bool] | None = None,
) -> BundleFit:
    """Fit all corners by least squares, or with `loss_sigma` [pixel] by Huber's loss for this noise.

    Groups of unknowns: "lens" (cameras, 9), "camera" (cameras, 7) and "board" (pictures, 7, local).

    >>> board = gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6)
    >>> table, lenses, cameras = gt.vision.stereo.made_corners(gt.vision.stereo.SyntheticBoards(), board)
    >>> begin = gt.vision.stereo.camera_starts(table, board, gt.vision.StereoStart())
    >>> fit = gt.vision.stereo.calibrated(table, begin, gt.vision.CameraFit())
    >>> bool(abs(fit.values["lens"][0, 0] - lenses[0, 0]) < 4 * fit.estimate.std[0])
    True
    """
    n = len(table.cameras)
    held = np.zeros(len(LENS), bool)
    held[2:4] = not fit.principal_point
    for k, name in enumerate(LENS[4:], 4):
        held[k] = name not in fit.distortion
    still = np.zeros((n, 6), bool)
    still[0] = True
    keys = tuple(f"{name}, place" for name in table.cameras)
    groups = [
        UnknownGroup("lens", start.lenses, LENS, keys=table.cameras, fixed=held, units=UNITS),
        pose_group("camera", start.cameras, keys, fixed=still),
        pose_group("board", start.boards, tuple(f"picture {p}" for p in table.pictures), local=True),
    ]
    loss, width, sigma = "linear", 1.0, table.sigma
    if loss_sigma is not None:
        loss, width = "huber", fit.width
        sigma = np.full(table.n, loss_sigma) if sigma is None else sigma * loss_sigma
    sees = [("lens", table.camera), ("camera", table.camera), ("board", table.picture)]
    data = np.hstack([table.X, table.uv])
    block = ResidualBlock("corners", board_view(), sees, data, sigma=sigma, loss=loss, width=width)
    return bundle_fit(groups, [block], limit=fit.limit, stop=stop, covariance=loss_sigma is None)


def started_at(fit: BundleFit) -> CameraStarts:
    """Return the result of a fit as starting values of the next."""
    return CameraStarts(fit.values["lens"], fit.values["camera"], fit.values["board"])


ROUNDS = 8
# iterations of a first fit, and its noise [pixel], so large that Huber's loss is quadratic for all corners
ROUGH_STEPS, PLAIN = 6, 1e3
AWAY = 5.0  # factor on the usual error of the starting values, which is due to lens distortion
LEFT = 3  # pictures that a fit needs


def uneven(table: CornerTable, residuals: np.ndarray) -> bool:
    """Return whether a picture has much larger residuals than most, so that only a robust fit can show whether it is
    wrong."""
    length = np.linalg.norm(residuals, axis=1)
    size = [float(np.median(length[table.picture == p])) for p in np.unique(table.picture)]
    return max(size) > SPREAD * float(np.median(size))


def suspects(table: CornerTable, start: CameraStarts) -> list[int]:
    """Return pictures that the starting values predict much worse than most, so that a fit must not start with them:
    exchanged between cameras, mirrored, or taken at another time."""
    worst = np.array([_off(table, p, start, start.boards[p]) for p in range(len(table.pictures))])
    return np.flatnonzero(worst > AWAY * np.median(worst)).tolist()


def _off(table: CornerTable, picture: int, start: CameraStarts, board: np.ndarray) -> float:
    """Return the median distance [pixel] of corners from their prediction for a board pose (7,); worst camera."""
    worst = 0.0
    for c in np.unique(table.camera[table.picture == picture]):
        rows = (table.camera == c) & (table.picture == picture)
        view = composed(start.cameras[c][None], board[None])
        uv, status = project(table.X[rows] @ matrices_of(view)[0].T + view[0, 4:], start.lenses[c])
        off = np.linalg.norm(uv - table.uv[rows], axis=1)
        worst = max(worst, float(np.median(np.where((status == 0) & np.isfinite(off), off, np.inf))))
    return worst


def without_gross_errors(
    table: CornerTable, start: CameraStarts, fit: CameraFit, stop: Callable[[], bool] | None
) -> tuple[CameraStarts, GrossErrors]:
    """Return the result of robust fits, repeated until the noise settles, and the gross errors.

    Suspect pictures are tested only after the cameras have been calibrated with the other pictures.
    """
    away = suspects(table, start)
    rest = [p for p in range(len(table.pictures)) if p not in away]
    if not away or len(rest) < LEFT:
        return _settled(table, start, fit, stop)
    known, bad = _settled(_pictures(table, rest), replace(start, boards=start.boards[rest]), fit, stop)
    boards = start.boards.copy()
    boards[rest] = known.boards
    sigma = 1.0 if table.sigma is None else float(np.median(table.sigma))
    wrong = []
    for p in away:
        placed = []
        for c in np.unique(table.camera[table.picture == p]):
            rows = (table.camera == c) & (table.picture == p)
            if rows.sum() >= LEAST:
                view = board_pose(table.X[rows], table.uv[rows], known.lenses[c])
                placed.append(composed(inverse_poses(known.cameras[c][None]), view[None])[0])
        boards[p] = min(placed, key=lambda board: _off(table, p, known, board), default=boards[p])
        if _off(table, p, known, boards[p]) > SPREAD * fit.gross * bad.noise * sigma:
            wrong.append(p)
    right = [p for p in range(len(table.pictures)) if p not in wrong]
    if right != rest:
        known, bad = _settled(_pictures(table, right), replace(known, boards=boards[right]), fit, stop)
    boards[right] = known.boards
    corners = np.isin(table.picture, wrong)
    corners[~corners] = bad.corners
    pictures = sorted([*wrong, *(right[p] for p in bad.pictures)])
    return replace(known, boards=boards), replace(bad, corners=corners, pictures=tuple(pictures))


def _pictures(table: CornerTable, which: list[int]) -> CornerTable:
    others = [name for p, name in enumerate(table.pictures) if p not in which]
    return table.rows(np.flatnonzero(np.isin(table.picture, which))).without(others)


def _settled(
    table: CornerTable, start: CameraStarts, fit: CameraFit, stop: Callable[[], bool] | None
) -> tuple[CameraStarts, GrossErrors]:
    plain = calibrated(table, start, replace(fit, limit=ROUGH_STEPS), loss_sigma=PLAIN, stop=stop)
    noise = 0.0
    for _ in range(ROUNDS):
        start = started_at(plain)
        bad = gross_errors(table, plain.residuals["corners"], fit.gross)
        if abs(bad.noise - noise) <= SETTLED * bad.noise:
            break
        noise = max(bad.noise, 1e-9)
        plain = calibrated(table, start, fit, loss_sigma=noise, stop=stop)
    return started_at(plain), gross_errors(table, plain.residuals["corners"], fit.gross)
