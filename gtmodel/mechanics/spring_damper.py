"""Springs with dampers in parallel: between two points (along their line, in all directions), flanges, shafts."""

from __future__ import annotations

import numpy as np

from .. import lang as gt
from .frames import Flange, PointFrame, Shaft


class SpringDamper(gt.Model):
    """Massless spring and damper between two points, along the line that joins them.

    `pull` [N] = k (length - length0) + d der(length), positive when it draws the points together. The points must
    not meet.
    """

    k = gt.parameter(unit="N/m", min=0.0, description="stiffness")
    d = gt.parameter(0.0, unit="N.s/m", min=0.0, description="damping")
    length0 = gt.parameter(0.0, unit="m", description="length at which the spring is slack")
    a = gt.port(PointFrame)
    b = gt.port(PointFrame)
    length = gt.variable(unit="m", description="distance of the points")
    pull = gt.variable(unit="N", nominal=100.0, description="force that draws the points together")

    def equations(self):
        ab = self.b.r - self.a.r
        yield self.length == gt.norm(ab)
        yield self.pull == self.k * (self.length - self.length0) + self.d * gt.der(self.length)
        yield self.a.f == -self.pull / self.length * ab
        yield self.b.f == self.pull / self.length * ab
        yield _energy(self.k, self.d, self.length - self.length0)


class PointSpringDamper(gt.Model):
    """Spring and damper that hold two points together in all three directions; they rest where the points meet.

    K and D (3, 3), world axes, symmetric: force of a on b is -K (b.r - a.r) - D der(b.r - a.r). A mass on a compliant
    mount: an elastic end-effector.
    """

    K = gt.parameter(shape=(3, 3), unit="N/m", kind="semidefinite", description="stiffness, world axes")
    D = gt.parameter(np.zeros((3, 3)), unit="N.s/m", kind="semidefinite", description="damping, world axes")
    a = gt.port(PointFrame)
    b = gt.port(PointFrame)
    offset = gt.variable(3, unit="m", nominal=1e-3, description="from a to b")

    def equations(self):
        rate = gt.der(self.offset)
        pull = self.K @ self.offset + self.D @ rate
        yield self.b.r == self.a.r + self.offset
        yield self.b.f == pull
        yield self.a.f == -pull
        stored = gt.dot(self.offset, self.K @ self.offset) / 2
        yield gt.energy(stored=stored, dissipated=gt.dot(rate, self.D @ rate))


class FlangeSpringDamper(gt.Model):
    """Spring and damper between two flanges; pull = k (b.s - a.s - rest) + d der(b.s - a.s)."""

    k = gt.parameter(unit="N/m", min=0.0, description="stiffness")
    d = gt.parameter(0.0, unit="N.s/m", min=0.0, description="damping")
    rest = gt.parameter(0.0, unit="m", description="b.s - a.s at which the spring is slack")
    a = gt.port(Flange)
    b = gt.port(Flange)
    pull = gt.variable(unit="N", nominal=100.0, description="force that draws the flanges together")

    def equations(self):
        stretch = self.b.s - self.a.s
        yield self.pull == self.k * (stretch - self.rest) + self.d * gt.der(stretch)
        yield self.a.f == -self.pull
        yield self.b.f == self.pull
        yield _energy(self.k, self.d, stretch - self.rest)


class ShaftSpringDamper(gt.Model):
    """Torsional spring and damper between two shafts; pull = k (b.phi - a.phi - rest) + d der(b.phi - a.phi)."""

    k = gt.parameter(unit="N.m/rad", min=0.0, description="torsional stiffness")
    d = gt.parameter(0.0, unit="N.m.s/rad", min=0.0, description="torsional damping")
    rest = gt.parameter(0.0, unit="rad", description="b.phi - a.phi at which the spring is slack")
    a = gt.port(Shaft)
    b = gt.port(Shaft)
    pull = gt.variable(unit="N.m", nominal=10.0, description="torque that turns the shafts towards each other")

    def equations(self):
        twist = self.b.phi - self.a.phi
        yield self.pull == self.k * (twist - self.rest) + self.d * gt.der(twist)
        yield self.a.t == -self.pull
        yield self.b.t == self.pull
        yield _energy(self.k, self.d, twist - self.rest)


def _energy(k, d, stretch):
    return gt.energy(stored=k / 2 * stretch**2, dissipated=d * gt.der(stretch) ** 2)
