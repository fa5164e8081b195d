"""A strut that changes its length: linear actuator between two points."""

from __future__ import annotations

from .. import lang as gt
from .frames import PointFrame


class Strut(gt.Model):
    """Massless linear actuator between two spherical joints, e.g. a leg of a hexapod.

    `force` [N] pushes the ends apart. Branch `extended`: length > 0, the only side that means anything.
    """

    a = gt.port(PointFrame)
    b = gt.port(PointFrame)
    length = gt.variable(unit="m", start=1.0, description="distance of the joint centres")
    force = gt.variable(unit="N", nominal=100.0, description="force that pushes the ends apart")

    def equations(self):
        ab = self.b.r - self.a.r
        yield gt.dot(ab, ab) == self.length**2
        yield self.a.f == self.force / self.length * ab
        yield self.b.f == -self.force / self.length * ab
        yield gt.branch("extended", self.length)
        yield gt.energy(supplied=self.force * gt.der(self.length))
