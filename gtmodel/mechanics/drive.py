"""Drive trains on flanges and shafts: inertias, gear, rack and pinion."""

from __future__ import annotations

from .. import lang as gt
from .frames import Flange, Shaft


class Inertia(gt.Model):
    """Moment of inertia J [kg m2] on a shaft.

    A motor of 2 N.m on a rotor of 0.5 kg m2: acceleration [rad/s2].

    >>> bench = gt.Builder("bench")
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> rotor = bench.part("rotor", gt.mechanics.Inertia(J=0.5))
    >>> bench.add(gt.connect(motor.shaft, rotor.shaft))
    >>> acceleration, status = bench.causal(known="motor.torque", targets="der(rotor.shaft.phi,2)")(2.0)
    >>> print(acceleration)
    4.0
    """

    J = gt.parameter(unit="kg.m2", min=0.0, description="moment of inertia about the shaft")
    shaft = gt.port(Shaft)

    def equations(self):
        yield self.shaft.t == self.J * gt.der(self.shaft.phi, 2)
        yield gt.energy(stored=self.J / 2 * gt.der(self.shaft.phi) ** 2)


class Mass(gt.Model):
    """Mass m [kg] on a translational flange, without weight.

    A motor of 60 N on a carriage of 12 kg: acceleration [m/s2].

    >>> bench = gt.Builder("bench")
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> carriage = bench.part("carriage", gt.mechanics.Mass(m=12.0))
    >>> bench.add(gt.connect(motor.flange, carriage.flange))
    >>> acceleration, status = bench.causal(known="motor.force", targets="der(carriage.flange.s,2)")(60.0)
    >>> print(acceleration)
    5.0
    """

    m = gt.parameter(unit="kg", min=0.0, description="mass moved along the flange")
    flange = gt.port(Flange)

    def equations(self):
        yield self.flange.f == self.m * gt.der(self.flange.s, 2)
        yield gt.energy(stored=self.m / 2 * gt.der(self.flange.s) ** 2)


class Gear(gt.Model):
    """Ideal gear: shaft a turns `ratio` times as fast as shaft b, backwards if it is negative; no losses.

    A motor of 2 N.m behind a gear of 10 turns a load of 0.5 kg m2 with 20 N.m.

    >>> bench = gt.Builder("bench")
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> gear = bench.part("gear", gt.mechanics.Gear(ratio=10.0))
    >>> load = bench.part("load", gt.mechanics.Inertia(J=0.5))
    >>> bench.add(gt.connect(motor.shaft, gear.a), gt.connect(gear.b, load.shaft))
    >>> run = bench.causal(known="motor.torque", targets=["der(load.shaft.phi,2)", "der(motor.shaft.phi,2)"])
    >>> load_acceleration, motor_acceleration, status = run(2.0)
    >>> print(load_acceleration, motor_acceleration)
    40.0 400.0
    """

    ratio = gt.parameter(unit="1", nonzero=True, description="angle of a per angle of b")
    a = gt.port(Shaft)
    b = gt.port(Shaft)

    def equations(self):
        yield self.a.phi == self.ratio * self.b.phi
        yield self.ratio * self.a.t + self.b.t == 0


class RackAndPinion(gt.Model):
    """Pinion, belt or spindle: the flange moves by `radius` [m] per radian of the shaft; no losses.

    A pinion of 50 mm radius: 0.2 rad are 10 mm of travel, and a carriage of 12 kg at 1 m/s2 takes 0.6 N.m.

    >>> bench = gt.Builder("bench")
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> belt = bench.part("belt", gt.mechanics.RackAndPinion(radius=0.05))
    >>> carriage = bench.part("carriage", gt.mechanics.Mass(m=12.0))
    >>> bench.add(gt.connect(motor.shaft, belt.shaft), gt.connect(belt.flange, carriage.flange))
    >>> inverse = bench.causal(known="carriage.flange.s", targets=["motor.shaft.phi", "motor.torque"])
    >>> phi, torque, status = inverse(0.01, 0.0, 1.0)
    >>> print(round(phi, 6), round(torque, 6))
    0.2 0.6
    """

    radius = gt.parameter(unit="m", nonzero=True, description="travel per radian, pitch/(2 pi) of a spindle")
    shaft = gt.port(Shaft)
    flange = gt.port(Flange)

    def equations(self):
        yield self.flange.s == self.radius * self.shaft.phi
        yield self.shaft.t + self.radius * self.flange.f == 0
