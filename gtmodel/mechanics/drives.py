"""Drives: motors, gear, rack and pinion, a ball screw with lever, and a strut of variable length."""

from __future__ import annotations

import numpy as np

from .. import lang as gt
from .frames import Flange, PointFrame, Shaft


class ForceMotor(gt.Model):
    """An ideal linear motor that pushes the flange with `force` [N] in the direction of positive s.

    Force that accelerates a mass of 12 kg by 3 m/s2:

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
    """A rotary motor on a flange; its rotor inertia J [kg m2] acts through an ideal gear and spindle.

    `force` [N] is the motor torque as a force on the flange, torque / radius, with `radius` [m] the travel per radian
    of the motor. The rotor adds J / radius^2 to the moving mass, but no weight. On a level guideway rotor inertia and
    mass cannot be distinguished.

    A rotor of 2e-3 kg m2 on a spindle of 20 mm per radian acts like 5 kg on the flange:

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

    `torque` [N.m] is the torque on the motor side of the gear; the motor turns `ratio` times as fast as the shaft. The
    rotor only adds inertia about the shaft: its gyroscopic effect on a moving link is neglected.

    A rotor of 1e-3 kg m2 that turns 10 times as fast as the shaft adds 0.1 kg m2 to the load:

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
    torque = gt.variable(unit="N.m", nominal=10.0, description="motor torque, positive along the motor angle")

    def equations(self):
        speed = self.ratio * gt.der(self.shaft.phi)
        yield self.shaft.t == self.ratio * (self.J * gt.der(speed) - self.torque)
        yield gt.energy(stored=self.J / 2 * speed**2, supplied=self.torque * speed)


class Inertia(gt.Model):
    """Moment of inertia J [kg m2] on a shaft.

    Acceleration [rad/s2] of a rotor of 0.5 kg m2 under a motor torque of 2 N.m:

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

    Acceleration [m/s2] of a carriage of 12 kg under a motor force of 60 N:

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
    """Ideal gear without losses: shaft a turns `ratio` times as fast as shaft b, in reverse if it is negative.

    A motor of 2 N.m with a gear ratio of 10 drives a load of 0.5 kg m2 with 20 N.m:

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

    ratio = gt.parameter(unit="1", nonzero=True, description="angle of shaft a per angle of shaft b")
    a = gt.port(Shaft)
    b = gt.port(Shaft)

    def equations(self):
        yield self.a.phi == self.ratio * self.b.phi
        yield self.ratio * self.a.t + self.b.t == 0


class RackAndPinion(gt.Model):
    """Pinion, belt or spindle without losses: the flange moves by `radius` [m] per radian of the shaft.

    A pinion of 50 mm radius: 10 mm of travel are 0.2 rad, and a carriage of 12 kg needs 0.6 N.m for 1 m/s2.

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


class BallScrew(gt.Model):
    """A ball screw between a bearing at distance a [m] from an axis and a lever of length b [m] that turns about it.

    Law of cosines, (length_0 + s)^2 = a^2 + b^2 - 2 a b cos(angle_0 + phi). The travel s [m] of `flange` and the angle
    phi [rad] of `shaft` are zero together, and phi grows with the length of the screw. There are no losses. The rotary
    axes of the F1 have such screws; Dressler 2012, section 5.4, gives neither equation nor dimensions: the equation is
    OURS and the default dimensions are an EXAMPLE. Branch `extended`: length_0 + s > 0, the only meaningful side. phi
    from s is a closed form on the side of the start values; beyond the folded and the stretched screw there is no
    solution.

    10 mm of travel turn a lever at a right angle to the bearing's direction by 6.3 degrees:

    >>> bench = gt.Builder("bench")
    >>> screw = bench.part("screw", gt.mechanics.BallScrew(a=0.25, b=0.10))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> load = bench.part("load", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect(motor.flange, screw.flange), gt.connect(screw.shaft, load.shaft))
    >>> turn = bench.causal(known="motor.flange.s", targets="load.shaft.phi")
    >>> phi, status = turn(0.010)
    >>> print(round(np.degrees(phi), 2))
    6.3
    """

    a = gt.parameter(0.25, unit="m", positive=True, description="distance from the axis to the screw's bearing")
    b = gt.parameter(0.10, unit="m", positive=True, description="lever length, from the axis to the screw's nut")
    angle_0 = gt.parameter(
        np.pi / 2, unit="rad", min=0.0, max=np.pi, description="angle from bearing to lever at phi = 0"
    )
    flange = gt.port(Flange)
    shaft = gt.port(Shaft)
    angle = gt.variable(unit="rad", start=angle_0, description="angle from bearing to lever")
    length = gt.variable(unit="m", start=lambda self: self.length_0(), description="length of the screw")

    def length_0(self):
        """Return the length of the screw at phi = 0 [m]."""
        return gt.sqrt(self.a**2 + self.b**2 - 2 * self.a * self.b * gt.cos(self.angle_0))

    def equations(self):
        angle = self.angle
        yield angle == self.angle_0 + self.shaft.phi
        yield self.length == self.length_0() + self.flange.s
        yield self.length**2 == self.a**2 + self.b**2 - 2 * self.a * self.b * gt.cos(angle)
        yield self.shaft.t * self.length + self.flange.f * (self.a * self.b * gt.sin(angle)) == 0
        yield gt.branch("extended", self.length)


class Strut(gt.Model):
    """Massless linear actuator between two spherical joints, e.g. a leg of a hexapod.

    A positive `force` [N] pushes the ends apart. Branch `extended`: length > 0, the only meaningful side.

    Force of a vertical leg of 2 m that carries a mass of 5 kg:

    >>> bench = gt.Builder("bench")
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor())
    >>> leg = bench.part("leg", gt.mechanics.Strut())
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=5.0))
    >>> bench.add(gt.connect(anchor.point, leg.a), gt.connect(leg.b, mass.frame))
    >>> bench.add(gt.branch("above", leg.b.r[2] - leg.a.r[2]))
    >>> sideways = ["leg.b.r[0]", "leg.b.r[1]"]
    >>> inverse = bench.causal(known="leg.length", targets=["leg.force", "leg.b.r"], prefer=sideways)
    >>> force, r, status = inverse(0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0)  # x, y, their rates; length, its rates
    >>> print(round(force, 6), r)
    49.05 [0. 0. 2.]
    """

    a = gt.port(PointFrame)
    b = gt.port(PointFrame)
    length = gt.variable(unit="m", start=1.0, description="distance between the joint centres")
    force = gt.variable(unit="N", nominal=100.0, description="force that pushes the ends apart")

    def equations(self):
        ab = self.b.r - self.a.r
        yield gt.dot(ab, ab) == self.length**2
        yield self.a.f == self.force / self.length * ab
        yield self.b.f == -self.force / self.length * ab
        yield gt.branch("extended", self.length)
        yield gt.energy(supplied=self.force * gt.der(self.length))
