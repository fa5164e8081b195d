"""Rigid connections: a frame and a point placed on another frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from .. import lang as gt
from .frames import Frame, PointFrame


def rigid(a: Any, b: Any, d: Any, R: Any = None) -> Iterator[Any]:
    """Equations of frame b fixed to frame a at d [m], its coordinates turned into a's by R, or parallel. Massless."""
    arm = a.R @ d
    yield gt.tree_edge(a, b)
    yield b.r == a.r + arm
    yield b.R == (a.R if R is None else a.R @ R)
    yield b.w == a.w
    yield a.f + b.f == 0
    yield a.t + b.t + gt.cross(arm, b.f) == 0


class Fixed(gt.Model):
    """Frame b fixed to frame a: displaced by d [m] and turned by the rotation R (3, 3), both in a's coordinates.

    R takes b's coordinates to a's and must be a rotation (URDF: the origin of a joint). Massless.

    Displaced by 0.5 m along x and turned by 90 degrees about z, so that x of b is y of a:

    >>> R = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> bracket = bench.part("bracket", gt.mechanics.Fixed(d=[0.5, 0.0, 0.0], R=R))
    >>> tool = bench.part("tool", gt.mechanics.FixedTranslation(d=[0.2, 0.0, 0.0]))
    >>> load = bench.part("load", gt.mechanics.FrameLoad())
    >>> bench.add(gt.connect([ground.frame, bracket.b, tool.b], [bracket.a, tool.a, load.frame]))
    >>> r, status = bench.causal(known=["load.force", "load.torque"], targets="tool.b.r")()
    >>> r
    array([0.5, 0.2, 0. ])
    """

    d = gt.parameter([0.0, 0.0, 0.0], unit="m", description="from a to b, coordinates of a")
    R = gt.parameter(np.eye(3), unit="1", kind="rotation", description="rotation from coordinates of b to those of a")
    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        yield from rigid(self.a, self.b, self.d, self.R)


class FixedTranslation(gt.Model):
    """Frame b fixed to frame a, parallel to it, displaced by d [m] in a's coordinates. Massless.

    A load of 10 N downwards at the end of an arm of 0.5 m, and the torque that its mount feels:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> arm = bench.part("arm", gt.mechanics.FixedTranslation(d=[0.5, 0.0, 0.0]))
    >>> load = bench.part("load", gt.mechanics.FrameLoad())
    >>> bench.add(gt.connect(ground.frame, arm.a), gt.connect(arm.b, load.frame))
    >>> f = bench.causal(known=["load.force", "load.torque"], targets=["arm.b.r", "ground.frame.t"])
    >>> r, torque, status = f([0.0, 0.0, -10.0], np.zeros(3))
    >>> print(r, torque + 0.0)
    [0.5 0.  0. ] [0. 5. 0.]
    """

    d = gt.parameter(shape=3, unit="m", description="from a to b, coordinates of a")
    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        yield from rigid(self.a, self.b, self.d)


class PointOnFrame(gt.Model):
    """A point fixed to a frame at d [m], frame coordinates: the centre of a spherical joint.

    From a Frame to a PointFrame and back: forces pass, orientation and torques do not.

    A load of 10 N downwards at a corner, and the torque that the ground feels about its origin:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> corner = bench.part("corner", gt.mechanics.PointOnFrame(d=[0.3, 0.2, 0.0]))
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(ground.frame, corner.frame), gt.connect(corner.point, load.frame))
    >>> f = bench.causal(known="load.force", targets=["corner.point.r", "ground.frame.t"])
    >>> r, torque, status = f([0.0, 0.0, -10.0])
    >>> print(r, torque + 0.0)
    [0.3 0.2 0. ] [-2.  3.  0.]
    """

    d = gt.parameter([0.0, 0.0, 0.0], unit="m", description="from the frame's origin to the point, frame coordinates")
    frame = gt.port(Frame)
    point = gt.port(PointFrame)

    def equations(self):
        d = self.frame.R @ self.d
        yield self.point.r == self.frame.r + d
        yield self.frame.f + self.point.f == 0
        yield self.frame.t + gt.cross(d, self.point.f) == 0
