"""Devices that see something else than the model's own variables: robots with one more measured variable.

`seen_by_distance(robot, at)` and `seen_by_plane(robot, normal, point)` add a variable and its equation to any model
with a position T. It calibrates with that variable measured and T latent: prepare(model, {"q", "distance"},
latent=("T",)). `seen_with_quaternion(robot)` adds the orientation of a model with a rotation matrix R as a quaternion.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.quaternions import quaternion_matrix
from ..lang import Model, ModelError, dot, parameter, part, variable


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


class QuaternionOfMatrix(Model):
    """The unit quaternion e (4,), scalar first, of a rotation R: what they differ by, the sine of its angle along its
    axis, which is the shift of a point one metre off in m, is zero."""

    R = variable((3, 3), unit="1")
    e = variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], prefer=-5)

    def equations(self) -> Iterator[Any]:
        yield dot(self.e, self.e) == 1.0
        R, Q = self.R, quaternion_matrix(self.e)
        for i, j in ((2, 1), (0, 2), (1, 0)):  # R'Q is symmetric where they are equal
            yield 0.5 * sum(R[k, i] * Q[k, j] - R[k, j] * Q[k, i] for k in range(3)) == 0.0


class SeenWithQuaternion(Model):
    """Adds the unit quaternion `e` (4,), scalar first, of R."""

    e = variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], prefer=-5)
    orientation_at_1_m = part(QuaternionOfMatrix)  # as its errors are called

    def equations(self) -> Iterator[Any]:
        yield from super().equations()
        yield self.orientation_at_1_m.R == self.R  # type: ignore[attr-defined]  # of the robot
        yield self.orientation_at_1_m.e == self.e


def seen_with_quaternion(robot: Model) -> Model:
    """The robot with the variable `e` (4,), the unit quaternion of its rotation R, scalar first, for measured full
    poses. Raises ModelError without a rotation R, and where `e` is there already.

    >>> arm = gt.robots.serial_arm(a=[0.1, 0.5, 0.0], alpha=[np.pi / 2, 0.0, np.pi / 2], d=[0.4, 0.0, 0.0])
    >>> gt.calibrate.closure_equations(gt.calibrate.seen_with_quaternion(arm), known=["q", "T", "e"]).residuals.shape
    (6, 1)
    """
    declared = type(robot)._declared
    if "R" not in declared or "e" in declared:
        there = "has an 'e' already" if "e" in declared else "declares no rotation 'R'"
        raise ModelError(f"{type(robot).__name__} {there}")
    return _extended(SeenWithQuaternion, robot)


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
    return cls(**robot._modifiers, **own)
