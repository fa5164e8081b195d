"""Clearance of the links: from obstacles, from one another, from the beams of the frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from ..poses import Array, Poses
from .distances import between_segments, segment_to_box

# what meets is not clear, also where nothing has a radius [m]
TOUCHING = 1e-9


def _clear(distance: Array, radii: float) -> Array:
    return np.where(distance > 0, distance, -TOUCHING) - radii


@dataclass(frozen=True)
class Obstacles:
    """Links and plate stay clear of boxes with sides along the axes.

    Attributes:
        low, high: (k, 3) corners of the boxes [m].
        link_radius: (l,) of the links [m].
        plate_radius: of a sphere about the tool centre point that holds the plate [m].
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
    """Links stay clear of one another: the distance of their segments is more than the sum of their radii.

    Attributes:
        radius: (l,) of the links [m].
        pairs: which links; all pairs if left out.

    Links that end in one point are never clear of one another: give real joint positions (`offsets` of
    `InverseKinematics`), or leave the pair out.
    """

    radius: Array
    pairs: Sequence[tuple[int, int]] = field(default=())
    name: str = "link-link clearance"
    unit: str = "m"
    assumes: str = ""

    @property
    def chosen(self) -> Sequence[tuple[int, int]]:
        """The pairs that are looked at."""
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
        """The pairs (link, beam) that are looked at."""
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
