"""Clearance of the links from obstacles, from each other and from the beams of the frame, vectorised over rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from ...geometry.distances import segment_to_box, segment_to_segment
from ..mechanism import Array, Poses

# bodies without radius that are nearer touch and have this negative clearance [m]
TOUCHING = 1e-9


def _clear(distance: Array, radii: float) -> Array:
    return np.where(distance > TOUCHING, distance, -TOUCHING) - radii


@dataclass(frozen=True)
class Obstacles:
    """Links and plate stay clear of axis-aligned boxes.

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
        return f"obstacles: the plate is a sphere with radius {self.plate_radius:g} m about the tool centre point"

    @property
    def parts(self) -> Sequence[str]:
        names = self.names or [f"box {k + 1}" for k in range(len(self.low))]
        bodies = [*(f"link {i + 1}" for i in range(len(self.link_radius))), "plate"]
        return [f"{body} and {box}" for box in names for body in bodies]

    def margins(self, poses: Poses) -> Array:
        columns = []
        for low, high in zip(np.asarray(self.low, float), np.asarray(self.high, float), strict=True):
            center, half = (low + high) / 2, (high - low) / 2
            for i, radius in enumerate(self.link_radius):
                gap = segment_to_box(poses.a[:, i] - center, poses.b[:, i] - center, half)[0]
                columns.append(_clear(gap, radius))
            columns.append(_clear(segment_to_box(poses.T - center, poses.T - center, half)[0], self.plate_radius))
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class LinkClearance:
    """Links stay clear of each other: the distance of their axes is larger than the sum of their radii.

    Attributes:
        radius: (l,) of the links [m].
        pairs: pairs of links to check; default: all pairs.

    Links that end in a common point are never clear of each other. Give the real joint positions (`offsets` of
    `InverseKinematics`), or omit the pair.
    """

    radius: Array
    pairs: Sequence[tuple[int, int]] = field(default=())
    name: str = "link-link clearance"
    unit: str = "m"
    assumes: str = ""

    @property
    def chosen(self) -> Sequence[tuple[int, int]]:
        """Pairs of links that are checked."""
        return self.pairs or list(combinations(range(len(self.radius)), 2))

    @property
    def parts(self) -> Sequence[str]:
        return [f"links {i + 1} and {j + 1}" for i, j in self.chosen]

    def margins(self, poses: Poses) -> Array:
        a, b, r = poses.a, poses.b, self.radius
        gaps = [(segment_to_segment(a[:, i], b[:, i], a[:, j], b[:, j])[0], r[i] + r[j]) for i, j in self.chosen]
        return np.stack([_clear(*gap) for gap in gaps], axis=1)


@dataclass(frozen=True)
class FrameClearance:
    """Links stay clear of the beams of the frame.

    Attributes:
        ends: (k, 2, 3) of the beams [m].
        beam_radius: (k,) of the beams [m]. link_radius: (l,) of the links [m].
        skip: pairs (link, beam) that may touch by design, such as a link and its guideway.
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
        """Pairs (link, beam) that are checked."""
        pairs = [(i, k) for i in range(len(self.link_radius)) for k in range(len(self.ends))]
        return [pair for pair in pairs if pair not in set(self.skip)]

    @property
    def parts(self) -> Sequence[str]:
        return [f"link {i + 1} and beam {k + 1}" for i, k in self.chosen]

    def margins(self, poses: Poses) -> Array:
        columns = []
        for i, k in self.chosen:
            first, last = (np.broadcast_to(p, poses.T.shape) for p in np.asarray(self.ends, float)[k])
            gap = segment_to_segment(poses.a[:, i], poses.b[:, i], first, last)[0]
            columns.append(_clear(gap, self.link_radius[i] + self.beam_radius[k]))
        return np.stack(columns, axis=1)
