"""Fixed components (world frame, fixed points) and rigid placements of one frame on another, by vectors, roll-pitch-yaw
angles or Denavit-Hartenberg parameters."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from .. import lang as gt
from .bodies import rotation_about
from .frames import Flange, Frame, PointFrame, Shaft


class Ground(gt.Model):
    """The world frame, at rest at the origin. It is the root of all components connected to it; use Fixed to place
    frames elsewhere.

    Position of the top of a tower of 2 m:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> tower = bench.part("tower", gt.mechanics.FixedTranslation(d=[0.0, 0.0, 2.0]))
    >>> load = bench.part("load", gt.mechanics.FrameLoad())
    >>> bench.add(gt.connect(ground.frame, tower.a), gt.connect(tower.b, load.frame))
    >>> r, R, status = bench.causal(known=["load.force", "load.torque"], targets=["load.frame.r", "load.frame.R"])()
    >>> print(r, np.array_equal(R, np.eye(3)))
    [0. 0. 2.] True
    """

    frame = gt.port(Frame)

    def equations(self):
        yield gt.tree_root(self.frame)
        yield self.frame.r == np.zeros(3)
        yield np.eye(3) == self.frame.R
        yield self.frame.w == np.zeros(3)


class Anchor(gt.Model):
    """A point r [m] fixed in the world, for rods and spring-dampers.

    A mass of 3 kg at rest 1.2 m below the anchor. The spring is stretched by 0.2 m and pulls with 200 N; the load
    balances this pull and the weight of 29.43 N:

    >>> bench = gt.Builder("bench")
    >>> anchor = bench.part("anchor", gt.mechanics.Anchor(r=[0.0, 0.0, 2.0]))
    >>> spring = bench.part("spring", gt.mechanics.SpringDamper(k=1000.0, length0=1.0))
    >>> mass = bench.part("mass", gt.mechanics.PointMass(m=3.0))
    >>> load = bench.part("load", gt.mechanics.PointLoad())
    >>> bench.add(gt.connect(anchor.point, spring.a), gt.connect([spring.b, mass.frame], [mass.frame, load.frame]))
    >>> hold = bench.causal(known="mass.frame.r", targets=["spring.pull", "load.force"])
    >>> rest = np.zeros(3)
    >>> pull, force, status = hold([0.0, 0.0, 0.8], rest, rest)
    >>> print(round(pull, 6), force.round(6))
    200.0 [   0.      0.   -170.57]
    """

    r = gt.parameter([0.0, 0.0, 0.0], unit="m", description="position in the world frame")
    point = gt.port(PointFrame)

    def equations(self):
        yield self.point.r == self.r


class FixedFlange(gt.Model):
    """A flange fixed at s [m].

    Force of a motor that stretches a spring by 0.02 m from a fixed flange at 0:

    >>> bench = gt.Builder("bench")
    >>> wall = bench.part("wall", gt.mechanics.FixedFlange(s=0.0))
    >>> spring = bench.part("spring", gt.mechanics.FlangeSpringDamper(k=1000.0))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect(wall.flange, spring.a), gt.connect(spring.b, motor.flange))
    >>> hold = bench.causal(known="motor.flange.s", targets="motor.force")
    >>> force, status = hold(0.02, 0.0)  # position and velocity
    >>> print(round(force, 6))
    20.0
    """

    s = gt.parameter(0.0, unit="m", description="coordinate")
    flange = gt.port(Flange)

    def equations(self):
        yield self.flange.s == self.s


class FixedShaft(gt.Model):
    """A shaft fixed at the angle phi [rad].

    Torque of a motor that twists a torsional spring by 0.1 rad against a fixed shaft:

    >>> bench = gt.Builder("bench")
    >>> wall = bench.part("wall", gt.mechanics.FixedShaft(phi=0.0))
    >>> spring = bench.part("spring", gt.mechanics.ShaftSpringDamper(k=50.0))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect(wall.shaft, spring.a), gt.connect(spring.b, motor.shaft))
    >>> hold = bench.causal(known="motor.shaft.phi", targets="motor.torque")
    >>> torque, status = hold(0.1, 0.0, 0.0)  # angle, velocity, acceleration
    >>> print(round(torque, 6))
    5.0
    """

    phi = gt.parameter(0.0, unit="rad", description="angle")
    shaft = gt.port(Shaft)

    def equations(self):
        yield self.shaft.phi == self.phi


def rigid(a: Any, b: Any, d: Any, R: Any = None) -> Iterator[Any]:
    """Yield the equations of frame b fixed to frame a at d [m] with the rotation R from b to a, None for parallel."""
    arm = a.R @ d
    yield b.r == a.r + arm
    yield gt.tree_edge(a, b, either=(b.R == a.R, b.R == a.R) if R is None else (b.R == a.R @ R, b.R @ R.T == a.R))
    yield b.w == a.w
    yield a.f + b.f == 0
    yield a.t + b.t + gt.cross(arm, b.f) == 0


class Fixed(gt.Model):
    """Frame b fixed to frame a: displaced by d [m] and rotated by R (3, 3), both in a's coordinates. Massless.

    R transforms b's coordinates to a's and must be a rotation (the origin of a joint in URDF).

    A bracket with a displacement of 0.5 m along x and a rotation by 90 degrees about z, so that x of b is y of a:

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

    d = gt.parameter([0.0, 0.0, 0.0], unit="m", description="displacement from a to b, coordinates of a")
    R = gt.parameter(np.eye(3), unit="1", kind="rotation", description="rotation from coordinates of b to those of a")
    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        yield from rigid(self.a, self.b, self.d, self.R)


