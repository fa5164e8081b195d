"""Loads from outside: a force on a point, a force and a torque on a frame."""

from __future__ import annotations

from .. import lang as gt
from .frames import Frame, PointFrame


class PointLoad(gt.Model):
    """Pushes a point with `force` (3) [N], world coordinates: process forces, payload tests.

    The force acts on what is connected; the flow f of its own frame is the reaction.

    >>> bench = gt.Builder("bench")
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=2.0))
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(mass.frame, load.frame))
    >>> forward = bench.causal(known="load.force", targets=["der(mass.frame.r,2)", "load.frame.f"])
    >>> acceleration, reaction, status = forward([4.0, 1.0, 21.62])
    >>> print(acceleration.round(6), reaction)
    [2.  0.5 1. ] [ -4.    -1.   -21.62]
    """

    frame = gt.port(PointFrame)
    force = gt.input(3, unit="N", nominal=100.0, description="force on what is connected, world coordinates")

    def equations(self):
        yield self.frame.f == -self.force
        yield gt.energy(supplied=gt.dot(self.force, gt.der(self.frame.r)))


class FrameLoad(gt.Model):
    """Pushes and turns a frame with `force` (3) [N] at its origin and `torque` (3) [N.m], world coordinates.

    The accelerations of a body under a force at its centre of mass and a torque, without gravity:

    >>> bench = gt.Builder("bench")
    >>> world = bench.part("world", gt.mechanics.World(g=np.zeros(3)))
    >>> body = bench.part("body", gt.mechanics.FreeBody(m=2.0, I=np.diag([0.1, 0.2, 0.25])))
    >>> load = bench.part("load", gt.mechanics.FrameLoad())
    >>> bench.add(gt.connect(body.frame, load.frame))
    >>> f = bench.causal(
    ...     known=["load.force", "load.torque"],
    ...     targets=["der(body.frame.r,2)", "der(body.frame.w)"],
    ...     prefer=["body.frame.r", "body.frame.w"],
    ... )
    >>> rest, force, torque = np.zeros(3), [4.0, 0.0, 0.0], [0.0, 0.1, 0.0]
    >>> a, turn, status = f(rest, *rest, force, torque)  # w, three of e, the load
    >>> print(a + 0.0, turn.round(6) + 0.0)
    [2. 0. 0.] [0.  0.5 0. ]
    """

    frame = gt.port(Frame)
    force = gt.input(3, unit="N", nominal=100.0, description="force on what is connected, world coordinates")
    torque = gt.input(3, unit="N.m", nominal=10.0, description="torque on what is connected, world coordinates")

    def equations(self):
        yield self.frame.f == -self.force
        yield self.frame.t == -self.torque
        yield gt.energy(supplied=gt.dot(self.force, gt.der(self.frame.r)) + gt.dot(self.torque, self.frame.w))


class AppliedLoad(gt.Model):
    """As FrameLoad, with a force [N] and a torque [N.m] that equations of the model around it give: a spring to a
    target, a signal, a thruster that turns with the body.

    A body of 2 kg that is pulled towards the origin with 8 N/m, without gravity, where it is 0.5 m away along x:

    >>> bench = gt.Builder("bench")
    >>> world = bench.part("world", gt.mechanics.World(g=np.zeros(3)))
    >>> body = bench.part("body", gt.mechanics.FreeBody(m=2.0, I=np.eye(3)))
    >>> load = bench.part("load", gt.mechanics.AppliedLoad())
    >>> k = bench.parameter("k", 8.0, unit="N/m")
    >>> bench.add(gt.connect(body.frame, load.frame), load.force == -k * body.frame.r, load.torque == np.zeros(3))
    >>> pull = bench.causal(targets="der(body.frame.r,2)", prefer=["body.frame.r", "body.frame.w"])
    >>> acceleration, status = pull([0.5, 0.0, 0.0], np.zeros(3), 0.0, 0.0, 0.0)  # r, w, three of e
    >>> print(acceleration + 0.0)
    [-2.  0.  0.]
    """

    frame = gt.port(Frame)
    force = gt.variable(3, unit="N", nominal=100.0, description="force on what is connected, world coordinates")
    torque = gt.variable(3, unit="N.m", nominal=10.0, description="torque on what is connected, world coordinates")

    def equations(self):
        yield self.frame.f == -self.force
        yield self.frame.t == -self.torque
        yield gt.energy(supplied=gt.dot(self.force, gt.der(self.frame.r)) + gt.dot(self.torque, self.frame.w))
