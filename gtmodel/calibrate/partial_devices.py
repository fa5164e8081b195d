"""Devices that do not see the whole position: robots with one more measured variable.

`seen_by_distance(robot, at)` and `seen_by_plane(robot, normal, point)` add a variable and its equation to any model
with a position T. It calibrates with that variable measured and T latent: prepare(model, {"q", "distance"},
latent=("T",)).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..lang import Model, ModelError, dot, parameter, variable


class SeenByDistance(Model):
    """Adds `distance` [m] of T from `device_at` (3,) [m], as a wire sensor or an interferometer measures it."""

    device_at = parameter(shape=3, unit="m")
    distance = variable(unit="m", start=1.0)

    def equations(self) -> Iterator[Any]:
        yield from super().equations()
        d = self.T - self.device_at  # type: ignore[attr-defined]  # of the robot
        yield dot(d, d) == self.distance**2


class SeenByPlane(Model):
    """Adds `height` [m] of T above the plane through `plane_point` (3,) [m] with the unit `plane_normal` (3,): a dial
    gauge, a touched plate (height 0), or one coordinate."""

    plane_normal = parameter(shape=3)
    plane_point = parameter(shape=3, unit="m")
    height = variable(unit="m")

    def equations(self) -> Iterator[Any]:
        yield from super().equations()
        yield self.height == dot(self.plane_normal, self.T - self.plane_point)  # type: ignore[attr-defined]


def seen_by_distance(robot: Model, at: ArrayLike) -> Model:
    """The robot with the variable `distance` [m] of T from a device at (3,) [m]. Raises ModelError without a position
    T.

    >>> robot = gt.calibrate.seen_by_distance(gt.robots.gantry_tau("l1_tape"), at=[0.0, 0.0, 3.0])
    >>> distance, status = robot.causal(known="T", targets="distance")(np.array([0.5, -0.6, 0.5]))
    >>> round(float(distance), 4)
    2.6192
    """
    return _extended(SeenByDistance, robot, device_at=np.asarray(at, float))


def seen_by_plane(robot: Model, normal: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> Model:
    """The robot with the variable `height` [m] of T over a plane, positive along the normal.

    normal (3,): of any length. point (3,) [m]: of the plane. Raises ModelError for a zero normal or without a position
    T.

    >>> robot = gt.calibrate.seen_by_plane(gt.robots.gantry_tau("l1_tape"), normal=[0, 0, 1], point=[0, 0, 0.1])
    >>> height, status = robot.causal(known="T", targets="height")(np.array([0.5, -0.6, 0.5]))
    >>> round(float(height), 4)
    0.4
    """
    n = np.asarray(normal, float)
    length = float(np.linalg.norm(n))
    if not length > 0:
        raise ModelError("the normal of the plane is zero; give a direction")
    return _extended(SeenByPlane, robot, plane_normal=n / length, plane_point=np.asarray(point, float))


def _extended(device: type[Model], robot: Model, **own: np.ndarray) -> Model:
    if "T" not in type(robot)._declared:
        raise ModelError(f"{type(robot).__name__} declares no position 'T', which the device could see")
    cls = type(f"{type(robot).__name__}{device.__name__}", (device, type(robot)), {})
    return cls(**robot.__dict__["_modifiers"], **own)
