"""Edges from dark to light to a fraction of a pixel, and corners where two of them meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STEP = 0.5  # pixel, along the profile across an edge
NEAR_CORNER = 2.5  # pixel: there the blur of the next side reaches
LEAST_CONTRAST = 15.0  # of 255
LONG = 30.0  # pixel: the distortion of a lens bends longer sides by more than their noise
CORRELATED = 2.0  # points a pixel apart share pixels: their variance counts as of this many fewer points


@dataclass(frozen=True, eq=False)
class Sides:
    """Edges of S polygons with 4 sides, as offsets from their chords: `good` (S, 4), corners (S, 4, 2) where neighbours
    meet [pixel], `sigma` (S, 4) of a corner's coordinate."""

    good: np.ndarray
    corners: np.ndarray
    sigma: np.ndarray


def refined(picture: np.ndarray, quads: np.ndarray, reach: float = 4.0) -> Sides:
    """Edges near those of quads (S, 4, 2), dark inside; each iteration looks along the last ones."""
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
    offset, seen = _crossings(picture, places, normal, reach)
    used &= seen
    offset = offset + bend[..., None] * (s**2 - 1)
    enough = used.sum(axis=2) >= np.maximum(3, 0.7 * (length - 2 * NEAR_CORNER) / safe * count)
    straight = length < LONG
    fit, variance, rms = _fitted(s, offset, used, straight)
    good = enough & (rms < 0.5) & (length > 2 * NEAR_CORNER + 2)
    corners, var = _met(quads, fit, variance, length, along, normal)
    return good, corners, np.sqrt(var), fit[..., 2]


def _crossings(
    picture: np.ndarray, places: np.ndarray, normal: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (S, 4, P) [pixel] outwards of the edge, by the area under the profile, and where there is one."""
    from scipy.ndimage import map_coordinates

    d = np.arange(-reach, reach + STEP / 2, STEP)
    at = places[..., None, :] + d[:, None] * normal[..., None, None, :]
    height, width = picture.shape
    inside = np.all((at >= 0) & (at <= [width - 1, height - 1]), axis=(-1, -2))
    I = map_coordinates(picture, [at[..., 1], at[..., 0]], order=1, mode="nearest", output=float)
    dark, light = I[..., :3].mean(axis=-1), I[..., -3:].mean(axis=-1)
    contrast = light - dark
    seen = inside & (contrast > LEAST_CONTRAST)
    share = (I - dark[..., None]) / np.where(seen, contrast, 1.0)[..., None]
    area = STEP * (share.sum(axis=-1) - (share[..., 0] + share[..., -1]) / 2)
    offset = reach - area
    seen &= np.abs(offset) < 0.75 * reach
    return np.where(seen, offset, 0.0), seen


def _fitted(
    s: np.ndarray, offset: np.ndarray, used: np.ndarray, straight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Offset = c0 + c1 s + c2 s^2 by least squares, c2 = 0 for straight sides; covariance of it, rms of the rest."""
    V = np.stack([np.ones_like(s), s, s**2], axis=1)
    w = used.astype(float)
    N = np.einsum("...p,pi,pj->...ij", w, V, V)
    N[straight, :2, 2] = N[straight, 2, :2] = 0.0
    N[..., 2, 2] = np.where(straight, 1.0, N[..., 2, 2]) + 1e-12
    N = N + 1e-12 * np.eye(3)
    rhs = np.einsum("...p,pi,...p->...i", w, V, offset)
    rhs[straight, 2] = 0.0
    fit = np.linalg.solve(N, rhs[..., None])[..., 0]
    rest = w * (offset - fit @ V.T)
    free = np.maximum(w.sum(axis=-1) - np.where(straight, 2, 3), 1)
    rms = np.sqrt((rest**2).sum(axis=-1) / free)
    C = CORRELATED * rms[..., None, None] ** 2 * np.linalg.inv(N)
    C[straight, 2, :] = C[straight, :, 2] = 0.0
    return fit, C, rms


def _met(
    quads: np.ndarray, fit: np.ndarray, C: np.ndarray, length: np.ndarray, along: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Corner k, where side k begins and side k - 1 ends, and the mean variance of its coordinates."""
    half = np.maximum(length / 2, 1e-9)
    middle = (quads + np.roll(quads, -1, axis=1)) / 2
    before = lambda x: np.roll(x, 1, axis=1)  # noqa: E731
    corner = quads.copy()
    rows = np.stack([normal, before(normal)], axis=2)  # (S, 4, 2, 2)
    for _ in range(3):
        here, last = corner - middle, corner - before(middle)
        own = _tangent(here, fit, half, along, normal)
        other = _tangent(last, before(fit), before(half), before(along), before(normal))
        rows = np.stack([own[0], other[0]], axis=2)
        rest = np.stack([own[1], other[1]], axis=2)
        flat = np.abs(np.linalg.det(rows)) < 0.1
        rows = np.where(flat[..., None, None], np.eye(2), rows)
        corner = corner - np.where(flat[..., None], 0.0, np.linalg.solve(rows, rest[..., None])[..., 0])
    e0, e1 = np.array([1.0, -1.0, 1.0]), np.array([1.0, 1.0, 1.0])
    v = np.stack([np.einsum("i,...ij,j->...", e0, C, e0), np.einsum("i,...ij,j->...", e1, before(C), e1)], axis=2)
    G = np.linalg.inv(rows)
    return corner, np.einsum("...ij,...j->...", G**2, v) / 2


def _tangent(
    d: np.ndarray, fit: np.ndarray, half: np.ndarray, along: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient and value of n.d - offset(s) at a point d from the middle of a side."""
    s = np.einsum("...i,...i->...", d, along) / half
    value = np.einsum("...i,...i->...", d, normal) - (fit[..., 0] + fit[..., 1] * s + fit[..., 2] * s**2)
    slope = (fit[..., 1] + 2 * fit[..., 2] * s) / half
    return normal - slope[..., None] * along, value
