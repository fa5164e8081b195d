"""Bodies that a tracker and an inertial unit watch: their motion driven by white jerk, and what the unit feels."""

from __future__ import annotations

from typing import Any

from ..geometry.expressions import quaternion_kinematics, rotated_back
from ..lang.declare import input as known, parameter, variable
from ..lang.expression import vector
from ..lang.functions import cross, der, dot, sqrt
from ..lang.model import Model


class TranslatingBody(Model):
    """A body that does not turn, with an inertial unit on it: acceleration driven by white jerk.

    States p, v, a in the world. `specific_force` is what the accelerometer feels, a - gravity in its own axes.

    gravity: acceleration of free fall in the world, zero for a simulation without. mount: axes of the unit in those of
    the body, a unit quaternion, scalar first. misalignment: a small rotation vector of the unit against `mount`, in its
    own axes.

    >>> body = gt.filtering.TranslatingBody(gravity=[0.0, 0.0, 0.0])
    >>> process = gt.filtering.ProcessModel(body, noise={"jerk": 0.1}, states=["p", "v", "a"])
    >>> sensors = [gt.filtering.Sensor("tracker", "p", deviation=6.4e-6)]
    >>> gt.filtering.System(process, sensors).linear
    True
    """

    gravity = parameter([0.0, 0.0, -9.81], unit="m/s2", description="acceleration of free fall in the world")
    mount = parameter([1.0, 0.0, 0.0, 0.0], unit="1", description="axes of the unit in those of the body")
    misalignment = parameter([0.0, 0.0, 0.0], unit="rad", description="of the unit against its mount")
    p = variable(3, unit="m", description="position in the world")
    v = variable(3, unit="m/s")
    a = variable(3, unit="m/s2")
    jerk = known(3, unit="m/s3")
    specific_force = variable(3, unit="m/s2", description="in the axes of the unit")

    def equations(self) -> Any:
        yield der(self.p) == self.v
        yield der(self.v) == self.a
        yield der(self.a) == self.jerk
        yield self.specific_force == _in_unit(self, self.a - self.gravity)


class TurningBody(Model):
    """A body that moves and turns, with an inertial unit on it: acceleration driven by white jerk, angular acceleration
    by white angular jerk.

    States p, v, a in the world, Q (unit quaternion, body to world, scalar first), w and alpha in the axes of the body.
    `specific_force` and `rate` are what accelerometer and gyro feel, in the axes of the unit; the accelerometer sits at
    `arm` in the axes of the body, so it feels a + alpha x arm + w x (w x arm) - gravity: Cvitanic 2021, (29), written
    for the unit. The other parameters are those of `TranslatingBody`.

    >>> body = gt.filtering.TurningBody(arm=[0.18, 0.1, -0.12])
    >>> process = gt.filtering.ProcessModel(
    ...     body, noise={"jerk": 1e2, "angular_jerk": 1e6}, states=["p", "v", "a", "Q", "w", "alpha"], quaternions=["Q"]
    ... )
    >>> sensors = [gt.filtering.Sensor("gyro", "rate", deviation=8.8e-4)]
    >>> system = gt.filtering.System(process, sensors)
    >>> system.space.size, system.space.dimension
    (19, 18)
    """

    gravity = parameter([0.0, 0.0, -9.81], unit="m/s2", description="acceleration of free fall in the world")
    arm = parameter([0.0, 0.0, 0.0], unit="m", description="place of the accelerometer in the axes of the body")
    mount = parameter([1.0, 0.0, 0.0, 0.0], unit="1", description="axes of the unit in those of the body")
    misalignment = parameter([0.0, 0.0, 0.0], unit="rad", description="of the unit against its mount")
    p = variable(3, unit="m", description="position in the world")
    v = variable(3, unit="m/s")
    a = variable(3, unit="m/s2")
    Q = variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], description="body to world, scalar first")
    w = variable(3, unit="rad/s", description="in the axes of the body")
    alpha = variable(3, unit="rad/s2", description="in the axes of the body")
    jerk = known(3, unit="m/s3")
    angular_jerk = known(3, unit="rad/s3")
    specific_force = variable(3, unit="m/s2", description="in the axes of the unit")
    rate = variable(3, unit="rad/s", description="in the axes of the unit")

    def equations(self) -> Any:
        q, w = self.Q, self.w
        scalar, rates = quaternion_kinematics(q, w)
        yield der(self.p) == self.v
        yield der(self.v) == self.a
        yield der(self.a) == self.jerk
        yield der(q[0]) == scalar
        yield der(q[1:4]) == rates
        yield der(w) == self.alpha
        yield der(self.alpha) == self.angular_jerk
        at_body = rotated_back(q, self.a - self.gravity)
        at_unit = at_body + cross(self.alpha, self.arm) + cross(w, cross(w, self.arm))
        yield self.specific_force == _in_unit(self, at_unit)
        yield self.rate == _in_unit(self, w)


def _in_unit(body: Any, v: Any) -> Any:
    """A vector of the body in the axes of its inertial unit."""
    e = body.misalignment
    length = sqrt(1 + dot(e, e) / 4)
    small = vector([1 / length, e[0] / 2 / length, e[1] / 2 / length, e[2] / 2 / length])
    return rotated_back(small, rotated_back(body.mount, v))
