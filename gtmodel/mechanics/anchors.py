"""What stands still: the world's frame, fixed points and locked flanges."""

from __future__ import annotations

import numpy as np

from .. import lang as gt
from .frames import Flange, Frame, PointFrame, Shaft


class Ground(gt.Model):
    """The world frame: origin, axes of the world, no motion. It is the root of everything fixed to it; Fixed places
    frames elsewhere."""

    frame = gt.port(Frame)

    def equations(self):
        yield gt.tree_root(self.frame)
        yield self.frame.r == np.zeros(3)
        yield np.eye(3) == self.frame.R
        yield self.frame.w == np.zeros(3)


class Anchor(gt.Model):
    """A point r [m] fixed in the world, for rods and spring-dampers."""

    r = gt.parameter([0.0, 0.0, 0.0], unit="m", description="position in the world frame")
    point = gt.port(PointFrame)

    def equations(self):
        yield self.point.r == self.r


class FixedFlange(gt.Model):
    """A flange that is held at s [m]."""

    s = gt.parameter(0.0, unit="m", description="coordinate")
    flange = gt.port(Flange)

    def equations(self):
        yield self.flange.s == self.s


class FixedShaft(gt.Model):
    """A shaft that is held at the angle phi [rad]."""

    phi = gt.parameter(0.0, unit="rad", description="angle")
    shaft = gt.port(Shaft)

    def equations(self):
        yield self.shaft.phi == self.phi
