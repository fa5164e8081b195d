"""The section, a plane across the guideways in which workspaces and errors are drawn, and regular grids of tool centre
points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ..results import ArgumentError
from ..results.options import Long, Options, Unit, Within

Array = np.ndarray

# largest angle of a guideway from the mean direction for a common cross-section
PARALLEL = np.radians(15.0)
AXIS = 1e-12  # rounding of a unit vector
UP = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class SectionPlane:
    """A plane with coordinates (u, v) [m]: the point is origin + u * across + v * up.

    Attributes:
        origin: (3,) a point of the plane [m]; here u = v = 0.
        across, up: (3,) unit vectors in the plane.
        normal: (3,) unit vector; across, up, and normal are orthogonal.
    """

    origin: Array
    across: Array
    up: Array
    normal: Array

    @property
    def names(self) -> tuple[str, str]:
        """Names of the coordinates: x, y or z for a direction along an axis, otherwise u and v."""
        names = []
        for letter, d in zip("uv", (self.across, self.up), strict=True):
            k = int(np.argmax(d))
            names.append("xyz"[k] if d[k] > 1.0 - AXIS else letter)
        return names[0], names[1]

    def points(self, uv: Array, along: float | Array = 0.0) -> Array:
        """Return the points (n, 3) [m] with plane coordinates uv (n, 2), shifted by `along` [m] along the normal."""
        uv = np.asarray(uv, dtype=float)
        moved = np.broadcast_to(np.asarray(along, dtype=float), uv.shape[:1])
        return self.origin + uv[:, :1] * self.across + uv[:, 1:] * self.up + moved[:, None] * self.normal

    def moved(self, along: float) -> SectionPlane:
        """Return the section shifted by `along` [m] along its normal."""
        return replace(self, origin=self.origin + along * self.normal)

    def coordinates(self, points: Array) -> Array:
        """Return the plane coordinates (n, 2) [m] of the projections of points (n, 3)."""
        d = np.asarray(points, dtype=float) - self.origin
        return np.stack([d @ self.across, d @ self.up], axis=-1)

    def pierced(self, anchors: Array, directions: Array) -> Array:
        """Return the plane coordinates (m, 2) [m] where lines anchors + s * directions, both (m, 3), meet the plane."""
        anchors, directions = np.asarray(anchors, dtype=float), np.asarray(directions, dtype=float)
        s = ((self.origin - anchors) @ self.normal) / (directions @ self.normal)
        return self.coordinates(anchors + s[:, None] * directions)


@dataclass(frozen=True)
class CrossSection(Options):
    """The cross-section, a plane orthogonal to the mean guideway direction; (u, v) = (y, z) for guideways along x.

    >>> gt.kinematics.workspace.CrossSection(low=[0.0, 0.0, 0.0])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: low: expected 2 numbers; found 3
    """

    along: Annotated[float | None, Unit("m"), "position along the guideways; default: through home"] = None
    step: Annotated[float, Unit("m"), Within(above=0.0), "step of the grid"] = 0.02
    low: Annotated[
        list[float] | None, Unit("m"), Long(2), "lower bounds of (u, v); default: all that the links can reach"
    ] = None  # fmt: skip
    high: Annotated[list[float] | None, Unit("m"), Long(2), "upper bounds of (u, v)"] = None

    def window(self, low: Array, high: Array, argument: str = "section") -> tuple[Array, Array]:
        """Return the bounds of (u, v) [m]; low and high are the defaults. Raises ArgumentError at `argument`."""
        low = low if self.low is None else np.array(self.low)
        high = high if self.high is None else np.array(self.high)
        refuse_disordered(low, high, f"{argument}.high")
        return low, high


def refuse_disordered(low: Array, high: Array, argument: str) -> None:
    """Raise ArgumentError unless every lower limit is less than the upper limit."""
    if np.any(low >= high):
        raise ArgumentError("every lower limit must be less than its upper limit", argument)


def section_of(
    anchors: Array, directions: Array, through: Array, along: float | None = None, up: Sequence[float] = UP
) -> SectionPlane:
    """Return the section across the guideways of a robot through a point, or at `along` [m]. Raises ArgumentError."""
    try:
        section = across_guideways(anchors, directions, through.tolist(), up)
    except ValueError as error:
        raise ArgumentError(str(error), "robot") from error
    return section if along is None else replace(section, origin=along * section.normal)


def across_guideways(
    anchors: Array, directions: Array, through: Sequence[float], up: Sequence[float] = UP
) -> SectionPlane:
    """Return the section orthogonal to the mean guideway direction.

    Args:
        anchors, directions: (m, 3) of the guideways; the length of a direction does not matter.
        through: (3,) a point of the section [m]. The origin of (u, v) is the projection of the origin of the frame, so
            that (u, v) = (y, z) for guideways along x.
        up: (3,) direction drawn upwards.

    Raises ValueError if the guideways are not nearly parallel, or if `up` is along them.
    """
    unit = np.asarray(directions, dtype=float)
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    unit = unit * np.where(unit @ unit[0] < 0, -1.0, 1.0)[:, None]
    normal = unit.mean(axis=0) / np.linalg.norm(unit.mean(axis=0))
    worst = float(np.max(np.arccos(np.clip(unit @ normal, -1.0, 1.0))))
    if worst > PARALLEL:
        raise ValueError(
            f"the guideways deviate by up to {np.degrees(worst):.1f} deg from their mean direction; a cross-section "
            f"needs less than {np.degrees(PARALLEL):g} deg"
        )
    vertical = np.asarray(up, dtype=float) - (np.asarray(up, dtype=float) @ normal) * normal
    length = float(np.linalg.norm(vertical))
    if length < np.sin(PARALLEL):
        raise ValueError("the guideways are along the direction drawn upwards; name another one")
    vertical = vertical / length
    # for guideways along x: across = y, up = z
    across = np.cross(vertical, normal)
    origin = (np.asarray(through, dtype=float) @ normal) * normal
    return SectionPlane(origin, across, vertical, normal)


@dataclass(frozen=True)
class Grid:
    """Points origin + sum_k coordinates[k] * directions[k]; the last index varies fastest.

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
        """Return the points (n, 3) [m] with numbers begin to end - 1."""
        indices = np.unravel_index(np.arange(begin, self.size if end is None else end), self.shape)
        T = np.tile(np.asarray(self.origin, dtype=float), (len(indices[0]), 1))
        for c, d, k in zip(self.coordinates, np.asarray(self.directions, float), indices, strict=True):
            T += np.asarray(c, dtype=float)[k][:, None] * d
        return T


