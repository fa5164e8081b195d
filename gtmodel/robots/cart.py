"""A driven cart on its guideway with friction, and its coordinate for a pose of the plate."""

from __future__ import annotations

from typing import Any

from .. import lang as gt
from ..mechanics import Flange, ForceMotor, Guideway, PointFrame, PointMass, TanhFriction


class Cart(gt.Model):
    """A driven cart with the mass m [kg] at its reference point A + q v [m]; the links attach to `flange`."""

    A = gt.parameter(shape=3, unit="m", description="reference point at q = 0")
    v = gt.parameter(shape=3, unit="1", kind="direction", description="motion of that point per q, not normalised")
    m = gt.parameter(unit="kg", min=0.0, description="cart mass, joints included")
    flange = gt.port(Flange)
    guideway = gt.part(Guideway, A=A, v=v)
    body = gt.part(PointMass, m=m)
    friction = gt.part(TanhFriction)
    motor = gt.part(ForceMotor)

    def equations(self):
        yield gt.connect(self.guideway.frame, self.body.frame)
        yield gt.connect(self.guideway.flange, self.flange)
        yield gt.connect(self.motor.flange, self.flange)
        yield gt.connect(self.friction.flange, self.flange)


class _Point(gt.Model):
    """The port that PointCart adds, declared before those of Cart: the order of unknowns affects the last digits."""

    point = gt.port(PointFrame)


class PointCart(Cart, _Point):
    """A driven cart whose `point` carries links or joint plates; its mass includes the joint plates."""

    def equations(self):
        yield gt.connect(self.guideway.frame, self.point)
        yield from super().equations()


def cart_friction(robot: Any) -> list[dict[str, Any]]:
    """Friction modifiers of all carts from the robot's `coulomb`, `viscous` and `velocity_scale`."""
    pairs = zip(robot.coulomb, robot.viscous, strict=True)
    return [dict(coulomb=c, viscous=d, velocity_scale=robot.velocity_scale) for c, d in pairs]


def behind_and_ahead(d: Any, v: Any, length: Any) -> tuple[Any, Any]:
    """Return both coordinates q with |d - q v| = length: the cart behind the plate, and ahead of it.

    Out of reach, both are the nearest coordinate. d: (3,) from the cart joint at q = 0 to the plate joint [m]. v: (3,)
    motion per q.
    """
    dv, vv = gt.dot(d, v), gt.dot(v, v)
    root = gt.sqrt(gt.maximum(dv**2 - vv * (gt.dot(d, d) - length**2), 0.0))
    return (dv - root) / vv, (dv + root) / vv
