"""Bodies."""

from __future__ import annotations

from .. import lang as gt
from .frames import PointFrame, World


class PointMass(gt.Model):
    """A point mass m [kg] under gravity."""

    m = gt.parameter(unit="kg", description="mass")
    frame = gt.port(PointFrame)
    world = gt.outer(World)

    def equations(self):
        yield self.frame.f == self.m * (gt.der(self.frame.r, 2) - self.world.g)
