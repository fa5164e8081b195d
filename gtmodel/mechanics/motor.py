"""Motors."""

from __future__ import annotations

from .. import lang as gt
from .frames import Flange, Shaft


class ForceMotor(gt.Model):
    """An ideal linear motor: pushes the flange with `force` [N] in the direction of positive s.

    To give a mass of 12 kg an acceleration of 3 m/s2:

    >>> bench = gt.Builder("bench")
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> carriage = bench.part("carriage", gt.mechanics.Mass(m=12.0))
    >>> bench.add(gt.connect(motor.flange, carriage.flange))
    >>> inverse = bench.causal(known="carriage.flange.s", targets="motor.force")
    >>> force, status = inverse(0.0, 0.0, 3.0)
    >>> print(force)
    36.0
    """

    flange = gt.port(Flange)
    force = gt.variable(unit="N", nominal=100.0, description="motor force along positive s")

    def equations(self):
        yield self.flange.f == -self.force
        yield gt.energy(supplied=self.force * gt.der(self.flange.s))


class GearedMotor(ForceMotor):
    """A rotary motor on a flange: its rotor's inertia J [kg m2] acts there through an ideal gear and spindle.

    `force` [N] is the motor's torque as a force on the flange, torque / radius, with `radius` [m] the travel per radian
    of the motor. The rotor adds J / radius^2 to the mass moved along the flange, and no weight: on a level guideway
    the two cannot be identified apart.

    A rotor of 2e-3 kg m2 behind a spindle of 20 mm per radian feels like 5 kg on the flange:

    >>> bench = gt.Builder("bench")
    >>> motor = bench.part("motor", gt.mechanics.GearedMotor(J=2e-3, radius=0.02))
    >>> carriage = bench.part("carriage", gt.mechanics.Mass(m=12.0))
    >>> bench.add(gt.connect(motor.flange, carriage.flange))
    >>> force, status = bench.causal(known="carriage.flange.s", targets="motor.force")(0.0, 0.0, 1.0)
    >>> print(round(force, 6))
    17.0
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

    A rotor of 1e-3 kg m2 that turns 10 times as fast as the shaft adds 0.1 kg m2 to what hangs there:

    >>> bench = gt.Builder("bench")
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor(J=1e-3, ratio=10.0))
    >>> load = bench.part("load", gt.mechanics.Inertia(J=0.4))
    >>> bench.add(gt.connect(motor.shaft, load.shaft))
    >>> acceleration, status = bench.causal(known="motor.torque", targets="der(load.shaft.phi,2)")(1.0)
    >>> print(round(acceleration, 6))  # 10 N.m at the shaft on 0.5 kg m2
    20.0
    """

    J = gt.parameter(0.0, unit="kg.m2", min=0.0, description="rotor inertia, motor side")
    ratio = gt.parameter(1.0, unit="1", nonzero=True, description="motor angle per shaft angle")
    shaft = gt.port(Shaft)
    torque = gt.variable(unit="N.m", nominal=10.0, description="motor torque, positive along the motor's own angle")

    def equations(self):
        speed = self.ratio * gt.der(self.shaft.phi)
        yield self.shaft.t == self.ratio * (self.J * gt.der(speed) - self.torque)
        yield gt.energy(stored=self.J / 2 * speed**2, supplied=self.torque * speed)
