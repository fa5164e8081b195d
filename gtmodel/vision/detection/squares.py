"""Detection of the five black squares of a tool: subpixel edges, corners as their intersections, and hypotheses of the
pattern from one square, validated by the others."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import numpy as np

from ..starts import linear_projection
from .targets import Detection, DetectionStatus, FiveSquares, opencv

STEP = 0.5  # pixel, along the profile across an edge
NEAR_CORNER = 2.5  # pixel from a corner within which the next side blurs the profile
LEAST_CONTRAST = 15.0  # of 255
LONG = 30.0  # pixel: longer sides are bent visibly by the lens distortion
CORRELATED = 2.0  # factor on the variance, as neighbouring points share pixels


@dataclass(frozen=True, eq=False)
class Sides:
    """Edges of S quadrilaterals: `good` (S, 4), corners (S, 4, 2) at their intersections [pixel], `sigma` (S, 4) of a
    corner's coordinate [pixel]."""

    good: np.ndarray
    corners: np.ndarray
    sigma: np.ndarray


def refined(picture: np.ndarray, quads: np.ndarray, reach: float = 4.0) -> Sides:
    """Refine the edges of dark quads (S, 4, 2); each iteration searches along the last edges."""
    corners = np.array(quads, float)
    good, sigma = np.zeros(corners.shape[:2], bool), np.full(corners.shape[:2], np.inf)
    bend = np.zeros(corners.shape[:2])
    for k in range(3):
        good, corners, sigma, bend = _once(picture, corners, bend, reach if k == 0 else min(reach, 3.5))
    return Sides(good, corners, sigma)


