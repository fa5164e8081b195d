"""Joints between two frames: revolute, prismatic, universal, spherical, and loop closures."""

from __future__ import annotations

from typing import Any, ClassVar

from .. import lang as gt
from .bodies import rotation_about
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

    axis = gt.parameter(
        [0.0, 0.0, 1.0], unit="1", kind="direction", description="direction of the axis, the same in frames a and b"
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
        yield b.r == a.r
        yield a.f + b.f == 0
        yield a.t == 0
        yield b.t == 0


class LoopClosure(gt.Model):
    """Closes a loop: two frames coincide, with six constraints, a force and a torque.

    A chain of joints from the ground back to the ground is a loop of orientations, which connected Frames cannot have:
    replace one connection by a LoopClosure. The loop must be spatial, with seven joint coordinates or more. In a planar
    loop three of the constraints are redundant; see PlanarLoopClosure.

    Force and torque of the six constraints that hold a free body of 2 kg:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> body = bench.part("body", gt.mechanics.FreeBody(m=2.0, c=[0.1, 0.0, 0.0], I=0.01 * np.eye(3)))
    >>> closure = bench.part("closure", gt.mechanics.LoopClosure())
    >>> bench.add(gt.connect([ground.frame, closure.b], [closure.a, body.frame]))
    >>> force, torque, status = bench.causal(targets=["closure.a.f", "closure.a.t"])()
    >>> print(force.round(6) + 0.0, torque.round(6) + 0.0)
    [ 0.    0.   19.62] [ 0.    -1.962  0.   ]
    """

    if_redundant: ClassVar[str] = (
        "if all axes of the loop are parallel, close it with gt.mechanics.PlanarLoopClosure instead of "
        "gt.mechanics.LoopClosure; otherwise remove from the closure the constraints that the joints already impose, "
        "or make a part compliant"
    )

    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        a, b = self.a, self.b
        turned: list[list[Any]] = [[gt.dot(a.R[:, i], b.R[:, j]) for j in range(3)] for i in range(3)]
        yield b.r == a.r
        # the axis of the rotation from a to b times tan(angle/2): zero only if they are parallel
        trace = turned[0][0] + turned[1][1] + turned[2][2]
        for i, j in ((1, 2), (2, 0), (0, 1)):
            yield (turned[j][i] - turned[i][j]) / (1.0 + trace) == 0
        yield a.f + b.f == 0
        yield a.t + b.t == 0


class PlanarLoopClosure(gt.Model):
    """A revolute joint that closes a planar loop: the origins of two frames coincide in the plane.

    `first` and `second` (3), coordinates of a, span the plane; the axis is normal to it. The other joints of the loop
    are parallel to the axis. They alone keep b in the plane and bear loads out of it, so this joint transmits no torque
    and no force along the axis.

    A parallelogram linkage with a crank of 0.3 m and a coupler of 0.5 m: the coupler stays level, and the rocker turns
    with the crank.

    >>> bench = gt.Builder("parallelogram")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> crank, coupler, rocker = (bench.part(n, gt.mechanics.Revolute()) for n in ("crank", "coupler", "rocker"))
    >>> lengths = {"bar": [0.3, 0.0, 0.0], "top": [0.5, 0.0, 0.0], "base": [0.5, 0.0, 0.0], "arm": [0.3, 0.0, 0.0]}
    >>> bar, top, base, arm = (bench.part(n, gt.mechanics.FixedTranslation(d=d)) for n, d in lengths.items())
    >>> closure = bench.part("closure", gt.mechanics.PlanarLoopClosure())
    >>> bench.add(gt.connect([ground.frame, crank.b, bar.b, coupler.b], [crank.a, bar.a, coupler.a, top.a]))
    >>> bench.add(gt.connect([ground.frame, base.b, rocker.b], [base.a, rocker.a, arm.a]))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect([top.b, arm.b, motor.shaft], [closure.a, closure.b, crank.shaft]))
    >>> follow = bench.causal(known="crank.shaft.phi", targets=["rocker.shaft.phi", "coupler.shaft.phi"])
    >>> rocker_angle, coupler_angle, status = follow(0.8)
    >>> print(round(rocker_angle, 6), round(np.sin(coupler_angle), 6))  # the sine of -0.8
    0.8 -0.717356
    """

    if_redundant: ClassVar[str] = (
        "gt.mechanics.PlanarLoopClosure closes a loop with parallel axes, with `first` and `second` normal to them; "
        "close a spatial loop with gt.mechanics.LoopClosure"
    )

    first = gt.parameter([1.0, 0.0, 0.0], unit="1", kind="direction", description="direction in the plane, of a")
    second = gt.parameter([0.0, 1.0, 0.0], unit="1", kind="direction", description="second direction in the plane")
    a = gt.port(Frame)
    b = gt.port(Frame)

    def equations(self):
        a, b = self.a, self.b
        gap = b.r - a.r
        yield gt.dot(a.R @ self.first, gap) == 0
        yield gt.dot(a.R @ self.second, gap) == 0
        yield a.f + b.f == 0
        yield gt.dot(a.R @ gt.cross(self.first, self.second), b.f) == 0
        yield a.t == 0
        yield b.t == 0
