"""The five black squares of a tool: candidates, one hypothesis of the pattern, validated by all of its sides.

Dressler 2012, section 5.5: foreground against the median of pictures, elements like black squares, a hypothesis of the
pattern from each, validated by a search for all 20 sides with sub-pixel edges.
"""

from __future__ import annotations

from itertools import islice

import numpy as np

from ..starts import linear_projection
from .detection import Detection, DetectionStatus
from .edges import refined
from .opencv import opencv
from .targets import FiveSquares

CHANGED = 12.0  # of 255 from the background: foreground
SMALLEST = 7.0  # pixel, of a side
NEAR = 0.35  # of a square's side in the picture: so near lies a candidate to where the pattern has one
TRIED = 2000  # hypotheses at most, the largest candidates first


def detect_squares(picture: np.ndarray, target: FiveSquares, background: np.ndarray | None) -> Detection:
    """Marks of a tool of squares; partly visible where a pattern is validated by what is left of it."""
    image = np.asarray(picture, float)
    quads = _candidates(picture, background)
    if not len(quads):
        return Detection(DetectionStatus.NOT_SEEN)
    sides = refined(image, quads)
    whole = sides.good.all(axis=1)
    quads, corners = quads[whole], sides.corners[whole]
    corners = _distinct(corners)
    best = _hypothesis(corners, target)
    if best is None:
        return Detection(DetectionStatus.NOT_SEEN)
    H, many = best
    expected = _mapped(H, target.squares)
    if many < len(expected):
        # candidates that the threshold joined with something: their sides may be there all the same
        sides = refined(image, expected)
        if not sides.good.all():
            part = many >= 2 or _leaves(expected, image.shape)
            return Detection(DetectionStatus.PARTLY_VISIBLE if part else DetectionStatus.NOT_SEEN)
        H, _ = linear_projection(target.squares.reshape(-1, 3)[:, :2], sides.corners.reshape(-1, 2))
        expected = _mapped(H, target.squares)
    sides = refined(image, expected, reach=3.5)
    moved = np.abs(sides.corners - expected).max(initial=0.0)
    size = np.linalg.norm(np.roll(expected, -1, axis=1) - expected, axis=2).min()
    if not sides.good.all() or moved > max(1.5, 0.1 * size):
        return Detection(DetectionStatus.PARTLY_VISIBLE if many >= 2 else DetectionStatus.NOT_SEEN)
    return Detection(DetectionStatus.OK, target.marks, sides.corners.reshape(-1, 2), sides.sigma.reshape(-1))


def _candidates(picture: np.ndarray, background: np.ndarray | None) -> np.ndarray:
    """Four-sided dark shapes (n, 4, 2), clockwise as seen, by several thresholds."""
    cv2 = opencv()
    image = np.asarray(picture, np.uint8)
    smooth = cv2.GaussianBlur(image, (3, 3), 0)
    masks = [cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)[1]]
    for size in (21, 51, 101):
        masks.append(cv2.adaptiveThreshold(smooth, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, size, 7))
    if background is not None:
        changed = np.abs(np.asarray(picture, float) - background) > CHANGED
        near = cv2.dilate(changed.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
        masks = [np.where(near, m, 0).astype(np.uint8) for m in masks]
    quads = list[np.ndarray]()
    for mask in masks:
        for contour in cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]:
            around = cv2.arcLength(contour, True)
            if around < 4 * SMALLEST:
                continue
            corners = cv2.approxPolyDP(contour, 0.06 * around, True)[:, 0].astype(float)
            if len(corners) == 4 and cv2.isContourConvex(corners.astype(np.float32)):
                lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
                if lengths.min() >= SMALLEST and lengths.max() < 4 * lengths.min():
                    quads.append(_clockwise(corners))
    return np.array(quads).reshape(-1, 4, 2)


def _clockwise(q: np.ndarray) -> np.ndarray:
    (a, b), (c, d) = q[1] - q[0], q[2] - q[1]
    return q if a * d - b * c > 0 else q[::-1]


def _distinct(corners: np.ndarray) -> np.ndarray:
    """One of each square that several thresholds gave; largest first."""
    kept = list[np.ndarray]()
    sizes = np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1) if len(corners) else np.zeros(0)
    for k in np.argsort(-sizes, kind="stable"):
        middle = corners[k].mean(axis=0)
        if all(np.linalg.norm(middle - other.mean(axis=0)) > 2.0 for other in kept):
            kept.append(corners[k])
    return np.array(kept).reshape(-1, 4, 2)


def _hypothesis(corners: np.ndarray, target: FiveSquares) -> tuple[np.ndarray, int] | None:
    """The homography under which most squares of the pattern meet a candidate, refitted to all of these."""
    squares = target.squares[..., :2]
    middles = corners.mean(axis=1)
    best: tuple[int, float, np.ndarray] | None = None
    hypotheses = ((c, k, turn) for c in corners for k in range(len(squares)) for turn in range(4))
    for candidate, k, turn in islice(hypotheses, TRIED):
        H, _ = linear_projection(squares[k], np.roll(candidate, turn, axis=0))
        H, many, rest = _grown(H, squares, corners, middles, k)
        if best is None or (many, -rest) > (best[0], -best[1]):
            best = many, rest, H
        if many == len(squares):
            break
    if best is None or best[0] < 2:
        return None
    return best[2], best[0]


def _grown(
    H: np.ndarray, squares: np.ndarray, corners: np.ndarray, middles: np.ndarray, first: int
) -> tuple[np.ndarray, int, float]:
    """Adds the squares that meet a candidate, the nearest to the first one first, refitting after each."""
    centre = squares.mean(axis=1)
    order = np.argsort(np.linalg.norm(centre - centre[first], axis=1), kind="stable")
    met_from, met_to = list[np.ndarray](), list[np.ndarray]()
    rest = 0.0
    for k in order:
        expected = _mapped(H, squares[k])
        size = np.linalg.norm(np.roll(expected, -1, axis=0) - expected, axis=1).min()
        gaps = np.linalg.norm(middles - expected.mean(axis=0), axis=1)
        near = int(np.argmin(gaps))
        if not np.isfinite(size) or gaps[near] > NEAR * size + 1.0:
            continue
        turned = [np.roll(corners[near], t, axis=0) for t in range(4)]
        off = [float(np.abs(c - expected).max()) for c in turned]
        if min(off) > 0.5 * size:
            continue
        met_from.append(squares[k])
        met_to.append(turned[int(np.argmin(off))])
        H, _ = linear_projection(np.concatenate(met_from), np.concatenate(met_to))
        rest = float(np.abs(_mapped(H, np.array(met_from)) - np.array(met_to)).max())
        if rest > 0.15 * size + 0.5:
            return H, 0, rest
    return H, len(met_from), rest


def _mapped(H: np.ndarray, points: np.ndarray) -> np.ndarray:
    p = points[..., :2] @ H[:, :2].T + H[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return p[..., :2] / p[..., 2:]


def _leaves(corners: np.ndarray, shape: tuple[int, ...]) -> bool:
    """Whether a part of the pattern is outside the picture."""
    return bool(np.any((corners < 1) | (corners > np.array(shape)[::-1] - 2)))
