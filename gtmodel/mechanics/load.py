"""Loads from outside: a force on a point, a force and a torque on a frame."""

from __future__ import annotations

from .. import lang as gt
from .frames import Frame, PointFrame


class PointLoad(gt.Model):
    """Pushes a point with `force` (3) [N], world coordinates: process forces, payload tests."""

    frame = gt.port(PointFrame)
    force = gt.input(3, unit="N", nominal=100.0, description="force on what is connected, world coordinates")

    def equations(self):
        yield self.frame.f == -self.force
        yield gt.energy(supplied=gt.dot(self.force, gt.der(self.frame.r)))


class FrameLoad(gt.Model):
    """Pushes and turns a frame with `force` (3) [N] at its origin and `torque` (3) [N.m], world coordinates."""

    frame = gt.port(Frame)
    force = gt.input(3, unit="N", nominal=100.0, description="force on what is connected, world coordinates")
    torque = gt.input(3, unit="N.m", nominal=10.0, description="torque on what is connected, world coordinates")

    def equations(self):
        yield self.frame.f == -self.force
        yield self.frame.t == -self.torque
        yield gt.energy(supplied=gt.dot(self.force, gt.der(self.frame.r)) + gt.dot(self.torque, self.frame.w))
