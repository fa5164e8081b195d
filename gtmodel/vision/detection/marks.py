"""Detect the marks of a target in one picture, and collect those of many pictures in one table: camera, pose, mark, u,
v, sigma."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...results.refusal import ArgumentError
from .squares import detect_squares
from .targets import Charuco, Chessboard, Detection, DetectionStatus, FiveSquares, Target, charuco_board, opencv


def background(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """Return the median (rows, columns) of pictures with the tool at different places (Dressler 2012, Fig. 5.12: ten).

    Raises ArgumentError for fewer than three pictures, and for pictures of different sizes.

    >>> pictures = [np.full((2, 3), level, np.uint8) for level in (10, 20, 90)]
    >>> gt.vision.detection.background(pictures)[0]
    array([20., 20., 20.])
    """
    if len(pictures) < 3:
        raise ArgumentError(f"found {len(pictures)} pictures; expected at least three", "pictures")
    sizes = {np.shape(p) for p in pictures}
    if len(sizes) > 1:
        raise ArgumentError(f"found pictures of {len(sizes)} sizes; use pictures of one camera", "pictures")
    return np.median(np.stack([np.asarray(p, float) for p in pictures]), axis=0)


SIGMA = 0.05  # pixel: upper bound for rendered pictures with a noise of 2 of 255 (tests/vision)
STOP = 1e-6  # pixel
LEAST_MARKS = 6  # of a board with coded marks


def detect_chessboard(picture: np.ndarray, target: Chessboard) -> Detection:
    """Detect all inner corners; the pattern defines mark 0. PARTLY_VISIBLE if a smaller board is detected."""
    cv2 = opencv()
    image = np.ascontiguousarray(picture, np.uint8)
    corners = _corners(image, target.columns, target.rows)
    if corners is None:
        for missing in ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 2)):
            columns, rows = target.columns - missing[0], target.rows - missing[1]
            if min(columns, rows) >= 3 and _corners(image, columns, rows) is not None:
                return Detection(DetectionStatus.PARTLY_VISIBLE)
        return Detection(DetectionStatus.NOT_SEEN)
    grid = corners.reshape(target.rows, target.columns, 2)
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:  # mirrored order
        grid = grid[::-1]
    if _level(image, grid[0, 0], grid[1, 1]) > _level(image, grid[0, 1], grid[1, 2]):  # counted from the wrong end
        grid = grid[::-1, ::-1]
    start = np.ascontiguousarray(grid.reshape(-1, 1, 2), np.float32)
    spacing = min(np.linalg.norm(np.diff(grid, axis=k), axis=2).min() for k in (0, 1))
    window = int(np.clip(spacing / 3, 2, 5))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, STOP)
    fine = cv2.cornerSubPix(image, start, (window, window), (-1, -1), criteria).reshape(-1, 2).astype(float)
    if np.abs(fine - grid.reshape(-1, 2)).max() > 0.3 * spacing:
        return Detection(DetectionStatus.NOT_SEEN)
    return Detection(DetectionStatus.OK, target.marks, fine, np.full(len(fine), SIGMA))


def _corners(image: np.ndarray, columns: int, rows: int) -> np.ndarray | None:
    cv2 = opencv()
    success, corners = cv2.findChessboardCornersSB(image, (columns, rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not success:
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
        success, corners = cv2.findChessboardCorners(image, (columns, rows), flags=flags)
    return np.asarray(corners, float).reshape(-1, 2) if success else None


def _level(image: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Return the median grey level in the middle of the cell between two opposite corners."""
    x, y = np.rint((a + b) / 2).astype(int)
    cell = image[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
    return float(np.median(cell)) if cell.size else 255.0


def detect_charuco(picture: np.ndarray, target: Charuco) -> Detection:
    """Detect the visible inner corners, at least six."""
    cv2 = opencv()
    image = np.ascontiguousarray(picture, np.uint8)
    corners, numbers, markers, _ = cv2.aruco.CharucoDetector(charuco_board(target)).detectBoard(image)
    if numbers is None or len(numbers) < LEAST_MARKS:
        some = (numbers is not None and len(numbers) > 0) or (markers is not None and len(markers) > 0)
        return Detection(DetectionStatus.PARTLY_VISIBLE if some else DetectionStatus.NOT_SEEN)
    start = np.ascontiguousarray(np.asarray(corners).reshape(-1, 1, 2), np.float32)
    side = _spacing(start[:, 0].astype(float), np.ravel(numbers), target.columns - 1)
    window = int(np.clip(side * (1 - target.marker / target.side) / 2, 2, 5))  # must not reach beyond the coded marks
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, STOP)
    fine = cv2.cornerSubPix(image, start.copy(), (window, window), (-1, -1), criteria).reshape(-1, 2).astype(float)
    near = np.abs(fine - start[:, 0]).max(axis=1) < window
    marks = tuple(str(int(k)) for k, ok in zip(np.ravel(numbers), near, strict=True) if ok)
    if len(marks) < LEAST_MARKS:
        return Detection(DetectionStatus.NOT_SEEN)
    return Detection(DetectionStatus.OK, marks, fine[near], np.full(len(marks), SIGMA))


