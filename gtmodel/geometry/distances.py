"""Distances of segments from segments, boxes and planes, exact, for many rows at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

Array = np.ndarray
Nearest = tuple[Array, Array, Array]


def segment_to_segment(a: ArrayLike, b: ArrayLike, c: ArrayLike, d: ArrayLike) -> Nearest:
    """Return distances (m,) [m] of the segments a-b and c-d (m, 3), and a pair of nearest points (m, 3) each.

    A segment may be a point. Among parallel segments one of the nearest pairs is returned.

    >>> from gtmodel.geometry.distances import segment_to_segment
    >>> distance, on_first, on_second = segment_to_segment([[-1, 0, 0]], [[1, 0, 0]], [[0, 0, 2]], [[0, 3, 2]])
    >>> distance, on_first
    (array([2.]), array([[0., 0., 0.]]))
    """
    a, b, c, d = (np.atleast_2d(np.asarray(x, float)) for x in (a, b, c, d))
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (np.einsum("mi,mi->m", x, y) for x, y in ((u, u), (v, v), (u, v)))
    uw, vw = np.einsum("mi,mi->m", u, w), np.einsum("mi,mi->m", v, w)
    square = uu * vv - uv**2

    def onto_second(s: Array) -> Array:
        return np.clip((uv * s + vw) / np.where(vv > 0, vv, 1.0), 0.0, 1.0)

    def onto_first(t: Array) -> Array:
        return np.clip((uv * t - uw) / np.where(uu > 0, uu, 1.0), 0.0, 1.0)

    # the nearest points of the lines if these lie inside, else an end of one segment and the nearest point of the other
    inside = np.clip((uv * vw - vv * uw) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    zero, one = np.zeros_like(uu), np.ones_like(uu)
    pairs = [(x, onto_second(x)) for x in (inside, zero, one)] + [(onto_first(x), x) for x in (zero, one)]
    s, t = (np.stack(x) for x in zip(*pairs, strict=True))
    first, second = a + s[..., None] * u, c + t[..., None] * v
    distances = np.linalg.norm(first - second, axis=2)
    best, rows = np.argmin(distances, axis=0), np.arange(len(uu))
    return distances[best, rows], first[best, rows], second[best, rows]


def segment_to_box(a: ArrayLike, b: ArrayLike, half: ArrayLike) -> Nearest:
    """Return distances (m,) [m] of the segments a-b (m, 3) from the box |x_i| <= half_i, and nearest points (m, 3) on
    segment and box. The distance is 0 where they meet.

    The squared distance along a segment is convex and quadratic between the planes of the faces.

    >>> from gtmodel.geometry.distances import segment_to_box
    >>> segment_to_box([[2.0, -1.0, 0.0]], [[2.0, 1.0, 0.0]], [0.5, 0.5, 0.5])[0]
    array([1.5])
    """
    a, b = (np.atleast_2d(np.asarray(x, float)) for x in (a, b))
    half, u = np.asarray(half, float), b - a
    with np.errstate(divide="ignore", invalid="ignore"):
        faces = np.concatenate([(side * half - a) / u for side in (-1.0, 1.0)], axis=1)
    edges = np.clip(np.nan_to_num(faces, nan=0.0, posinf=0.0, neginf=0.0), 0.0, 1.0)
    edges = np.sort(np.concatenate([edges, np.zeros((len(a), 1)), np.ones((len(a), 1))], axis=1), axis=1)
    least, best = np.full(len(a), np.inf), np.zeros(len(a))
    for k in range(edges.shape[1] - 1):
        low, high = edges[:, k], edges[:, k + 1]
        x = a + ((low + high) / 2)[:, None] * u
        out = np.abs(x) > half  # coordinates that count between these faces
        offset = np.where(out, a - np.sign(x) * half, 0.0)
        slope = np.where(out, u, 0.0)
        steep = np.einsum("mi,mi->m", slope, slope)
        s = -np.einsum("mi,mi->m", slope, offset) / np.where(steep > 0, steep, 1.0)
        s = np.clip(np.where(steep > 0, s, low), low, high)
        p = a + s[:, None] * u
        square = np.sum(np.maximum(np.abs(p) - half, 0.0) ** 2, axis=1)
        better = square < least
        least, best = np.where(better, square, least), np.where(better, s, best)
    p = a + best[:, None] * u
    return np.sqrt(least), p, np.clip(p, -half, half)


def bounding_capsule(size: ArrayLike) -> tuple[float, int, float]:
    """Return half length [m], axis (0, 1, 2) and radius [m] of the capsule around a centred box with edges size (3).

    The capsule's segment is the box's longest midline, its radius half the diagonal of the other two edges.

    >>> from gtmodel.geometry.distances import bounding_capsule
    >>> bounding_capsule([0.06, 0.5, 0.08])
    (0.25, 1, 0.05)
    """
    size = np.asarray(size, float)
    axis = int(np.argmax(size))
    return float(size[axis]) / 2, axis, float(np.linalg.norm(np.delete(size, axis))) / 2