def _once(
    picture: np.ndarray, quads: np.ndarray, bend: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    a, b = quads, np.roll(quads, -1, axis=1)
    length = np.linalg.norm(b - a, axis=2)
    safe = np.maximum(length, 1e-9)
    along = (b - a) / safe[..., None]
    turned = along[:, 0, 0] * along[:, 1, 1] - along[:, 0, 1] * along[:, 1, 0]  # > 0: clockwise as seen, y down
    normal = np.stack([along[..., 1], -along[..., 0]], axis=2) * np.sign(turned)[:, None, None]  # outwards
    count = max(4, int(np.ceil(np.nanmax(np.where(np.isfinite(length), length, 0.0), initial=4.0))))
    s = (np.arange(count) + 0.5) / count * 2 - 1  # from -1 to 1 along a side
    used = np.abs(s)[None, None] * length[..., None] / 2 <= length[..., None] / 2 - NEAR_CORNER
    places = (a + b)[..., None, :] / 2 + (s[:, None] * (length / 2)[..., None, None]) * along[..., None, :]
    places = places + (bend[..., None] * (s**2 - 1))[..., None] * normal[..., None, :]
    offset, valid = _crossings(picture, places, normal, reach)
    used &= valid
    offset = offset + bend[..., None] * (s**2 - 1)
    enough = used.sum(axis=2) >= np.maximum(3, 0.7 * (length - 2 * NEAR_CORNER) / safe * count)
    straight = length < LONG
    fit, variance, rms = _fitted(s, offset, used, straight)
    good = enough & (rms < 0.5) & (length > 2 * NEAR_CORNER + 2)
    corners, var = _intersections(quads, fit, variance, length, along, normal)
    return good, corners, np.sqrt(var), fit[..., 2]


def _crossings(
    picture: np.ndarray, places: np.ndarray, normal: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the outward offsets (S, 4, P) [pixel] of the edge, from the area under the profile, and their validity."""
    from scipy.ndimage import map_coordinates

    d = np.arange(-reach, reach + STEP / 2, STEP)
    points = places[..., None, :] + d[:, None] * normal[..., None, None, :]
    height, width = picture.shape
    inside = np.all((points >= 0) & (points <= [width - 1, height - 1]), axis=(-1, -2))
    I = map_coordinates(picture, [points[..., 1], points[..., 0]], order=1, mode="nearest", output=float)
    dark, light = I[..., :3].mean(axis=-1), I[..., -3:].mean(axis=-1)
    contrast = light - dark
    valid = inside & (contrast > LEAST_CONTRAST)
    share = (I - dark[..., None]) / np.where(valid, contrast, 1.0)[..., None]
    area = STEP * (share.sum(axis=-1) - (share[..., 0] + share[..., -1]) / 2)
    offset = reach - area
    valid &= np.abs(offset) < 0.75 * reach
    return np.where(valid, offset, 0.0), valid


def _fitted(
    s: np.ndarray, offset: np.ndarray, used: np.ndarray, straight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit offset = c0 + c1 s + c2 s^2, with c2 = 0 for straight sides; return c, its covariance, the rms residual."""
    V = np.stack([np.ones_like(s), s, s**2], axis=1)
    w = used.astype(float)
    N = np.einsum("...p,pi,pj->...ij", w, V, V)
    N[straight, :2, 2] = N[straight, 2, :2] = 0.0
    N[..., 2, 2] = np.where(straight, 1.0, N[..., 2, 2]) + 1e-12
    N = N + 1e-12 * np.eye(3)
    rhs = np.einsum("...p,pi,...p->...i", w, V, offset)
    rhs[straight, 2] = 0.0
    fit = np.linalg.solve(N, rhs[..., None])[..., 0]
    residual = w * (offset - fit @ V.T)
    dof = np.maximum(w.sum(axis=-1) - np.where(straight, 2, 3), 1)
    rms = np.sqrt((residual**2).sum(axis=-1) / dof)
    C = CORRELATED * rms[..., None, None] ** 2 * np.linalg.inv(N)
    C[straight, 2, :] = C[straight, :, 2] = 0.0
    return fit, C, rms


def _intersections(
    quads: np.ndarray, fit: np.ndarray, C: np.ndarray, length: np.ndarray, along: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return corner k, the intersection of sides k - 1 and k, and the mean variance of its coordinates."""
    half = np.maximum(length / 2, 1e-9)
    middle = (quads + np.roll(quads, -1, axis=1)) / 2
    before = lambda x: np.roll(x, 1, axis=1)  # noqa: E731
    corner = quads.copy()
    rows = np.stack([normal, before(normal)], axis=2)  # (S, 4, 2, 2)
    for _ in range(3):
        this = _tangent(corner - middle, fit, half, along, normal)
        last = _tangent(corner - before(middle), before(fit), before(half), before(along), before(normal))
        rows = np.stack([this[0], last[0]], axis=2)
        values = np.stack([this[1], last[1]], axis=2)
        flat = np.abs(np.linalg.det(rows)) < 0.1
        rows = np.where(flat[..., None, None], np.eye(2), rows)
        corner = corner - np.where(flat[..., None], 0.0, np.linalg.solve(rows, values[..., None])[..., 0])
    e0, e1 = np.array([1.0, -1.0, 1.0]), np.array([1.0, 1.0, 1.0])
    v = np.stack([np.einsum("i,...ij,j->...", e0, C, e0), np.einsum("i,...ij,j->...", e1, before(C), e1)], axis=2)
    G = np.linalg.inv(rows)
    return corner, np.einsum("...ij,...j->...", G**2, v) / 2


def _tangent(
    d: np.ndarray, fit: np.ndarray, half: np.ndarray, along: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return gradient and value of n.d - offset(s) at a point d relative to the middle of a side."""
    s = np.einsum("...i,...i->...", d, along) / half
    value = np.einsum("...i,...i->...", d, normal) - (fit[..., 0] + fit[..., 1] * s + fit[..., 2] * s**2)
    slope = (fit[..., 1] + 2 * fit[..., 2] * s) / half
    return normal - slope[..., None] * along, value


CHANGED = 12.0  # of 255: difference from the background that makes a pixel foreground
SMALLEST = 7.0  # pixel, of a side
NEAR = 0.35  # largest distance of a candidate from its place in the pattern, in sides of the square
TRIED = 2000  # hypotheses at most, starting with the largest candidates


def detect_squares(picture: np.ndarray, target: FiveSquares, background: np.ndarray | None) -> Detection:
    """Detect the marks of a tool with squares; PARTLY_VISIBLE if only a part of the pattern can be validated."""
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
        # the threshold may have merged squares with other objects although their sides are visible
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
    """Return dark quadrilaterals (n, 4, 2), clockwise in the picture, from several thresholds."""
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
    """Return each square once, although several thresholds may have detected it; largest first."""
    unique = list[np.ndarray]()
    sizes = np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1) if len(corners) else np.zeros(0)
    for k in np.argsort(-sizes, kind="stable"):
        middle = corners[k].mean(axis=0)
        if all(np.linalg.norm(middle - other.mean(axis=0)) > 2.0 for other in unique):
            unique.append(corners[k])
    return np.array(unique).reshape(-1, 4, 2)


def _hypothesis(corners: np.ndarray, target: FiveSquares) -> tuple[np.ndarray, int] | None:
    """Return the homography under which most squares of the pattern match a candidate, fitted to all of them."""
    squares = target.squares[..., :2]
    middles = corners.mean(axis=1)
    best: tuple[int, float, np.ndarray] | None = None
    hypotheses = ((c, k, turn) for c in corners for k in range(len(squares)) for turn in range(4))
    for candidate, k, turn in islice(hypotheses, TRIED):
        H, _ = linear_projection(squares[k], np.roll(candidate, turn, axis=0))
        H, many, error = _grown(H, squares, corners, middles, k)
        if best is None or (many, -error) > (best[0], -best[1]):
            best = many, error, H
        if many == len(squares):
            break
    if best is None or best[0] < 2:
        return None
    return best[2], best[0]


def _grown(
    H: np.ndarray, squares: np.ndarray, corners: np.ndarray, middles: np.ndarray, first: int
) -> tuple[np.ndarray, int, float]:
    """Add the squares that match a candidate, starting with the nearest to the first, and refit after each."""
    centre = squares.mean(axis=1)
    order = np.argsort(np.linalg.norm(centre - centre[first], axis=1), kind="stable")
    matched, matches = list[np.ndarray](), list[np.ndarray]()
    error = 0.0
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
        matched.append(squares[k])
        matches.append(turned[int(np.argmin(off))])
        H, _ = linear_projection(np.concatenate(matched), np.concatenate(matches))
        error = float(np.abs(_mapped(H, np.array(matched)) - np.array(matches)).max())
        if error > 0.15 * size + 0.5:
            return H, 0, error
    return H, len(matched), error


def _mapped(H: np.ndarray, points: np.ndarray) -> np.ndarray:
    p = points[..., :2] @ H[:, :2].T + H[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return p[..., :2] / p[..., 2:]


def _leaves(corners: np.ndarray, shape: tuple[int, ...]) -> bool:
    """Return whether a part of the pattern is outside the picture."""
    return bool(np.any((corners < 1) | (corners > np.array(shape)[::-1] - 2)))
