"""A massless slide along a straight guideway, rigid or compliant."""

from __future__ import annotations

from .. import lang as gt
from .frames import Flange, PointFrame


class Guideway(gt.Model):
    """Point A + q v on a straight line (Dressler 2012, eq. (6.4)).

    |v| is a transmission scale (0.96 to 1.003 on real robots) and is never normalised. The flange's coordinate
    is q; what pushes the flange along q is balanced by the frame's force along v.
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
    q stays where the drive holds it.
    """

    K = gt.parameter(
        shape=(3, 3), unit="N/m", kind="semidefinite", description="stiffness of drive, bearings and frame, world axes"
    )
    offset = gt.variable(3, unit="m", nominal=1e-4, description="how far the frame has given way")

    def equations(self):
        force = self.frame.f
        yield self.frame.r == self.A + self.flange.s * self.v + self.offset
        yield force == self.K @ self.offset
        yield self.flange.f + gt.dot(force, self.v) == 0
        yield gt.energy(stored=gt.dot(self.offset, force) / 2)
