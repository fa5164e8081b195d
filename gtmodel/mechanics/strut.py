"""A strut that changes its length: linear actuator between two points."""

from __future__ import annotations

from .. import lang as gt
from .frames import PointFrame


class Strut(gt.Model):
    """Massless linear actuator between two spherical joints, e.g. a leg of a hexapod.

    `force` [N] pushes the ends apart where it is positive. Branch `extended`: length > 0, the only side that means
    anything.

    A leg of 2 m that bears a mass of 5 kg above it: `force` pushes its ends apart.

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
    length = gt.variable(unit="m", start=1.0, description="distance of the joint centres")
    force = gt.variable(unit="N", nominal=100.0, description="force that pushes the ends apart")

    def equations(self):
        ab = self.b.r - self.a.r
        yield gt.dot(ab, ab) == self.length**2
        yield self.a.f == self.force / self.length * ab
        yield self.b.f == -self.force / self.length * ab
        yield gt.branch("extended", self.length)
        yield gt.energy(supplied=self.force * gt.der(self.length))
