"""Clearance of the links from obstacles, from one another and from the beams of the frame, for many poses at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from ..mechanism import Array, Poses


def between_segments(p1: Array, p2: Array, r1: Array, r2: Array) -> Array:
    """Return the distance [m] (n,) between segments p1-p2 and r1-r2, each end (n, 3); segments may be points.

    It is the smallest distance of the four ends from the other segment, or the length of the common perpendicular if
    its feet lie within both segments.
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
        # for nearly parallel segments s and t are arbitrary, but the gap still is the distance of two points on them
        return np.where(inside, np.minimum(least, np.sqrt(_dot(gap, gap))), least)


def segment_to_box(p1: Array, p2: Array, low: Array, high: Array) -> Array:
    """Return the distance [m] (n,) between segments p1-p2 (n, 3) and a box with sides along the axes; 0 if they meet.

    The squared distance along the segment is convex and quadratic between the parameters at which the segment enters or
    leaves the slabs of the box; its minimum is computed exactly.
    """
    d = p2 - p1
    with np.errstate(divide="ignore", invalid="ignore"):
        cuts = np.concatenate([(low - p1) / d, (high - p1) / d], axis=1)
    cuts = np.where(np.isfinite(cuts), np.clip(cuts, 0.0, 1.0), 0.0)
    n = len(p1)
    t = np.sort(np.concatenate([np.zeros((n, 1)), cuts, np.ones((n, 1))], axis=1), axis=1)
    slope = np.einsum("nki,ni->nk", _outside(p1[:, None] + t[..., None] * d[:, None], low, high), d)
    # the derivative is increasing and piecewise linear; its root lies in the interval with a change of sign
    k = np.clip((slope < 0).sum(axis=1), 1, t.shape[1] - 1)
    row = np.arange(n)
    t0, t1, s0, s1 = t[row, k - 1], t[row, k], slope[row, k - 1], slope[row, k]
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.where(s1 > s0, t0 - s0 * (t1 - t0) / (s1 - s0), t0)
    best = np.clip(np.where(slope[:, 0] >= 0, 0.0, root), 0.0, 1.0)
    gap = _outside(p1 + best[:, None] * d, low, high)
    return np.where(np.isfinite(p1 + p2).all(axis=1), np.sqrt(_dot(gap, gap)), np.nan)


def _outside(p: Array, low: Array, high: Array) -> Array:
    """Return the vector from the nearest point of the box to p; zero inside."""
    return np.minimum(p - low, 0.0) + np.maximum(p - high, 0.0)


def _to_segment(p: Array, r1: Array, r2: Array) -> Array:
    e, w = r2 - r1, p - r1
    length = _dot(e, e)
    t = np.clip(np.divide(_dot(w, e), length, out=np.zeros_like(length), where=length > 0), 0.0, 1.0)
    gap = w - t[:, None] * e
    return np.sqrt(_dot(gap, gap))


def _dot(x: Array, y: Array) -> Array:
    return np.einsum("ni,ni->n", x, y)


# bodies that touch are not clear of one another, even if their radii are zero [m]
TOUCHING = 1e-9


def _clear(distance: Array, radii: float) -> Array:
    return np.where(distance > 0, distance, -TOUCHING) - radii


@dataclass(frozen=True)
class Obstacles:
    """Links and plate stay clear of boxes with sides along the axes.

    Attributes:
        low, high: (k, 3) corners of the boxes [m].
        link_radius: (l,) of the links [m].
        plate_radius: of a sphere about the tool centre point that contains the plate [m].
        names: one per box, for messages.
    """

    low: Array
    high: Array
    link_radius: Array
    plate_radius: float = 0.0
    names: Sequence[str] = ()
    name: str = "obstacles"
    unit: str = "m"

    @property
    def assumes(self) -> str:
        return f"obstacles: the plate is a sphere of {self.plate_radius:g} m about the tool centre point"

    @property
    def parts(self) -> Sequence[str]:
        names = self.names or [f"box {k + 1}" for k in range(len(self.low))]
        bodies = [*(f"link {i + 1}" for i in range(len(self.link_radius))), "plate"]
        return [f"{body} and {box}" for box in names for body in bodies]

    def margins(self, poses: Poses) -> Array:
        columns = []
        for low, high in zip(np.asarray(self.low, float), np.asarray(self.high, float), strict=True):
            for i, radius in enumerate(self.link_radius):
                columns.append(_clear(segment_to_box(poses.a[:, i], poses.b[:, i], low, high), radius))
            columns.append(_clear(segment_to_box(poses.T, poses.T, low, high), self.plate_radius))
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class LinkClearance:
    """Links stay clear of one another: the distance of their axes exceeds the sum of their radii.

    Attributes:
        radius: (l,) of the links [m].
        pairs: pairs of links; default: all pairs.

    Links that end in one point always touch: supply real joint positions (`offsets` of `InverseKinematics`), or leave
    the pair out.
    """

    radius: Array
    pairs: Sequence[tuple[int, int]] = field(default=())
    name: str = "link-link clearance"
    unit: str = "m"
    assumes: str = ""

    @property
    def chosen(self) -> Sequence[tuple[int, int]]:
        """The pairs that are checked."""
        return self.pairs or list(combinations(range(len(self.radius)), 2))

    @property
    def parts(self) -> Sequence[str]:
        return [f"links {i + 1} and {j + 1}" for i, j in self.chosen]

    def margins(self, poses: Poses) -> Array:
        a, b, r = poses.a, poses.b, self.radius
        gaps = [(between_segments(a[:, i], b[:, i], a[:, j], b[:, j]), r[i] + r[j]) for i, j in self.chosen]
        return np.stack([_clear(*gap) for gap in gaps], axis=1)


@dataclass(frozen=True)
class FrameClearance:
    """Links stay clear of the beams of the frame.

    Attributes:
        ends: (k, 2, 3) of the beams [m].
        beam_radius: (k,) of the beams [m]. link_radius: (l,) of the links [m].
        skip: pairs (link, beam) that touch by construction, such as a link and its own guideway.
    """

    ends: Array
    beam_radius: Array
    link_radius: Array
    skip: Sequence[tuple[int, int]] = ()
    name: str = "link-frame clearance"
    unit: str = "m"
    assumes: str = ""

    @property
    def chosen(self) -> Sequence[tuple[int, int]]:
        """The pairs (link, beam) that are checked."""
        pairs = [(i, k) for i in range(len(self.link_radius)) for k in range(len(self.ends))]
        return [pair for pair in pairs if pair not in set(self.skip)]

    @property
    def parts(self) -> Sequence[str]:
        return [f"link {i + 1} and beam {k + 1}" for i, k in self.chosen]

    def margins(self, poses: Poses) -> Array:
        columns = []
        for i, k in self.chosen:
            first, last = (np.broadcast_to(p, poses.T.shape) for p in np.asarray(self.ends, float)[k])
            gap = between_segments(poses.a[:, i], poses.b[:, i], first, last)
            columns.append(_clear(gap, self.link_radius[i] + self.beam_radius[k]))
        return np.stack(columns, axis=1)