def _spacing(corners: np.ndarray, numbers: np.ndarray, columns: int) -> float:
    """Return the smallest distance of neighbouring corners."""
    row, column = np.divmod(numbers, columns)
    steps = np.abs(row[:, None] - row) + np.abs(column[:, None] - column)
    gaps = np.linalg.norm(corners[:, None] - corners, axis=2)
    return float(gaps[steps == 1].min(initial=40.0))


DARK, BRIGHT = 45.0, 225.0  # of 255: limits of the 99th and of the 1st percentile of a picture
SATURATED = 0.3  # share of pixels at 255


def detect(picture: np.ndarray, target: Target, background: np.ndarray | None = None) -> Detection:
    """Detect the marks of a target in an 8-bit grey picture (rows, columns) with subpixel accuracy.

    The status says if the picture is too dark or too bright, or if the target is not completely visible; for a
    `Charuco` a part of the board is enough. `background`: the median of pictures of the same camera, used only for
    FiveSquares. Raises ArgumentError if `picture` is not an 8-bit grey picture, or if OpenCV is not installed.

    >>> from gtmodel.vision import detection, rendering
    >>> tool = detection.FiveSquares(side=0.04)
    >>> camera = lambda p: 1400 * p[:, :2] / (p[:, 2:] + 1.5) + [319.5, 239.5]
    >>> picture = rendering.rendered(tool.layers, camera, (640, 480))
    >>> seen = detection.detect(picture, tool)
    >>> seen.status.name, bool(np.abs(seen.corners - camera(tool.points)).max() < 0.1)
    ('OK', True)
    >>> detection.detect(picture // 8, tool).message
    'the picture is too dark: light the target, or expose longer'
    """
    image = np.asarray(picture)
    if image.ndim != 2 or image.dtype != np.uint8:
        raise ArgumentError(
            f"found {image.dtype} of shape {image.shape}; expected an 8-bit grey picture (rows, columns)", "picture"
        )
    if background is not None and np.shape(background) != image.shape:
        raise ArgumentError(
            f"the background has shape {np.shape(background)} and the picture {image.shape}; use those of one camera",
            "background",
        )
    light = _light(image)
    if light is not None:
        return Detection(light)
    if isinstance(target, FiveSquares):
        return detect_squares(image, target, background)
    return detect_chessboard(image, target) if isinstance(target, Chessboard) else detect_charuco(image, target)


def _light(image: np.ndarray) -> DetectionStatus | None:
    """Return the status of a picture too dark or too bright for reliable edges."""
    low, high = np.percentile(image, [1, 99])
    if high < DARK:
        return DetectionStatus.TOO_DARK
    if low > BRIGHT or np.mean(image == 255) > SATURATED:
        return DetectionStatus.TOO_BRIGHT
    return None


COLUMNS = ("camera", "pose", "mark", "u", "v", "sigma")


class CornerRow(NamedTuple):
    """One corner in one picture: u, v and the standard deviation sigma of each [pixel]."""

    camera: str
    pose: str
    mark: str
    u: float
    v: float
    sigma: float


def detected_corners(
    pictures: Mapping[tuple[str, str], np.ndarray],
    target: Target,
    backgrounds: Mapping[str, np.ndarray] | None = None,
) -> tuple[list[CornerRow], dict[tuple[str, str], Detection]]:
    """Return the corners of all pictures in which the target was detected, and the Detection of each picture.

    `pictures` by camera and pose; `backgrounds` by camera, for FiveSquares. The Detection of a picture without corners
    states the reason.

    >>> from gtmodel.vision import detection, rendering
    >>> tool = detection.FiveSquares(side=0.04)
    >>> camera = lambda p: 1400 * p[:, :2] / (p[:, 2:] + 1.5) + [319.5, 239.5]
    >>> picture = rendering.rendered(tool.layers, camera, (640, 480))
    >>> rows, seen = detection.detected_corners({("left", "1"): picture, ("left", "2"): picture // 8}, tool)
    >>> len(rows), rows[0].mark, seen["left", "2"].status.name
    (20, '0.0', 'TOO_DARK')
    """
    rows, detections = list[CornerRow](), dict[tuple[str, str], Detection]()
    for (camera, pose), picture in pictures.items():
        d = detect(picture, target, None if backgrounds is None else backgrounds.get(camera))
        detections[camera, pose] = d
        rows += [CornerRow(camera, pose, mark, float(u), float(v), float(s))
                 for mark, (u, v), s in zip(d.marks, d.corners, d.sigma, strict=True)]  # fmt: skip
    return rows, detections


def corners_csv(rows: list[CornerRow], synthetic: str = "") -> str:
    """Return the table as CSV text, as a calibration of cameras reads it.

    `synthetic`: origin of synthetic pictures with seed and noise, for the first line; "" for real ones. Raises
    ArgumentError for an empty table.

    >>> row = gt.vision.detection.CornerRow("left", "1", "0.0", 244.42741, 94.16463, 0.05)
    >>> print(gt.vision.detection.corners_csv([row]), end="")
    camera,pose,mark,u,v,sigma
    left,1,0.0,244.42741,94.16463,0.05
    """
    if not rows:
        raise ArgumentError("there are no corners: the target was not detected in any picture", "rows")
    head = [f"# synthetic: {synthetic}"] if synthetic else []
    lines = [f"{r.camera},{r.pose},{r.mark},{r.u:.5f},{r.v:.5f},{r.sigma:.4g}" for r in rows]
    return "\n".join([*head, ",".join(COLUMNS), *lines, ""])
