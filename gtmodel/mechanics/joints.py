"""Joints between two frames: revolute, prismatic, universal, spherical; massless and without friction of their own."""

from __future__ import annotations

from .. import lang as gt
from .frames import Flange, Frame, Shaft
from .rotation import rotation_about


class Revolute(gt.Model):
    """Frame b turns about an axis of frame a by the angle of `shaft`; equal at angle 0, right-hand rule.

    `axis` (3) in a's coordinates, of any length but zero: only its direction counts. What turns the shaft (motor,
    friction, spring) stands on a and turns b; a shaft left alone turns freely.
    """

    axis = gt.parameter(
        [0.0, 0.0, 1.0], unit="1", kind="direction", description="direction of the axis, coordinates of a (and of b)"
    )
    a = gt.port(Frame)
    b = gt.port(Frame)
    shaft = gt.port(Shaft)

    def equations(self):
        a, b = self.a, self.b
        n = self.axis / gt.norm(self.axis)
        n_world = a.R @ n
        yield gt.tree_edge(a, b)
        yield b.r == a.r
        yield a.R @ rotation_about(n, self.shaft.phi) == b.R
        yield b.w == a.w + gt.der(self.shaft.phi) * n_world
        yield a.f + b.f == 0
        yield a.t + b.t == 0
        yield self.shaft.t + gt.dot(n_world, b.t) == 0


class Prismatic(gt.Model):
    """Frame b slides along s v of frame a and stays parallel to it; s is the coordinate of `flange`.

    v (3) in a's coordinates; its length is a transmission scale and is never normalised, as in Guideway. What pushes
    the flange stands on a and pushes b.
    """

    v = gt.parameter(
        [1.0, 0.0, 0.0], unit="1", kind="direction", description="direction times transmission scale, coordinates of a"
    )
    a = gt.port(Frame)
    b = gt.port(Frame)
    flange = gt.port(Flange)

    def equations(self):
        a, b = self.a, self.b
        v = a.R @ self.v
        slide = self.flange.s * v
        yield gt.tree_edge(a, b)
        yield b.r == a.r + slide
        yield b.R == a.R
        yield b.w == a.w
        yield a.f + b.f == 0
        yield a.t + b.t + gt.cross(slide, b.f) == 0
        yield self.flange.f + gt.dot(v, b.f) == 0


class Universal(gt.Model):
    """Two revolute joints through one point: about axis_1 of frame a, then about axis_2 of what it turns.

    shaft_1 and shaft_2 may carry motors, friction or springs. Their angles are not the angles of a cardan shaft.
    """

    axis_1 = gt.parameter([1.0, 0.0, 0.0], unit="1", kind="direction", description="first axis, coordinates of a")
    axis_2 = gt.parameter(
        [0.0, 1.0, 0.0], unit="1", kind="direction", description="second axis, coordinates of the cross"
    )
    a = gt.port(Frame)
    b = gt.port(Frame)
    shaft_1 = gt.port(Shaft)
    shaft_2 = gt.port(Shaft)
    first = gt.part(Revolute, axis=axis_1)
    second = gt.part(Revolute, axis=axis_2)

    def equations(self):
        yield gt.connect(self.a, self.first.a)
        yield gt.connect(self.first.b, self.second.a)
        yield gt.connect(self.second.b, self.b)
        yield gt.connect(self.shaft_1, self.first.shaft)
        yield gt.connect(self.shaft_2, self.second.shaft)


class Spherical(gt.Model):
    """The origins of two frames coincide; their orientations have nothing to do with each other.

    No orientation passes, so that it may close a loop; each side must get its orientation from elsewhere (a tree of
    joints, or a FreeBody).
    """

    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        a, b = self.a, self.b
        yield b.r == a.r
        yield a.f + b.f == 0
        yield a.t == 0
        yield b.t == 0
