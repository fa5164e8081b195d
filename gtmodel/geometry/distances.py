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
    half, u, rows = np.asarray(half, float), b - a, np.arange(len(a))
    with np.errstate(divide="ignore", invalid="ignore"):
        faces = np.concatenate([(side * half - a) / u for side in (-1.0, 1.0)], axis=1)
    faces = np.where(np.isfinite(faces), np.clip(faces, 0.0, 1.0), 0.0)
    t = np.sort(np.concatenate([faces, np.zeros((len(a), 1)), np.ones((len(a), 1))], axis=1), axis=1)
    p = a[:, None] + t[..., None] * u[:, None]
    slope = np.einsum("mki,mi->mk", p - np.clip(p, -half, half), u)
    # the derivative increases and is linear between the planes: its root lies where its sign changes
    k = np.clip((slope < 0).sum(axis=1), 1, t.shape[1] - 1)
    t0, t1, s0, s1 = t[rows, k - 1], t[rows, k], slope[rows, k - 1], slope[rows, k]
    root = np.where(s1 > s0, t0 - s0 * (t1 - t0) / np.where(s1 > s0, s1 - s0, 1.0), t0)
    p = a + np.clip(np.where(slope[:, 0] >= 0, 0.0, root), 0.0, 1.0)[:, None] * u
    on_box = np.clip(p, -half, half)
    return np.linalg.norm(p - on_box, axis=1), p, on_box


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
