"""Joints between two frames: revolute, prismatic, cylindrical, planar, screw, universal and spherical.

A joint that closes a loop uses the equations of `closing` instead of `equations`, see `gt.loops`.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from .. import lang as gt
from .closures import angle_between_frames, held_position, held_rotation, held_tilt, normals, turned
from .drives import RackAndPinion
from .frames import Flange, Frame, Shaft


class Revolute(gt.Model):
    """Frame b turns about an axis of frame a by the angle of `shaft`, right-handed; at angle 0 the frames are equal.

    `axis` (3) is in a's coordinates and may have any nonzero length. A component on the shaft (motor, friction, spring)
    acts between a and b: a positive torque turns b about +axis. An unconnected shaft turns freely.

    An arm at 30 degrees about z with a load along y, and the motor torque that holds it:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> joint = bench.part("joint", gt.mechanics.Revolute(axis=[0.0, 0.0, 1.0]))
    >>> arm = bench.part("arm", gt.mechanics.FixedTranslation(d=[0.5, 0.0, 0.0]))
    >>> load = bench.part("load", gt.mechanics.FrameLoad())
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect([ground.frame, joint.b, arm.b, joint.shaft], [joint.a, arm.a, load.frame, motor.shaft]))
    >>> f = bench.causal(known=["joint.shaft.phi", "load.force", "load.torque"], targets=["arm.b.r", "motor.torque"])
    >>> r, torque, status = f(np.pi / 6, 0.0, 0.0, [0.0, 10.0, 0.0], np.zeros(3))
    >>> print(r.round(3), round(torque, 3))
    [0.433 0.25  0.   ] -4.33
    """

    if_redundant: ClassVar[str] = (
        "in a loop with parallel axes, use gt.mechanics.PlanarLoopClosure instead of this joint"
    )

    axis = gt.parameter(
        [0.0, 0.0, 1.0], unit="1", kind="direction", description="direction of the axis, the same in frames a and b"
    )
    a = gt.port(Frame)
    b = gt.port(Frame)
    shaft = gt.port(Shaft)

    def equations(self):
        a, b = self.a, self.b
        n = self.axis / gt.norm(self.axis)
        yield b.r == a.r
        yield gt.tree_edge(a, b, self.closing, either=turned(a, b, n, self.shaft.phi))
        yield b.w == a.w + gt.der(self.shaft.phi) * (a.R @ n)
        yield from self._flows(n)

    def closing(self):
        """Yield the equations of a revolute joint that closes a loop: five constraints and its angle."""
        a, b = self.a, self.b
        n = self.axis / gt.norm(self.axis)
        across = normals(n)
        yield from held_position(a, b, (n, *across))
        yield from held_tilt(a, b, n, across)
        yield angle_between_frames(a, b, across, self.shaft.phi)
        yield from self._flows(n)

    def _flows(self, n):
        a, b = self.a, self.b
        yield a.f + b.f == 0
        yield a.t + b.t == 0
        yield self.shaft.t + gt.dot(a.R @ n, b.t) == 0


class Prismatic(gt.Model):
    """Frame b slides by s v relative to frame a and stays parallel to it; s is the coordinate of `flange`.

    v (3) is in a's coordinates; its length is a transmission scale and is never normalised, as in Guideway. A component
    on the flange acts between a and b: a positive force pushes b along +v.

    A motor force of 6 N accelerates 3 kg on a slide along x by 2 m/s2:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> slide = bench.part("slide", gt.mechanics.Prismatic(v=[1.0, 0.0, 0.0]))
    >>> body = bench.part("body", gt.mechanics.RigidBody(m=3.0, I=np.zeros((3, 3))))
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect([ground.frame, slide.b, slide.flange], [slide.a, body.frame, motor.flange]))
    >>> acceleration, status = bench.causal(known="motor.force", targets="der(slide.flange.s,2)")(0.0, 0.0, 6.0)
    >>> print(round(acceleration, 6))
    2.0
    """

    v = gt.parameter(
        [1.0, 0.0, 0.0], unit="1", kind="direction", description="direction times transmission scale, in frame a"
    )
    a = gt.port(Frame)
    b = gt.port(Frame)
    flange = gt.port(Flange)

    def equations(self):
        a, b = self.a, self.b
        yield b.r == a.r + self.flange.s * (a.R @ self.v)
        yield gt.tree_edge(a, b, self.closing, either=(b.R == a.R, b.R == a.R))
        yield b.w == a.w
        yield from self._flows()

    def closing(self):
        """Yield the equations of a prismatic joint that closes a loop: five constraints and its travel."""
        a, b, v = self.a, self.b, self.v
        yield from held_position(a, b, normals(v / gt.norm(v)))
        yield from held_rotation(a, b)
        yield gt.dot(a.R @ v, b.r - a.r) == self.flange.s * gt.dot(v, v)
        yield from self._flows()

    def _flows(self):
        a, b = self.a, self.b
        v = a.R @ self.v
        yield a.f + b.f == 0
        yield a.t + b.t + gt.cross(self.flange.s * v, b.f) == 0
        yield self.flange.f + gt.dot(v, b.f) == 0


class Cylindrical(gt.Model):
    """Frame b turns about an axis of frame a by the angle of `shaft` and slides along it by the travel s of `flange`.

    `axis` (3) is in a's coordinates and may have any nonzero length; the travel is in metres. Shaft and flange may
    carry motors, friction or springs, as those of Revolute and Prismatic.

    A bolt turned by 90 degrees and pushed out by 0.1 m; 2 kg hang from its end:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> bolt = bench.part("bolt", gt.mechanics.Cylindrical(axis=[0.0, 0.0, 1.0]))
    >>> body = bench.part("body", gt.mechanics.RigidBody(m=2.0, c=[0.3, 0.0, 0.0], I=0.01 * np.eye(3)))
    >>> pusher = bench.part("pusher", gt.mechanics.ForceMotor())
    >>> turner = bench.part("turner", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect([ground.frame, bolt.b], [bolt.a, body.frame]))
    >>> bench.add(gt.connect(bolt.flange, pusher.flange), gt.connect(bolt.shaft, turner.shaft))
    >>> f = bench.causal(known=["bolt.flange.s", "bolt.shaft.phi"], targets=["body.frame.R", "pusher.force"])
    >>> R, force, status = f(0.1, 0.0, 0.0, np.pi / 2, 0.0, 0.0)
    >>> print(R[:, 0].round(6) + 0.0, round(force, 6))
    [0. 1. 0.] 19.62
    """

    axis = gt.parameter(
        [0.0, 0.0, 1.0], unit="1", kind="direction", description="direction of the axis, the same in frames a and b"
    )
    a = gt.port(Frame)
    b = gt.port(Frame)
    shaft = gt.port(Shaft)
    flange = gt.port(Flange)

    def equations(self):
        a, b = self.a, self.b
        n = self.axis / gt.norm(self.axis)
        yield b.r == a.r + self.flange.s * (a.R @ n)
        yield gt.tree_edge(a, b, self.closing, either=turned(a, b, n, self.shaft.phi))
        yield b.w == a.w + gt.der(self.shaft.phi) * (a.R @ n)
        yield from self._flows(n)

    def closing(self):
        """Yield the equations of a cylindrical joint that closes a loop: four constraints, its angle and its travel."""
        a, b = self.a, self.b
        n = self.axis / gt.norm(self.axis)
        across = normals(n)
        yield from held_position(a, b, across)
        yield from held_tilt(a, b, n, across)
        yield angle_between_frames(a, b, across, self.shaft.phi)
        yield gt.dot(a.R @ n, b.r - a.r) == self.flange.s
        yield from self._flows(n)

    def _flows(self, n):
        a, b = self.a, self.b
        along = a.R @ n
        yield a.f + b.f == 0
        yield a.t + b.t + gt.cross(self.flange.s * along, b.f) == 0
        yield self.shaft.t + gt.dot(along, b.t) == 0
        yield self.flange.f + gt.dot(along, b.f) == 0


class Planar(gt.Model):
    """Frame b slides in a plane of frame a and turns about the plane's normal, `axis` (3) in a's coordinates.

    `first` (3), in the plane and perpendicular to `axis`, is the direction of the travel of `flange_1`; that of
    `flange_2` is axis x first. Both are used as unit vectors. `shaft` carries the angle. All three may carry motors.

    A puck at (0.3, 0.4) m, turned by 30 degrees, on a horizontal table that bears its weight:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> table = bench.part("table", gt.mechanics.Planar())
    >>> puck = bench.part("puck", gt.mechanics.RigidBody(m=2.0, I=0.01 * np.eye(3)))
    >>> bench.add(gt.connect(ground.frame, table.a), gt.connect(table.b, puck.frame))
    >>> coordinates = ["table.flange_1.s", "table.flange_2.s", "table.shaft.phi"]
    >>> f = bench.causal(targets=["puck.frame.r", "table.b.f"], prefer=coordinates)
    >>> r, force, status = f(0.3, 0.4, np.pi / 6, 0.0, 0.0, 0.0)
    >>> print(r + 0.0, force.round(6) + 0.0)
    [0.3 0.4 0. ] [  0.     0.   -19.62]
    """

    axis = gt.parameter([0.0, 0.0, 1.0], unit="1", kind="direction", description="normal of the plane, in frame a")
    first = gt.parameter(
        [1.0, 0.0, 0.0], unit="1", kind="direction", description="direction of flange_1 in the plane, in frame a"
    )
    a = gt.port(Frame)
    b = gt.port(Frame)
    flange_1 = gt.port(Flange)
    flange_2 = gt.port(Flange)
    shaft = gt.port(Shaft)

    def equations(self):
        a, b = self.a, self.b
        n, across = self._directions()
        yield b.r == a.r + a.R @ (self.flange_1.s * across[0] + self.flange_2.s * across[1])
        yield gt.tree_edge(a, b, self.closing, either=turned(a, b, n, self.shaft.phi))
        yield b.w == a.w + gt.der(self.shaft.phi) * (a.R @ n)
        yield from self._flows(n, across)

    def closing(self):
        """Yield the equations of a planar joint that closes a loop: three constraints and its coordinates."""
        a, b = self.a, self.b
        n, across = self._directions()
        yield from held_position(a, b, (n,))
        yield from held_tilt(a, b, n, across)
        yield angle_between_frames(a, b, across, self.shaft.phi)
        for flange, direction in zip((self.flange_1, self.flange_2), across, strict=True):
            yield gt.dot(a.R @ direction, b.r - a.r) == flange.s
        yield from self._flows(n, across)

    def _directions(self):
        n, first = self.axis / gt.norm(self.axis), self.first / gt.norm(self.first)
        return n, (first, gt.cross(n, first))

    def _flows(self, n, across):
        a, b = self.a, self.b
        slide = a.R @ (self.flange_1.s * across[0] + self.flange_2.s * across[1])
        yield a.f + b.f == 0
        yield a.t + b.t + gt.cross(slide, b.f) == 0
        yield self.shaft.t + gt.dot(a.R @ n, b.t) == 0
        for flange, direction in zip((self.flange_1, self.flange_2), across, strict=True):
            yield flange.f + gt.dot(a.R @ direction, b.f) == 0


class Screw(gt.Model):
    """Frame b turns about an axis of frame a and slides along it by `lead` [m] per turn, without losses.

    A positive lead is a right-hand thread. The joint has one degree of freedom: motors may act on `shaft` or `flange`.

    A spindle of 5 mm lead lifts 100 kg; without friction that takes m g lead / (2 pi):

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> spindle = bench.part("spindle", gt.mechanics.Screw(lead=0.005))
    >>> load = bench.part("load", gt.mechanics.RigidBody(m=100.0, I=np.eye(3)))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect([ground.frame, spindle.b, spindle.shaft], [spindle.a, load.frame, motor.shaft]))
    >>> f = bench.causal(known="spindle.shaft.phi", targets=["load.frame.r", "motor.torque"])
    >>> r, torque, status = f(2 * np.pi, 0.0, 0.0)
    >>> print(r, round(torque, 6))
    [0.    0.    0.005] 0.780655
    """

    axis = gt.parameter(
        [0.0, 0.0, 1.0], unit="1", kind="direction", description="direction of the axis, the same in frames a and b"
    )
    lead = gt.parameter(unit="m", nonzero=True, description="travel per turn, positive for a right-hand thread")
    a = gt.port(Frame)
    b = gt.port(Frame)
    shaft = gt.port(Shaft)
    flange = gt.port(Flange)
    joint = gt.part(Cylindrical, axis=axis)
    thread = gt.part(RackAndPinion, radius=lambda self: self.lead / (2 * np.pi))

    def equations(self):
        yield gt.connect(self.a, self.joint.a)
        yield gt.connect(self.joint.b, self.b)
        yield gt.connect(self.joint.shaft, self.thread.shaft)
        yield gt.connect(self.joint.flange, self.thread.flange)
        yield gt.connect(self.shaft, self.joint.shaft)
        yield gt.connect(self.flange, self.joint.flange)


class Universal(gt.Model):
    """Two revolute joints with intersecting axes: axis_1 in frame a, then axis_2 in the frame turned by the first.

    shaft_1 and shaft_2 may carry motors, friction or springs. Their angles are not the angles of a cardan shaft.

    A rotation by 30 degrees about x of a tilts the body's z axis towards -y:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> joint = bench.part("joint", gt.mechanics.Universal())
    >>> body = bench.part("body", gt.mechanics.RigidBody(m=1.0, I=np.eye(3)))
    >>> motors = [bench.part(name, gt.mechanics.TorqueMotor()) for name in ("motor_1", "motor_2")]
    >>> bench.add(gt.connect([ground.frame, joint.b], [joint.a, body.frame]))
    >>> bench.add(gt.connect([joint.shaft_1, joint.shaft_2], [motor.shaft for motor in motors]))
    >>> f = bench.causal(known=["joint.shaft_1.phi", "joint.shaft_2.phi"], targets="body.frame.R")
    >>> R, status = f(np.pi / 6, 0.0)
    >>> R[:, 2].round(3)
    array([ 0.   , -0.5  ,  0.866])
    """

    axis_1 = gt.parameter([1.0, 0.0, 0.0], unit="1", kind="direction", description="first axis, in frame a")
    axis_2 = gt.parameter(
        [0.0, 1.0, 0.0], unit="1", kind="direction", description="second axis, in the frame of the cross"
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
    """The origins of two frames coincide; their orientations are independent.

    It transmits no orientation, so it may close a loop; the orientation of each side must be determined elsewhere (by a
    tree of joints, or a FreeBody).

    A body of 2 kg that hangs at rest from its frame's origin; the force at a bears its weight:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> joint = bench.part("joint", gt.mechanics.Spherical())
    >>> body = bench.part("body", gt.mechanics.FreeBody(m=2.0, c=[0.0, 0.0, -0.5], I=0.01 * np.eye(3)))
    >>> bench.add(gt.connect(ground.frame, joint.a), gt.connect(joint.b, body.frame))
    >>> f = bench.causal(targets=["joint.a.f", "der(body.frame.w)"], prefer="body.frame.w")
    >>> force, turn, status = f(np.zeros(3), 0.0, 0.0, 0.0)
    >>> print(force + 0.0)
    [ 0.    0.   19.62]
    """

    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        a, b = self.a, self.b
        for k in range(3):
            yield gt.constraint(a, b, b.r[k] == a.r[k], b.f[k], "position along")
        yield a.f + b.f == 0
        yield a.t == 0
        yield b.t == 0