def box_grid(low: Array, high: Array, step: float) -> Grid:
    """Return the grid of a box with sides along the axes, from low to high [m], with steps of at most `step` [m].

    >>> grid = gt.kinematics.workspace.box_grid(np.zeros(3), np.array([1.0, 0.5, 0.0]), 0.25)
    >>> grid.shape
    (5, 3, 2)
    """
    return Grid(np.zeros(3), np.eye(3), tuple(spaced(a, b, step) for a, b in zip(low, high, strict=True)))


def section_grid(section: SectionPlane, low: Array, high: Array, step: float) -> Grid:
    """Return the grid of a section within low <= (u, v) <= high [m], with steps of at most `step` [m].

    The plane across guideways along x:

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> plane = gt.kinematics.section.across_guideways(robot.A, robot.v, robot.home)
    >>> gt.kinematics.workspace.section_grid(plane, np.array([-1.0, 0.0]), np.array([0.0, 1.0]), 0.5).shape
    (3, 3)
    """
    directions = np.stack([section.across, section.up])
    return Grid(section.origin, directions, tuple(spaced(a, b, step) for a, b in zip(low, high, strict=True)))


def spaced(low: float, high: float, step: float) -> Array:
    """Return evenly spaced values from low to high, both included, with steps of at most `step`."""
    return np.linspace(low, high, max(2, int(np.ceil((high - low) / step - 1e-9)) + 1))
