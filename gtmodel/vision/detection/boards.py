"""Chessboards, and chessboards with coded marks, by OpenCV."""

from __future__ import annotations

import numpy as np

from .detection import Detection, DetectionStatus
from .opencv import charuco_board, opencv
from .targets import Charuco, Chessboard

SIGMA = 0.05  # pixel: the most that rendered pictures with a noise of 2 of 255 show (tests/vision)
STOP = 1e-6  # pixel
LEAST_MARKS = 6  # of a board with coded marks


def detect_chessboard(picture: np.ndarray, target: Chessboard) -> Detection:
    """All inner corners, mark 0 where the painting says; partly visible where a smaller board is there."""
    cv2 = opencv()
    image = np.ascontiguousarray(picture, np.uint8)
    corners = _corners(image, target.columns, target.rows)
    if corners is None:
        for less in ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 2)):
            columns, rows = target.columns - less[0], target.rows - less[1]
            if min(columns, rows) >= 3 and _corners(image, columns, rows) is not None:
                return Detection(DetectionStatus.PARTLY_VISIBLE)
        return Detection(DetectionStatus.NOT_SEEN)
    grid = corners.reshape(target.rows, target.columns, 2)
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:  # a mirror image of the order
        grid = grid[::-1]
    if _level(image, grid[0, 0], grid[1, 1]) > _level(image, grid[0, 1], grid[1, 2]):  # the first is white
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
    seen, corners = cv2.findChessboardCornersSB(image, (columns, rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not seen:
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
        seen, corners = cv2.findChessboardCorners(image, (columns, rows), flags=flags)
    return np.asarray(corners, float).reshape(-1, 2) if seen else None


def _level(image: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Median grey in the middle of the cell between two opposite corners."""
    x, y = np.rint((a + b) / 2).astype(int)
    cell = image[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
    return float(np.median(cell)) if cell.size else 255.0


def detect_charuco(picture: np.ndarray, target: Charuco) -> Detection:
    """The inner corners of the part that is visible, six or more."""
    cv2 = opencv()
    image = np.ascontiguousarray(picture, np.uint8)
    corners, numbers, markers, _ = cv2.aruco.CharucoDetector(charuco_board(target)).detectBoard(image)
    if numbers is None or len(numbers) < LEAST_MARKS:
        some = (numbers is not None and len(numbers) > 0) or (markers is not None and len(markers) > 0)
        return Detection(DetectionStatus.PARTLY_VISIBLE if some else DetectionStatus.NOT_SEEN)
    start = np.ascontiguousarray(np.asarray(corners).reshape(-1, 1, 2), np.float32)
    side = _spacing(start[:, 0].astype(float), np.ravel(numbers), target.columns - 1)
    window = int(np.clip(side * (1 - target.marker / target.side) / 2, 2, 5))  # to the coded marks and no further
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, STOP)
    fine = cv2.cornerSubPix(image, start.copy(), (window, window), (-1, -1), criteria).reshape(-1, 2).astype(float)
    kept = np.abs(fine - start[:, 0]).max(axis=1) < window
    marks = tuple(str(int(k)) for k, keep in zip(np.ravel(numbers), kept, strict=True) if keep)
    if len(marks) < LEAST_MARKS:
        return Detection(DetectionStatus.NOT_SEEN)
    return Detection(DetectionStatus.OK, marks, fine[kept], np.full(len(marks), SIGMA))


def _spacing(corners: np.ndarray, numbers: np.ndarray, columns: int) -> float:
    """Least distance of neighbouring corners."""
    row, column = np.divmod(numbers, columns)
    steps = np.abs(row[:, None] - row) + np.abs(column[:, None] - column)
    gaps = np.linalg.norm(corners[:, None] - corners, axis=2)
    return float(gaps[steps == 1].min(initial=40.0))
