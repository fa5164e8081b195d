"""Regular grids of tool centre points; the points are made when they are asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..section import SectionPlane

Array = np.ndarray


@dataclass(frozen=True)
class Grid:
    """Points origin + sum_k coordinates[k] * directions[k]; the last axis runs fastest.

    Attributes:
        origin: (3,) [m]. directions: (k, 3), k = 1, 2 or 3. coordinates: k arrays, ascending [m].
    """

    origin: Array
    directions: Array
    coordinates: tuple[Array, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of points along each axis."""
        return tuple(len(c) for c in self.coordinates)

    @property
    def size(self) -> int:
        """Number of points."""
        return int(np.prod(self.shape))

    def points(self, begin: int = 0, end: int | None = None) -> Array:
        """Points (n, 3) [m] number begin to end - 1."""
        indices = np.unravel_index(np.arange(begin, self.size if end is None else end), self.shape)
        T = np.tile(np.asarray(self.origin, dtype=float), (len(indices[0]), 1))
        for c, d, k in zip(self.coordinates, np.asarray(self.directions, float), indices, strict=True):
            T += np.asarray(c, dtype=float)[k][:, None] * d
        return T


def box_grid(low: Array, high: Array, step: float) -> Grid:
    """Points of a box with sides along the axes, from low to high [m], at most `step` [m] apart.

    >>> grid = gt.kinematics.workspace.box_grid(np.zeros(3), np.array([1.0, 0.5, 0.0]), 0.25)
    >>> grid.shape
    (5, 3, 2)
    """
    return Grid(np.zeros(3), np.eye(3), tuple(spaced(a, b, step) for a, b in zip(low, high, strict=True)))


def section_grid(section: SectionPlane, low: Array, high: Array, step: float) -> Grid:
    """Points of a section within low <= (u, v) <= high [m], at most `step` [m] apart.

    The plane across guideways along x:

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> plane = gt.kinematics.section.across_guideways(robot.A, robot.v, robot.home)
    >>> gt.kinematics.workspace.section_grid(plane, np.array([-1.0, 0.0]), np.array([0.0, 1.0]), 0.5).shape
    (3, 3)
    """
    directions = np.stack([section.across, section.up])
    return Grid(section.origin, directions, tuple(spaced(a, b, step) for a, b in zip(low, high, strict=True)))


def spaced(low: float, high: float, step: float) -> Array:
    """Values from low to high, both included, evenly spaced by at most `step`."""
    return np.linspace(low, high, max(2, int(np.ceil((high - low) / step - 1e-9)) + 1))
