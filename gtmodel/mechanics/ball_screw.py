"""A ball screw that turns a plate: the nonlinear relation between its travel and the plate's angle."""

from __future__ import annotations

import numpy as np

from .. import lang as gt
from .frames import Flange, Shaft


class BallScrew(gt.Model):
    """A ball screw between a bearing at distance a [m] from an axis and a lever of length b [m] that turns about it.

    Law of cosines, (length_0 + s)^2 = a^2 + b^2 - 2 a b cos(angle_0 + phi): the travel s [m] of `flange` and the angle
    phi [rad] of `shaft` vanish together, a longer screw turns to positive phi. No losses. As on the rotary axes of the
    F1, whose ball screws Dressler 2012, section 5.4, names without an equation or dimensions: both are OURS, and
    the defaults are an EXAMPLE. Branch `extended`: length_0 + s > 0, the only side with a meaning. phi from s is a
    Newton block in one unknown, singular where the lever points along the screw.

    A lever at a right angle to the bearing's direction: 10 mm of travel turn it by 6.3 degrees.

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

    a = gt.parameter(0.25, unit="m", positive=True, description="from the axis to the screw's bearing")
    b = gt.parameter(0.10, unit="m", positive=True, description="lever, from the axis to the screw's nut")
    angle_0 = gt.parameter(
        np.pi / 2, unit="rad", min=0.0, max=np.pi, description="from bearing to lever at phi = 0, between 0 and pi"
    )
    flange = gt.port(Flange)
    shaft = gt.port(Shaft)
    angle = gt.variable(unit="rad", start=angle_0, description="from bearing to lever")
    length = gt.variable(unit="m", start=lambda self: self.length_0(), description="length of the screw")

    def length_0(self):
        """Length of the screw at phi = 0 [m]."""
        return gt.sqrt(self.a**2 + self.b**2 - 2 * self.a * self.b * gt.cos(self.angle_0))

    def equations(self):
        angle = self.angle
        yield angle == self.angle_0 + self.shaft.phi
        yield self.length == self.length_0() + self.flange.s
        yield self.length**2 == self.a**2 + self.b**2 - 2 * self.a * self.b * gt.cos(angle)
        yield self.shaft.t * self.length + self.flange.f * (self.a * self.b * gt.sin(angle)) == 0
        yield gt.branch("extended", self.length)
