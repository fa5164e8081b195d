"""Motors."""

from __future__ import annotations

from .. import lang as gt
from .frames import Flange, Shaft


class ForceMotor(gt.Model):
    """An ideal linear motor: pushes the flange with `force` [N] in the direction of positive s."""

    flange = gt.port(Flange)
    force = gt.variable(unit="N", nominal=100.0, description="motor force along positive s")

    def equations(self):
        yield self.flange.f == -self.force
        yield gt.energy(supplied=self.force * gt.der(self.flange.s))


class GearedMotor(ForceMotor):
    """A motor that turns: its rotor's inertia J [kg m2] rides on the flange through an ideal gear and spindle.

    `force` [N] is the motor's torque as a force on the flange, torque / radius, with `radius` [m] the travel per radian
    of the motor. The rotor adds J / radius^2 to the mass moved along the flange, and no weight: on a level guideway
    it cannot be told from the cart's mass.
    """

    J = gt.parameter(unit="kg.m2", min=0.0, description="rotor inertia, motor side")
    radius = gt.parameter(unit="m", nonzero=True, description="travel per radian of the motor")

    def equations(self):
        rate = gt.der(self.flange.s)
        apparent = self.J / self.radius**2
        yield self.flange.f == apparent * gt.der(rate) - self.force
        yield gt.energy(stored=apparent / 2 * rate**2, supplied=self.force * rate)


class TorqueMotor(gt.Model):
    """A motor with rotor inertia J [kg m2] that turns the shaft through an ideal gear.

    `torque` [N.m] is that of the motor, before the gear; the motor turns `ratio` times as fast as the shaft. The
    rotor counts as inertia about the shaft alone: its gyroscopic effect on a moving link is neglected.
    """

    J = gt.parameter(0.0, unit="kg.m2", min=0.0, description="rotor inertia, motor side")
    ratio = gt.parameter(1.0, unit="1", nonzero=True, description="motor angle per shaft angle")
    shaft = gt.port(Shaft)
    torque = gt.variable(unit="N.m", nominal=10.0, description="motor torque, positive along the motor's own angle")

    def equations(self):
        speed = self.ratio * gt.der(self.shaft.phi)
        yield self.shaft.t == self.ratio * (self.J * gt.der(speed) - self.torque)
        yield gt.energy(stored=self.J / 2 * speed**2, supplied=self.torque * speed)
