"""Chains of n pendulums built from parts, in two coordinates, to measure the growth of compile time with n."""

from __future__ import annotations

from functools import cache

import numpy as np

import gtmodel as gt

ANGLE = 0.3  # rad from the vertical, of every link at the start


class Point(gt.Connector):
    """A point in a vertical plane; force f [N] acting on the component at that point."""

    r = gt.potential(2, unit="m", prefer=-3)
    f = gt.flow(2, unit="N")


class Hinge(gt.Model):
    """Where the chain hangs."""

    point = gt.port(Point)

    def equations(self):
        yield self.point.r == np.zeros(2)


class Bob(gt.Model):
    """Point mass m [kg] under gravity."""

    m = gt.parameter(1.0, unit="kg", positive=True)
    g = gt.parameter([0.0, -9.81], unit="m/s2")
    point = gt.port(Point)

    def equations(self):
        yield self.point.f == self.m * (gt.der(self.point.r, 2) - self.g)


class AngleLink(gt.Model):
    """Massless link of length L [m] at the angle phi from the vertical, turned by `torque` [N.m] about a."""

    L = gt.parameter(1.0, unit="m", positive=True)
    a = gt.port(Point)
    b = gt.port(Point)
    phi = gt.variable(unit="rad", start=ANGLE, prefer=1)
    torque = gt.variable(unit="N.m")

    def equations(self):
        d = self.L * gt.vector([gt.sin(self.phi), -gt.cos(self.phi)])
        yield self.b.r == self.a.r + d
        yield self.a.f + self.b.f == 0
        yield self.torque == self.a.f[0] * d[1] - self.a.f[1] * d[0]


class CartesianLink(gt.Model):
    """Massless link of length L [m] between two points; its force is `pull` [N/m] times the vector along it.

    Branch `below`: b hangs below a.
    """

    L = gt.parameter(1.0, unit="m", positive=True)
    a = gt.port(Point)
    b = gt.port(Point)
    pull = gt.variable(unit="N/m")

    def equations(self):
        d = self.b.r - self.a.r
        yield gt.dot(d, d) == self.L**2
        yield self.a.f == -self.pull * d
        yield self.b.f == self.pull * d
        yield gt.branch("below", -d[1])


@cache
def angle_chain(n: int) -> type[gt.Model]:
    """n links, each turned by a torque from outside."""

    class AngleChain(gt.Model):
        phi = gt.variable(n, unit="rad", start=np.full(n, ANGLE), prefer=1)
        torque = gt.input(n, unit="N.m")
        hinge = gt.part(Hinge)
        link = gt.parts(n, AngleLink)
        bob = gt.parts(n, Bob)

        def equations(self):
            above = self.hinge.point
            for k in range(n):
                yield gt.connect(above, self.link[k].a)
                yield gt.connect(self.link[k].b, self.bob[k].point)
                yield self.phi[k] == self.link[k].phi
                yield self.link[k].torque == self.torque[k]
                above = self.link[k].b

    return AngleChain


@cache
def cartesian_chain(n: int) -> type[gt.Model]:
    """The same chain without torques; index 3."""

    class CartesianChain(gt.Model):
        r = gt.variable((n, 2), unit="m", start=[[(k + 1) * np.sin(ANGLE), -(k + 1) * np.cos(ANGLE)] for k in range(n)])
        hinge = gt.part(Hinge)
        link = gt.parts(n, CartesianLink)
        bob = gt.parts(n, Bob)

        def equations(self):
            above = self.hinge.point
            for k in range(n):
                yield gt.connect(above, self.link[k].a)
                yield gt.connect(self.link[k].b, self.bob[k].point)
                yield self.r[k] == self.bob[k].point.r
                above = self.link[k].b

    return CartesianChain
