"""A plane that a point slides on."""

from __future__ import annotations

from .. import lang as gt
from .frames import PointFrame


class Plane(gt.Model):
    """The frame's point stays in the plane through p [m] with normal n (3); without friction, the force is along n.

    With it a planar mechanism of rods stands in three dimensions without redundant constraints.

    A point that slides on the floor: the force on it along the normal bears its weight.

    >>> bench = gt.Builder("bench")
    >>> floor = bench.part("floor", gt.mechanics.Plane(p=[0.0, 0.0, 0.1], n=[0.0, 0.0, 1.0]))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=3.0))
    >>> bench.add(gt.connect(floor.frame, mass.frame))
    >>> f = bench.causal(targets=["floor.pressure", "mass.frame.r[2]"], prefer=["mass.frame.r[0]", "mass.frame.r[1]"])
    >>> pressure, height, status = f(0.0, 0.0)
    >>> print(round(pressure, 6), height)
    29.43 0.1
    """

    p = gt.parameter([0.0, 0.0, 0.0], unit="m", description="a point of the plane")
    n = gt.parameter([0.0, 0.0, 1.0], unit="1", kind="direction", description="normal, of any length but zero")
    frame = gt.port(PointFrame)
    pressure = gt.variable(unit="N", nominal=100.0, description="force on the point along n, per length of n")

    def equations(self):
        yield gt.dot(self.frame.r - self.p, self.n) == 0
        yield self.frame.f == -self.pressure * self.n
