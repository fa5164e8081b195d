"""Limits of the workspace besides the inverse kinematics: strokes, joint cones, free space, singularities.

A limit returns a margin for each of its parts (positive inside, in its own unit) and states its assumptions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..mechanism import Array, Poses


class Limit(Protocol):
    """Interface of a limit.

    name: one or two words. unit: of the margins. parts: name of each column of the margins.
    assumes: a sentence with the assumptions, shown with every result, or "".
    """

    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def parts(self) -> Sequence[str]: ...
    @property
    def assumes(self) -> str: ...

    def margins(self, poses: Poses) -> Array:
        """Return the margins (n, parts), positive inside the limit."""
        ...


@dataclass(frozen=True)
class _Ends(ABC):
    """Coordinates of a pose stay between a low and a high end."""

    low: Array
    high: Array
    name: str
    unit: str = "m"
    assumes: str = ""

    @abstractmethod
    def coordinates(self, poses: Poses) -> Array:
        """Return the limited coordinates (n, m)."""

    @abstractmethod
    def names(self) -> Sequence[str]:
        """Return the names of the m coordinates."""

    @property
    def parts(self) -> Sequence[str]:
        return [f"{name} at its {end} end" for end in ("low", "high") for name in self.names()]

    def margins(self, poses: Poses) -> Array:
        x = self.coordinates(poses)
        return np.hstack([x - np.asarray(self.low), np.asarray(self.high) - x])


@dataclass(frozen=True)
class ActuatorLimits(_Ends):
    """Each actuator keeps low <= q <= high [m or rad], both (m,)."""

    name: str = "actuator limits"

    def coordinates(self, poses: Poses) -> Array:
        return poses.q

    def names(self) -> Sequence[str]:
        return [f"actuator {i + 1}" for i in range(len(self.low))]


@dataclass(frozen=True)
class BallJointCones:
    """Each link stays within a cone about the axis of its ball joint.

    Attributes:
        axes: (l, 3) unit vectors in world coordinates, from cart to plate. Carts and plate keep their orientation,
            so that one cone represents both ends of a link.
        half_angle: of the cones [rad].
        assumes: how the axes were chosen; mounting directions of joints are rarely published.
    """

    axes: Array
    half_angle: float
    assumes: str
    unit: str = "rad"

    @classmethod
    def about_home(cls, home: Poses, half_angle: float) -> BallJointCones:
        """Build cones with axes along the links at the home pose, the single row of `home`."""
        where = ", ".join(f"{x:.4g}" for x in home.T[0])
        assumes = (
            f"the axes of the ball-joint cones are the link directions at the home pose ({where}) m; "
            "the real mounting directions are not known"
        )
        return cls(home.directions[0], half_angle, assumes)

    @property
    def name(self) -> str:
        return f"ball-joint cones of {np.degrees(self.half_angle):g} deg"

    @property
    def parts(self) -> Sequence[str]:
        return [f"link {i + 1}" for i in range(len(self.axes))]

    def margins(self, poses: Poses) -> Array:
        u, axes = poses.directions, np.asarray(self.axes)
        # half-angle formula: accurate for small angles, too
        difference, total = (np.sqrt(np.einsum("nli,nli->nl", d, d)) for d in (u - axes, u + axes))
        return self.half_angle - 2 * np.arctan2(difference, total)


@dataclass(frozen=True)
class CartesianBox(_Ends):
    """The tool centre point stays within low <= T <= high [m], both (3,): the free space inside a frame
    (Dressler 2012, section 5.6)."""

    name: str = "Cartesian limits"

    def coordinates(self, poses: Poses) -> Array:
        return poses.T

    def names(self) -> Sequence[str]:
        return "xyz"


@dataclass(frozen=True)
class Singularities:
    """The robot keeps an angle [rad] from its singular poses.

    Inverse singularity: a link is orthogonal to its guideway; the margin is its angle from the orthogonal plane.
    Forward singularity (three links): a link lies in the plane of the other two; the margin is its angle from it.

    Attributes:
        directions: (l, 3) guideway direction of each link; length does not matter.
    """

    directions: Array
    least_angle: float
    name: str = "singularity"
    unit: str = "rad"
    assumes: str = ""

    @property
    def parts(self) -> Sequence[str]:
        n = len(self.directions)
        parts = [f"link {i + 1} against its guideway" for i in range(n)]
        return parts + ([f"link {i + 1} against the plane of the others" for i in range(3)] if n == 3 else [])

    def margins(self, poses: Poses) -> Array:
        u = poses.directions
        v = np.asarray(self.directions, dtype=float)
        v = v / np.linalg.norm(v, axis=1, keepdims=True)
        angles = [np.arcsin(np.minimum(1.0, np.abs(np.einsum("nli,li->nl", u, v))))]
        if len(v) == 3:
            angles.append(plane_angles(u))
        return np.hstack(angles) - self.least_angle


def plane_angles(u: Array) -> Array:
    """Return the angle [rad] (n, 3) of each of three unit vectors (n, 3, 3) from the plane of the other two; zero if
    singular."""
    x, y, z = np.moveaxis(u, 2, 0)
    height, angles = np.zeros(len(u)), []
    for j, k in ((1, 2), (2, 0), (0, 1)):
        normal = (
            y[:, j] * z[:, k] - z[:, j] * y[:, k],
            z[:, j] * x[:, k] - x[:, j] * z[:, k],
            x[:, j] * y[:, k] - y[:, j] * x[:, k],
        )
        if not angles:  # the determinant is the same for all three
            height = np.abs(normal[0] * x[:, 0] + normal[1] * y[:, 0] + normal[2] * z[:, 0])
        length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        # two parallel links span no plane: singular
        sine = np.divide(height, length, out=np.zeros_like(height), where=length > 0)
        angles.append(np.arcsin(np.minimum(1.0, sine)))
    return np.stack(angles, axis=1)
