"""A massless slide along a straight guideway, rigid or compliant."""

from __future__ import annotations

from .. import lang as gt
from .frames import Flange, PointFrame


class Guideway(gt.Model):
    """Point A + q v on a straight line (Dressler 2012, eq. (6.4)).

    |v| is a transmission scale (0.96 to 1.003 on real robots) and is never normalised. The flange's coordinate
    is q. Power passes without loss: the force on the flange plus dot(force on the frame, v) is zero.

    At q = 2 m under a load of 100 N along x. The motor holds it with 98 N towards negative q: 1 m of q is 0.98 m of
    travel, and the force across the guideway does not load it.

    >>> bench = gt.Builder("bench")
    >>> guideway = bench.part("guideway", gt.mechanics.Guideway(A=[0.0, 0.5, 1.0], v=[0.98, 0.0, 0.0]))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(motor.flange, guideway.flange), gt.connect(guideway.frame, load.frame))
    >>> f = bench.causal(known=["motor.flange.s", "load.force"], targets=["load.frame.r", "motor.force"])
    >>> r, force, status = f(2.0, [100.0, 0.0, -500.0])
    >>> print(r, force)
    [1.96 0.5  1.  ] -98.0
    """

    A = gt.parameter(shape=3, unit="m", description="frame position at q = 0")
    v = gt.parameter(shape=3, unit="1", kind="direction", description="guideway direction times transmission scale")
    flange = gt.port(Flange)
    frame = gt.port(PointFrame)

    def equations(self):
        yield self.frame.r == self.A + self.flange.s * self.v
        yield self.flange.f + gt.dot(self.frame.f, self.v) == 0


class CompliantGuideway(Guideway):
    """A compliant guideway: frame.r = A + q v + offset, where the force f [N] on the frame is K offset.

    K (3, 3) [N/m], symmetric, world axes: drive, bearings and machine frame in series, along the guideway and across.
    The coordinate q is not affected: compliance of the drive is part of K.

    A load of 100 N across a guideway of 1e7 N/m displaces the frame by 10 micrometres:

    >>> bench = gt.Builder("bench")
    >>> K = 1e7 * np.eye(3)
    >>> guideway = bench.part("guideway", gt.mechanics.CompliantGuideway(A=np.zeros(3), v=[1.0, 0.0, 0.0], K=K))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(motor.flange, guideway.flange), gt.connect(guideway.frame, load.frame))
    >>> f = bench.causal(known=["motor.flange.s", "load.force"], targets="load.frame.r")
    >>> r, status = f(2.0, [0.0, 100.0, 0.0])
    >>> r.round(7)
    array([2.e+00, 1.e-05, 0.e+00])
    """

    K = gt.parameter(
        shape=(3, 3), unit="N/m", kind="semidefinite", description="stiffness of drive, bearings and frame, world axes"
    )
    offset = gt.variable(3, unit="m", nominal=1e-4, description="displacement of the frame under its force")

    def equations(self):
        force = self.frame.f
        yield self.frame.r == self.A + self.flange.s * self.v + self.offset
        yield force == self.K @ self.offset
        yield self.flange.f + gt.dot(force, self.v) == 0
        yield gt.energy(stored=gt.dot(self.offset, force) / 2)
