"""Springs with dampers in parallel: between two points (along their line, in all directions), flanges, shafts."""

from __future__ import annotations

import numpy as np

from .. import lang as gt
from .frames import Flange, PointFrame, Shaft


class SpringDamper(gt.Model):
    """Massless spring and damper between two points, along the line that joins them.

    `pull` [N] = k (length - length0) + d der(length), positive when it draws the points together. The points must
    not meet.

    From the origin to (3, 4, 0) m the length is 5 m; the force on b points back to a.

    >>> bench = gt.Builder("bench")
    >>> spring = bench.part("spring", gt.mechanics.SpringDamper(k=100.0, length0=4.0))
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor())
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(anchor.point, spring.a), gt.connect(spring.b, load.frame))
    >>> hold = bench.causal(known="load.frame.r", targets=["spring.pull", "load.force"])
    >>> pull, force, status = hold([3.0, 4.0, 0.0], np.zeros(3))
    >>> print(round(pull, 6), force.round(6))
    100.0 [60. 80.  0.]
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

    A mount that is ten times as stiff along z: the load that displaces b by 1 mm along x and z.

    >>> bench = gt.Builder("bench")
    >>> mount = bench.part("mount", gt.mechanics.PointSpringDamper(K=np.diag([1e5, 1e5, 1e6])))
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor())
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(anchor.point, mount.a), gt.connect(mount.b, load.frame))
    >>> hold = bench.causal(known="load.frame.r", targets="load.force")
    >>> force, status = hold([1e-3, 0.0, 1e-3], np.zeros(3))
    >>> force.round(6)
    array([ 100.,    0., 1000.])
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
    """Spring and damper between two flanges; pull = k (b.s - a.s - rest) + d der(b.s - a.s).

    Stretched by 0.02 m and opening at 0.1 m/s. The flows are forces on the spring, whose ends are pulled apart; their
    opposites draw the flanges together.

    >>> bench = gt.Builder("bench")
    >>> spring = bench.part("spring", gt.mechanics.FlangeSpringDamper(k=1000.0, d=50.0))
    >>> left = bench.part("left", gt.mechanics.FixedFlange())
    >>> right = bench.part("right", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect(left.flange, spring.a), gt.connect(spring.b, right.flange))
    >>> stretch = bench.causal(known="spring.b.s", targets=["spring.pull", "spring.a.f", "spring.b.f"])
    >>> *forces, status = stretch(0.02, 0.1)
    >>> print(np.round(forces, 6))
    [ 25. -25.  25.]
    """

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
    """Torsional spring and damper between two shafts; pull = k (b.phi - a.phi - rest) + d der(b.phi - a.phi).

    Twisted by 0.3 rad, 0.2 rad past its rest, and opening at 0.5 rad/s:

    >>> bench = gt.Builder("bench")
    >>> spring = bench.part("spring", gt.mechanics.ShaftSpringDamper(k=50.0, d=2.0, rest=0.1))
    >>> left = bench.part("left", gt.mechanics.FixedShaft())
    >>> right = bench.part("right", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect(left.shaft, spring.a), gt.connect(spring.b, right.shaft))
    >>> twist = bench.causal(known="spring.b.phi", targets="spring.pull")
    >>> pull, status = twist(0.3, 0.5)  # 50 (0.3 - 0.1) + 2 * 0.5
    >>> print(round(pull, 6))
    11.0
    """

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
