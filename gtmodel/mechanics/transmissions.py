"""Joints with a transmission between bodies on one carrier: a pair of gears, a rack with its pinion, a belt.

The carrier, frame a, may move, as the arm of a planetary gear does; angles and travels are relative to it. There are no
losses: friction may act on the shafts. Gear, RackAndPinion and BallScrew are the same transmissions between shafts and
flanges, without frames.
"""

from __future__ import annotations

from .. import lang as gt
from .drives import Gear, RackAndPinion
from .frames import Flange, Frame, Shaft
from .joints import Prismatic, Revolute
from .placements import FixedTranslation


class GearPair(gt.Model):
    """Two spur gears with parallel axes on a carrier: phi_2 = -radius_1 / radius_2 phi_1.

    The first axis passes through the origin of frame a, the second through (radius_1 + radius_2) along `first`. A
    negative radius_2 is that of an internal gear; then both turn in the same sense. b_1 and b_2 are the gears' frames
    on their axes.

    A pinion of 20 mm drives a gear of 60 mm with 0.09 kg m2: the motor feels a ninth of it.

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> gears = bench.part("gears", gt.mechanics.GearPair(radius_1=0.02, radius_2=0.06))
    >>> wheel = bench.part("wheel", gt.mechanics.RigidBody(m=1.0, I=0.09 * np.eye(3)))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect([ground.frame, gears.b_2, gears.shaft_1], [gears.a, wheel.frame, motor.shaft]))
    >>> f = bench.causal(known="gears.shaft_1.phi", targets=["gears.shaft_2.phi", "gears.b_2.r", "motor.torque"])
    >>> phi, r, torque, status = f(0.3, 0.0, 100.0)
    >>> print(round(phi, 6), r, round(torque, 6))
    -0.1 [0.08 0.   0.  ] 1.0
    """

    axis = gt.parameter([0.0, 0.0, 1.0], unit="1", kind="direction", description="direction of both axes, in frame a")
    first = gt.parameter(
        [1.0, 0.0, 0.0], unit="1", kind="direction", description="from the first axis to the second, in frame a"
    )
    radius_1 = gt.parameter(unit="m", positive=True, description="pitch radius of the first gear")
    radius_2 = gt.parameter(unit="m", nonzero=True, description="pitch radius of the second gear, negative if internal")
    a = gt.port(Frame)
    b_1 = gt.port(Frame)
    b_2 = gt.port(Frame)
    shaft_1 = gt.port(Shaft)
    shaft_2 = gt.port(Shaft)
    joint_1 = gt.part(Revolute, axis=axis)
    offset = gt.part(FixedTranslation, d=lambda s: (s.radius_1 + s.radius_2) / gt.norm(s.first) * s.first)
    joint_2 = gt.part(Revolute, axis=axis)
    mesh = gt.part(Gear, ratio=lambda s: -s.radius_2 / s.radius_1)

    def equations(self):
        yield gt.connect([self.a, self.a, self.offset.b], [self.joint_1.a, self.offset.a, self.joint_2.a])
        yield gt.connect([self.joint_1.b, self.joint_2.b], [self.b_1, self.b_2])
        yield gt.connect([self.joint_1.shaft, self.joint_2.shaft], [self.mesh.a, self.mesh.b])
        yield gt.connect([self.joint_1.shaft, self.joint_2.shaft], [self.shaft_1, self.shaft_2])


class BeltDrive(GearPair):
    """Two pulleys with an inextensible toothed belt on a carrier: radius_1 phi_1 = radius_2 phi_2.

    A negative radius_2 is that of a crossed belt, which reverses the sense. The second axis is at `distance` [m] along
    `first`.

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> belt = bench.part("belt", gt.mechanics.BeltDrive(radius_1=0.02, radius_2=0.06, distance=0.4))
    >>> wheel = bench.part("wheel", gt.mechanics.RigidBody(m=1.0, I=0.09 * np.eye(3)))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect([ground.frame, belt.b_2, belt.shaft_1], [belt.a, wheel.frame, motor.shaft]))
    >>> f = bench.causal(known="belt.shaft_1.phi", targets=["belt.shaft_2.phi", "belt.b_2.r", "motor.torque"])
    >>> phi, r, torque, status = f(0.3, 0.0, 100.0)
    >>> print(round(phi, 6), r, round(torque, 6))
    0.1 [0.4 0.  0. ] 1.0
    """

    distance = gt.parameter(unit="m", positive=True, description="distance between the axes")
    offset = gt.part(FixedTranslation, d=lambda s: s.distance / gt.norm(s.first) * s.first)
    mesh = gt.part(Gear, ratio=lambda s: s.radius_2 / s.radius_1)


class Rack(gt.Model):
    """A pinion on a carrier and the rack that it drives: travel = radius * angle, along axis x first.

    The pinion's axis passes through the origin of frame a; the rack touches it at `radius` along `first`. b_1 is the
    pinion's frame, b_2 the rack's, at the point of contact at the angle zero.

    A pinion of 50 mm moves a rack of 12 kg; 1 m/s2 takes 0.6 N.m:

    >>> bench = gt.Builder("bench")
    >>> ground = bench.part("ground", gt.mechanics.Ground())
    >>> drive = bench.part("drive", gt.mechanics.Rack(radius=0.05))
    >>> rack = bench.part("rack", gt.mechanics.RigidBody(m=12.0, I=np.eye(3)))
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bench.add(gt.connect([ground.frame, drive.b_2, drive.shaft], [drive.a, rack.frame, motor.shaft]))
    >>> f = bench.causal(known="drive.shaft.phi", targets=["drive.b_2.r", "motor.torque"])
    >>> r, torque, status = f(0.2, 0.0, 20.0)
    >>> print(r, round(torque, 6))
    [0.05 0.01 0.  ] 0.6
    """

    axis = gt.parameter([0.0, 0.0, 1.0], unit="1", kind="direction", description="direction of the pinion's axis")
    first = gt.parameter(
        [1.0, 0.0, 0.0], unit="1", kind="direction", description="from the axis to the rack, perpendicular to the axis"
    )
    radius = gt.parameter(unit="m", positive=True, description="pitch radius of the pinion")
    a = gt.port(Frame)
    b_1 = gt.port(Frame)
    b_2 = gt.port(Frame)
    shaft = gt.port(Shaft)
    flange = gt.port(Flange)
    joint = gt.part(Revolute, axis=axis)
    offset = gt.part(FixedTranslation, d=lambda s: s.radius / gt.norm(s.first) * s.first)
    slide = gt.part(Prismatic, v=lambda s: gt.cross(s.axis / gt.norm(s.axis), s.first / gt.norm(s.first)))
    mesh = gt.part(RackAndPinion, radius=radius)

    def equations(self):
        yield gt.connect([self.a, self.a, self.offset.b], [self.joint.a, self.offset.a, self.slide.a])
        yield gt.connect([self.joint.b, self.slide.b], [self.b_1, self.b_2])
        yield gt.connect([self.joint.shaft, self.slide.flange], [self.mesh.shaft, self.mesh.flange])
        yield gt.connect([self.joint.shaft, self.slide.flange], [self.shaft, self.flange])