class FixedTranslation(gt.Model):
    """Frame b fixed to frame a, parallel to it, displaced by d [m] in a's coordinates. Massless.

    A load of 10 N downwards at the end of an arm of 0.5 m, and the torque on its mount:

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

    d = gt.parameter(shape=3, unit="m", description="displacement from a to b, coordinates of a")
    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        yield from rigid(self.a, self.b, self.d)


class PointOnFrame(gt.Model):
    """A point fixed to a frame at d [m], frame coordinates: the centre of a spherical joint.

    It connects a Frame and a PointFrame: it transmits forces, but no orientation and no torques.

    A load of 10 N downwards at a corner, and the torque on the ground about its origin:

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


X, Y, Z = np.eye(3)


class _Placement(gt.Model):
    """Frame b fixed to frame a, massless; subclasses define the placement."""

    a = gt.port(Frame)
    b = gt.port(Frame)


class FixedRpy(_Placement):
    """Frame b at `xyz` [m] in a with orientation `rpy` [rad], Rz(yaw) Ry(pitch) Rx(roll): a joint origin in URDF.

    >>> bench = gt.Builder("bench")
    >>> ground, load = bench.part("ground", gt.mechanics.Ground()), bench.part("load", gt.mechanics.FrameLoad())
    >>> arm = bench.part("arm", gt.mechanics.FixedRpy(xyz=[0.5, 0.0, 0.0], rpy=[0.0, 0.0, np.pi / 2]))
    >>> tool = bench.part("tool", gt.mechanics.FixedTranslation(d=[0.2, 0.0, 0.0]))
    >>> bench.add(gt.connect([ground.frame, arm.b, tool.b], [arm.a, tool.a, load.frame]))
    >>> r, status = bench.causal(known=["load.force", "load.torque"], targets="tool.b.r")()
    >>> r.round(6)
    array([0.5, 0.2, 0. ])
    """

    xyz = gt.parameter([0.0, 0.0, 0.0], unit="m", description="origin of b, coordinates of a")
    rpy = gt.parameter([0.0, 0.0, 0.0], unit="rad", description="roll, pitch, yaw about the fixed axes x, y, z of a")

    def equations(self):
        displacement = self.xyz
        roll, pitch, yaw = (self.rpy[k] for k in range(3))
        rotation = rotation_about(Z, yaw) @ rotation_about(Y, pitch) @ rotation_about(X, roll)
        yield from rigid(self.a, self.b, displacement, rotation)


class _DenavitHartenberg(_Placement):
    theta = gt.parameter(0.0, unit="rad", description="angle about z, added to the joint angle")
    d = gt.parameter(0.0, unit="m", description="distance along z")
    a_x = gt.parameter(0.0, unit="m", description="link length a, distance along x")
    alpha = gt.parameter(0.0, unit="rad", description="twist, angle about x")
    beta = gt.parameter(0.0, unit="rad", description="Hayati's angle about y, for an axis nearly parallel to the next")


class FixedDH(_DenavitHartenberg):
    """Frame b placed by standard Denavit-Hartenberg parameters, Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta) from frame a.

    A joint about or along z of a comes before it. `a_x` is the length called a. If the next axis is nearly parallel, d
    of the two links cannot be distinguished, and a small tilt moves the common normal far: then keep d fixed and use
    Hayati's beta, which is 0 otherwise.

    >>> bench = gt.Builder("bench")
    >>> ground, load = bench.part("ground", gt.mechanics.Ground()), bench.part("load", gt.mechanics.FrameLoad())
    >>> link = bench.part("link", gt.mechanics.FixedDH(theta=np.pi / 2, d=0.4, a_x=0.3, alpha=np.pi / 2))
    >>> bench.add(gt.connect(ground.frame, link.a), gt.connect(link.b, load.frame))
    >>> f = bench.causal(known=["load.force", "load.torque"], targets=["link.b.r", "link.b.R"])
    >>> r, R, status = f()
    >>> print(r.round(6) + 0.0, R[:, 2].round(6) + 0.0)  # origin and z of the next frame
    [0.  0.3 0.4] [1. 0. 0.]
    """

    def equations(self):
        displacement = gt.vector([self.a_x * gt.cos(self.theta), self.a_x * gt.sin(self.theta), self.d])
        rotation = rotation_about(Z, self.theta) @ rotation_about(X, self.alpha) @ rotation_about(Y, self.beta)
        yield from rigid(self.a, self.b, displacement, rotation)


class FixedModifiedDH(_DenavitHartenberg):
    """Frame b placed by modified Denavit-Hartenberg parameters (Craig), Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d).

    A joint about or along z of b comes after it; a, alpha and Hayati's beta lead from the previous axis to this one.

    >>> bench = gt.Builder("bench")
    >>> ground, load = bench.part("ground", gt.mechanics.Ground()), bench.part("load", gt.mechanics.FrameLoad())
    >>> link = bench.part("link", gt.mechanics.FixedModifiedDH(a_x=0.3, alpha=-np.pi / 2, d=0.4))
    >>> bench.add(gt.connect(ground.frame, link.a), gt.connect(link.b, load.frame))
    >>> r, status = bench.causal(known=["load.force", "load.torque"], targets="link.b.r")()
    >>> r.round(6)
    array([0.3, 0.4, 0. ])
    """

    def equations(self):
        tilt = rotation_about(X, self.alpha) @ rotation_about(Y, self.beta)
        displacement = self.a_x * X + self.d * (tilt @ Z)
        rotation = rotation_about(X, self.alpha) @ rotation_about(Y, self.beta) @ rotation_about(Z, self.theta)
        yield from rigid(self.a, self.b, displacement, rotation)
