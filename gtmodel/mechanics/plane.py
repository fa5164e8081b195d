"""A plane that a point slides on."""

from __future__ import annotations

from .. import lang as gt
from .frames import PointFrame


class Plane(gt.Model):
    """The frame's point stays in the plane through p [m] with normal n (3); without friction, the force is along n.

    With it a planar mechanism of rods stands in three dimensions without redundant constraints.
    """

    p = gt.parameter([0.0, 0.0, 0.0], unit="m", description="a point of the plane")
    n = gt.parameter([0.0, 0.0, 1.0], unit="1", kind="direction", description="normal, of any length but zero")
    frame = gt.port(PointFrame)
    pressure = gt.variable(unit="N", nominal=100.0, description="force on the point along n, per length of n")

    def equations(self):
        yield gt.dot(self.frame.r - self.p, self.n) == 0
        yield self.frame.f == -self.pressure * self.n
