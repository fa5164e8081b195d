"""Distances between links, beams and boxes, all rows at once."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def between_segments(p1: Array, p2: Array, r1: Array, r2: Array) -> Array:
    """Least distance [m] (n,) between segments p1-p2 and r1-r2, each end (n, 3); segments may be points.

    The least lies inside both segments or at an end of one: the four ends against the other segment, and the feet of
    the common perpendicular where both lie within.
    """
    ends = [_to_segment(p1, r1, r2), _to_segment(p2, r1, r2), _to_segment(r1, p1, p2), _to_segment(r2, p1, p2)]
    least = np.min(ends, axis=0)
    d, e, w = p2 - p1, r2 - r1, p1 - r1
    a, b, c = _dot(d, d), _dot(d, e), _dot(e, e)
    f, g = _dot(d, w), _dot(e, w)
    determinant = a * c - b * b
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = (b * g - c * f) / determinant, (a * g - b * f) / determinant
        inside = (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
        gap = w + s[:, None] * d - t[:, None] * e
        # rounding makes s and t of nearly parallel segments arbitrary, but the gap is that of two true points
        return np.where(inside, np.minimum(least, np.sqrt(_dot(gap, gap))), least)


def segment_to_box(p1: Array, p2: Array, low: Array, high: Array) -> Array:
    """Least distance [m] (n,) between segments p1-p2 (n, 3) and a box with sides along the axes; 0 where they meet.

    The squared distance along the segment is convex and piecewise quadratic; between the parameters at which it
    enters or leaves the slabs of the box its minimum is exact.
    """
    d = p2 - p1
    with np.errstate(divide="ignore", invalid="ignore"):
        cuts = np.concatenate([(low - p1) / d, (high - p1) / d], axis=1)
    cuts = np.where(np.isfinite(cuts), np.clip(cuts, 0.0, 1.0), 0.0)
    n = len(p1)
    t = np.sort(np.concatenate([np.zeros((n, 1)), cuts, np.ones((n, 1))], axis=1), axis=1)
    slope = np.einsum("nki,ni->nk", _outside(p1[:, None] + t[..., None] * d[:, None], low, high), d)
    # the derivative is increasing and piecewise linear: its root lies in the interval where the sign changes
    k = np.clip((slope < 0).sum(axis=1), 1, t.shape[1] - 1)
    row = np.arange(n)
    t0, t1, s0, s1 = t[row, k - 1], t[row, k], slope[row, k - 1], slope[row, k]
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.where(s1 > s0, t0 - s0 * (t1 - t0) / (s1 - s0), t0)
    best = np.clip(np.where(slope[:, 0] >= 0, 0.0, root), 0.0, 1.0)
    gap = _outside(p1 + best[:, None] * d, low, high)
    return np.where(np.isfinite(p1 + p2).all(axis=1), np.sqrt(_dot(gap, gap)), np.nan)


def _outside(p: Array, low: Array, high: Array) -> Array:
    """Vector from the nearest point of the box to p; zero inside."""
    return np.minimum(p - low, 0.0) + np.maximum(p - high, 0.0)


def _to_segment(p: Array, r1: Array, r2: Array) -> Array:
    e, w = r2 - r1, p - r1
    length = _dot(e, e)
    t = np.clip(np.divide(_dot(w, e), length, out=np.zeros_like(length), where=length > 0), 0.0, 1.0)
    gap = w - t[:, None] * e
    return np.sqrt(_dot(gap, gap))


def _dot(x: Array, y: Array) -> Array:
    return np.einsum("ni,ni->n", x, y)
