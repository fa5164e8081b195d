"""Mechanisms as engineers draw them: bodies and joints that are connected, loops included. At most 30 lines each."""

from __future__ import annotations

import numpy as np

import gtmodel as gt
from gtmodel.geometry.rotations import rotation_about
from gtmodel.mechanics import (
    Cylindrical,
    Fixed,
    FixedDH,
    FixedTranslation,
    FreeBody,
    Ground,
    PlanarLoopClosure,
    Prismatic,
    Revolute,
    RigidBody,
    Spherical,
    TorqueMotor,
    Universal,
    World,
)

X, Y, Z = np.eye(3)
SLENDER = np.diag([1e-4, 0.01, 0.01])


class Bar(gt.Model):
    """A revolute joint about z, and a uniform bar of length L from the joint, where `link` is, to its tip b."""

    L = gt.parameter(unit="m")
    m = gt.parameter(1.0, unit="kg")
    a = gt.port(gt.mechanics.Frame)
    b = gt.port(gt.mechanics.Frame)
    link = gt.port(gt.mechanics.Frame)
    shaft = gt.port(gt.mechanics.Shaft)
    phi = gt.variable(unit="rad", prefer=1)
    joint = gt.part(Revolute)
    body = gt.part(RigidBody, m=m, c=lambda s: [s.L / 2, 0.0, 0.0], I=lambda s: _rod(s.m, s.L))
    bar = gt.part(FixedTranslation, d=lambda s: [s.L, 0.0, 0.0])

    def equations(self):
        yield gt.connect([self.a, self.joint.b, self.joint.b], [self.joint.a, self.body.frame, self.bar.a])
        yield gt.connect([self.bar.b, self.joint.shaft, self.joint.b], [self.b, self.shaft, self.link])
        yield self.phi == self.joint.shaft.phi


def _rod(m, L):
    J = m * L**2 / 12
    return [[0.0, 0.0, 0.0], [0.0, J, 0.0], [0.0, 0.0, J]]


class FourBar(gt.Model):
    """Four revolute joints in space with parallel axes: crank, coupler and rocker on a base."""

    lengths = gt.parameter([0.3, 0.7, 0.6, 0.8], unit="m")
    world = gt.part(World, g=-9.81 * Y)
    ground = gt.part(Ground)
    motor = gt.part(TorqueMotor)
    crank = gt.part(Bar, L=lambda s: s.lengths[0], phi={"start": 0.7})
    coupler = gt.part(Bar, L=lambda s: s.lengths[1])
    rocker = gt.part(Bar, L=lambda s: s.lengths[2], phi={"start": 1.4})
    base = gt.part(FixedTranslation, d=lambda s: [s.lengths[3], 0.0, 0.0])
    pin = gt.part(Revolute)

    def equations(self):
        yield gt.connect([self.ground.frame, self.crank.b], [self.crank.a, self.coupler.a])
        yield gt.connect([self.ground.frame, self.base.b], [self.base.a, self.rocker.a])
        yield gt.connect([self.coupler.b, self.rocker.b], [self.pin.a, self.pin.b])
        yield gt.connect(self.motor.shaft, self.crank.shaft)


class PlanarFourBar(FourBar):
    """The same, with a joint that closes the loop in the plane only."""

    pin = gt.part(PlanarLoopClosure)


class Bennett(gt.Model):
    """Bennett's linkage: four skew revolute joints, sin(alpha)/a = sin(beta)/b, opposite links equal."""

    a = gt.parameter(0.5, unit="m")
    alpha = gt.parameter(np.radians(35.0), unit="rad")
    beta = gt.parameter(np.radians(70.0), unit="rad")
    ground = gt.part(Ground)
    joint = gt.parts(4, Revolute)
    link = gt.parts(
        4,
        FixedDH,
        a_x=lambda s: [s.a, s.a * gt.sin(s.beta) / gt.sin(s.alpha)] * 2,
        alpha=lambda s: [s.alpha, s.beta] * 2,
    )
    theta = gt.variable(4, unit="rad", start=lambda s: bennett_angles(1.0, s.alpha, s.beta))

    def equations(self):
        yield gt.connect(self.ground.frame, self.joint[0].a)
        for k, (joint, link) in enumerate(zip(self.joint, self.link, strict=True)):
            yield gt.connect(joint.b, link.a)
            yield gt.connect(link.b, self.joint[k + 1].a if k < 3 else self.ground.frame)
            yield self.theta[k] == joint.shaft.phi


def dropped(cls, *cut):
    """A mechanism whose redundant constraints are dropped, with the joints of these names cut."""

    def equations(self):
        yield from cls.equations(self)
        yield gt.loops(cut=[getattr(self, name) for name in cut], redundant="drop")

    return type(cls.__name__, (cls,), {"equations": equations})()


def bennett_angles(first, alpha, beta):
    second = 2 * gt.atan(gt.sin((beta + alpha) / 2) / gt.sin((beta - alpha) / 2) / np.tan(first / 2))
    return [first, second, -first, -second]


class Sarrus(gt.Model):
    """Sarrus' linkage: two groups of three parallel revolute joints; the platform moves along z."""

    ground = gt.part(Ground)
    foot = gt.parts(2, Fixed, d=[[0.0, -0.5, 0.0], [-0.5, 0.0, 0.0]], R=[np.eye(3), rotation_about(Z, -np.pi / 2)])
    lower = gt.parts(2, Revolute, axis=gt.each(X))
    middle = gt.parts(2, Revolute, axis=gt.each(X))
    upper = gt.parts(2, Revolute, axis=gt.each(X))
    shin = gt.parts(2, FixedTranslation, d=gt.each([0.0, -0.3, 0.4]))
    thigh = gt.parts(2, FixedTranslation, d=gt.each([0.0, 0.3, 0.4]))
    head = gt.parts(2, Fixed, d=[[0.0, 0.5, 0.0], [0.0, 0.5, 0.0]], R=[np.eye(3), rotation_about(Z, np.pi / 2)])
    platform = gt.part(RigidBody, m=1.0, I=np.eye(3))

    def equations(self):
        for k in range(2):
            yield gt.connect([self.ground.frame, self.foot[k].b], [self.foot[k].a, self.lower[k].a])
            yield gt.connect([self.lower[k].b, self.shin[k].b], [self.shin[k].a, self.middle[k].a])
            yield gt.connect([self.middle[k].b, self.thigh[k].b], [self.thigh[k].a, self.upper[k].a])
            yield gt.connect([self.upper[k].b, self.head[k].b], [self.head[k].a, self.platform.frame])


class Watt(FourBar):
    """Watt's six-bar: a second four-bar on the first one's rocker, which is a ternary link."""

    shelf = gt.part(FixedTranslation, d=[0.4, 0.3, 0.0])
    second_base = gt.part(FixedTranslation, d=[1.6, 0.0, 0.0])
    second_coupler = gt.part(Bar, L=0.8)
    second_rocker = gt.part(Bar, L=0.7, phi={"start": 1.6})
    second_pin = gt.part(Revolute)

    def equations(self):
        yield from super().equations()
        yield gt.connect([self.rocker.link, self.shelf.b], [self.shelf.a, self.second_coupler.a])
        yield gt.connect([self.ground.frame, self.second_base.b], [self.second_base.a, self.second_rocker.a])
        yield gt.connect([self.second_coupler.b, self.second_rocker.b], [self.second_pin.a, self.second_pin.b])


class Stephenson(FourBar):
    """Stephenson's six-bar III: a dyad from the ground to a point of the coupler, a ternary link."""

    shelf = gt.part(FixedTranslation, d=[0.4, 0.3, 0.0])
    dyad_base = gt.part(FixedTranslation, d=[1.3, 0.2, 0.0])
    dyad = gt.part(Bar, L=0.6, phi={"start": 1.8})
    dyad_tip = gt.part(Bar, L=0.5, phi={"start": 1.0})
    dyad_pin = gt.part(Revolute)

    def equations(self):
        yield from super().equations()
        yield gt.connect([self.coupler.link, self.shelf.b], [self.shelf.a, self.dyad_pin.a])
        yield gt.connect([self.ground.frame, self.dyad_base.b], [self.dyad_base.a, self.dyad.a])
        yield gt.connect([self.dyad.b, self.dyad_tip.b], [self.dyad_tip.a, self.dyad_pin.b])


class FiveBar(gt.Model):
    """Planar 5R with two driven arms; its tool is the pin between the two forearms."""

    q = gt.variable(2, unit="rad", start=[2.2, 0.9], prefer=1)
    T = gt.variable(3, unit="m", start=[0.2, 0.65, 0.0])
    tau = gt.variable(2, unit="N.m")
    world = gt.part(World, g=-9.81 * Y)
    ground = gt.part(Ground)
    base = gt.parts(2, FixedTranslation, d=[[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]])
    arm = gt.parts(2, Bar, L=gt.each(0.4))
    forearm = gt.parts(2, Bar, L=gt.each(0.5))
    motor = gt.parts(2, TorqueMotor)
    pin = gt.part(Revolute)

    def equations(self):
        for k in range(2):
            yield gt.connect([self.ground.frame, self.base[k].b], [self.base[k].a, self.arm[k].a])
            yield gt.connect([self.arm[k].b, self.motor[k].shaft], [self.forearm[k].a, self.arm[k].shaft])
            yield self.q[k] == self.arm[k].phi
            yield self.tau[k] == self.motor[k].torque
        yield gt.connect([self.forearm[0].b, self.forearm[1].b], [self.pin.a, self.pin.b])
        yield self.T == self.pin.a.r


class PlanarPlatform(gt.Model):
    """Planar 3-RRR: three driven arms and three forearms on a triangular platform with pose T, angle."""

    A = gt.parameter([[0.0, 0.0, 0.0], [0.8, 0.0, 0.0], [0.4, 0.7, 0.0]], unit="m")
    B = gt.parameter([[-0.1, -0.06, 0.0], [0.1, -0.06, 0.0], [0.0, 0.12, 0.0]], unit="m")
    L = gt.parameter([0.3, 0.35], unit="m")
    q = gt.variable(3, unit="rad", start=[0.5, 2.6, -1.5], prefer=1)
    T = gt.variable(3, unit="m", start=[0.4, 0.25, 0.0])
    tau = gt.variable(3, unit="N.m")
    ground = gt.part(Ground)
    base = gt.parts(3, FixedTranslation, d=A)
    arm = gt.parts(3, Bar, L=gt.each(lambda s: s.L[0]))
    forearm = gt.parts(3, Bar, L=gt.each(lambda s: s.L[1]))
    motor = gt.parts(3, TorqueMotor)
    pin = gt.parts(3, Revolute)
    corner = gt.parts(3, FixedTranslation, d=B)
    platform = gt.part(RigidBody, m=2.0, I=0.02 * np.eye(3))

    def equations(self):
        for k in range(3):
            yield gt.connect([self.ground.frame, self.base[k].b], [self.base[k].a, self.arm[k].a])
            yield gt.connect([self.arm[k].b, self.motor[k].shaft], [self.forearm[k].a, self.arm[k].shaft])
            yield gt.connect([self.forearm[k].b, self.corner[k].b], [self.pin[k].a, self.pin[k].b])
            yield gt.connect(self.platform.frame, self.corner[k].a)
            yield self.q[k] == self.arm[k].phi
            yield self.tau[k] == self.motor[k].torque
        yield self.T == self.platform.frame.r


class BallRod(gt.Model):
    """A rod of length L between two ball joints: a free body, which may spin."""

    L = gt.parameter(0.8, unit="m")
    body = gt.part(FreeBody, m=0.1, I=SLENDER)
    lower = gt.part(Spherical)
    upper = gt.part(Spherical)
    bar = gt.part(FixedTranslation, d=lambda s: [s.L, 0.0, 0.0])
    a = gt.port(gt.mechanics.Frame)
    b = gt.port(gt.mechanics.Frame)

    def equations(self):
        yield gt.connect([self.a, self.lower.b, self.body.frame], [self.lower.a, self.body.frame, self.bar.a])
        yield gt.connect([self.bar.b, self.upper.b], [self.upper.a, self.b])


class Delta(gt.Model):
    """Delta robot: three driven arms, each with two ball-ended rods to the platform."""

    rod_class = BallRod
    T = gt.variable(3, unit="m", start=[0.0, 0.0, -0.7])
    q = gt.variable(3, unit="rad", start=[0.3, 0.3, 0.3], prefer=1)
    ground = gt.part(Ground)
    turn = gt.parts(3, Fixed, R=[rotation_about(Z, 2 * np.pi / 3 * k) for k in range(3)])
    shoulder = gt.parts(3, FixedTranslation, d=gt.each([0.2, 0.0, 0.0]))
    arm = gt.parts(3, Revolute, axis=gt.each(Y))
    motor = gt.parts(3, TorqueMotor)
    elbow = gt.parts(6, FixedTranslation, d=[[0.3, y, 0.0] for y in (-0.05, 0.05)] * 3)
    rod = gt.parts(6, BallRod, L=gt.each(0.8))
    around = gt.parts(3, Fixed, R=[rotation_about(Z, 2 * np.pi / 3 * k) for k in range(3)])
    corner = gt.parts(6, FixedTranslation, d=[[0.05, y, 0.0] for y in (-0.05, 0.05)] * 3)
    platform = gt.part(FreeBody, m=1.0, I=0.01 * np.eye(3))

    def equations(self):
        for k in range(3):
            yield gt.connect([self.ground.frame, self.turn[k].b], [self.turn[k].a, self.shoulder[k].a])
            yield gt.connect([self.shoulder[k].b, self.motor[k].shaft], [self.arm[k].a, self.arm[k].shaft])
            yield gt.connect(self.platform.frame, self.around[k].a)
            yield self.q[k] == self.arm[k].shaft.phi
        for n in range(6):
            yield gt.connect([self.arm[n // 2].b, self.elbow[n].b], [self.elbow[n].a, self.rod[n].a])
            yield gt.connect([self.around[n // 2].b, self.corner[n].b], [self.corner[n].a, self.rod[n].b])
        yield self.T == self.platform.frame.r


class UPSLeg(gt.Model):
    """A leg of a Gough platform: universal joint, driven slide along z, ball joint."""

    a = gt.port(gt.mechanics.Frame)
    b = gt.port(gt.mechanics.Frame)
    foot = gt.part(Universal)
    slide = gt.part(Prismatic, v=Z)
    length = gt.variable(unit="m", start=1.0, prefer=1)
    motor = gt.part(gt.mechanics.ForceMotor)
    ball = gt.part(Spherical)

    def equations(self):
        yield gt.connect([self.a, self.foot.b, self.slide.b], [self.foot.a, self.slide.a, self.ball.a])
        yield gt.connect([self.ball.b, self.motor.flange], [self.b, self.slide.flange])
        yield self.length == self.slide.flange.s


class UPULeg(UPSLeg):
    """Universal, driven slide, universal; the axes next to the slide are square to it and parallel."""

    ball = gt.part(Universal, axis_1=Y, axis_2=X)


class UCULeg(UPSLeg):
    """Universal, driven cylindrical joint, universal."""

    slide = gt.part(Cylindrical, axis=Z)
    ball = gt.part(Universal, axis_1=Y, axis_2=X)


class SPSLeg(UPSLeg):
    """Ball, driven slide, ball: the leg may spin."""

    foot = gt.part(Spherical)
    cylinder = gt.part(FreeBody, m=0.1, I=SLENDER)

    def equations(self):
        yield from super().equations()
        yield gt.connect(self.foot.b, self.cylinder.frame)


ANGLES = np.radians([10.0, 50.0, 130.0, 170.0, 250.0, 290.0])
HEADS = np.radians([-25.0, 85.0, 95.0, 205.0, 215.0, 325.0])


def circle(radius, angles, z=0.0):
    return [[radius * np.cos(t), radius * np.sin(t), z] for t in angles]


class Gough(gt.Model):
    """Gough platform of six legs on a free platform."""

    T = gt.variable(3, unit="m", start=[0.02, 0.01, 0.95])
    ground = gt.part(Ground)
    foot = gt.parts(6, FixedTranslation, d=circle(0.6, ANGLES))
    head = gt.parts(6, FixedTranslation, d=circle(0.35, HEADS))
    leg = gt.parts(6, UPSLeg)
    platform = gt.part(FreeBody, m=5.0, I=0.1 * np.eye(3))

    def equations(self):
        for k in range(6):
            yield gt.connect([self.ground.frame, self.foot[k].b], [self.foot[k].a, self.leg[k].a])
            yield gt.connect([self.platform.frame, self.head[k].b], [self.head[k].a, self.leg[k].b])
        yield self.T == self.platform.frame.r


class GoughUCU(Gough):
    """The same with U-C-U legs."""

    leg = gt.parts(6, UCULeg)


class GoughSPS(Gough):
    """The same with S-P-S legs, which spin."""

    leg = gt.parts(6, SPSLeg)


def leg_frames(height=0.9):
    """Rotations (6, 3, 3) whose z is along each leg of a Gough platform at its start position, x horizontal."""
    ends = np.array(circle(0.35, HEADS, height)) - np.array(circle(0.6, ANGLES))
    frames = []
    for d in ends:
        z = d / np.linalg.norm(d)
        x = np.cross([0.0, 0.0, 1.0], z)
        x /= np.linalg.norm(x)
        frames.append(np.column_stack([x, np.cross(z, x), z]))
    return np.array(frames), np.linalg.norm(ends, axis=1)


FRAMES, LENGTHS = leg_frames()


class ParallelUPU(Gough):
    """U-P-U legs whose crosses are square to the legs; the axes in base and platform are parallel in every leg."""

    twist = gt.parameter(0.0, unit="rad")
    T = gt.variable(3, unit="m", start=[0.0, 0.0, 0.9])
    foot = gt.parts(6, Fixed, d=circle(0.6, ANGLES), R=FRAMES)
    head = gt.parts(6, Fixed, d=circle(0.35, HEADS), R=FRAMES)
    leg = gt.parts(
        6,
        UPULeg,
        length=[{"start": length} for length in LENGTHS],
        ball=lambda s: [{"axis_1": _across(s.twist, 1), "axis_2": _across(s.twist, 0)}] * 6,
    )


def _across(angle, k):
    c, s = gt.cos(angle), gt.sin(angle)
    return [-s, c, 0.0] if k else [c, s, 0.0]


class RigidUPU(ParallelUPU):
    """The same with the axes in the platform turned against those in the base: by its rank it has three freedoms, and
    does not move."""

    twist = gt.parameter(0.5, unit="rad")


class InLine(FourBar):
    """A four-bar all of whose pins are in line: 1.2 = 0.3 + 0.4 + 0.5."""

    lengths = gt.parameter([0.3, 0.4, 0.5, 1.2], unit="m")
    crank = gt.part(Bar, L=lambda s: s.lengths[0], phi={"start": 0.0})
    rocker = gt.part(Bar, L=lambda s: s.lengths[2], phi={"start": np.pi})


class Folded(InLine):
    """A parallelogram with all pins in line: two motions begin here."""

    lengths = gt.parameter([0.3, 0.8, 0.3, 0.8], unit="m")
    rocker = gt.part(Bar, L=lambda s: s.lengths[2], phi={"start": 0.0})


class BallFourBar(FourBar):
    """R-R-S-R: the four-bar with a ball joint between coupler and rocker."""

    pin = gt.part(Spherical)


class Spatial(gt.Model):
    """R-R-S-C: a crank about z, a coupler about a skew axis, a ball joint, and a rocker that also slides along x."""

    ground = gt.part(Ground)
    crank = gt.part(Revolute)
    radius = gt.part(FixedTranslation, d=[0.2, 0.0, 0.0])
    wrist = gt.part(Revolute, axis=[0.0, 1.0, 0.3])
    coupler = gt.part(FixedTranslation, d=[0.5, 0.1, 0.4])
    foot = gt.part(FixedTranslation, d=[0.7, 0.3, 0.0])
    rocker = gt.part(Cylindrical, axis=X)
    lever = gt.part(FixedTranslation, d=[0.0, 0.0, 0.4])
    ball = gt.part(Spherical)

    def equations(self):
        yield gt.connect([self.ground.frame, self.crank.b, self.radius.b], [self.crank.a, self.radius.a, self.wrist.a])
        yield gt.connect([self.wrist.b, self.coupler.b], [self.coupler.a, self.ball.a])
        yield gt.connect([self.ground.frame, self.foot.b, self.rocker.b], [self.foot.a, self.rocker.a, self.lever.a])
        yield gt.connect(self.lever.b, self.ball.b)


class SphericalFourBar(gt.Model):
    """Four revolute joints whose axes meet at one point."""

    axes = gt.parameter([[0.0, 0.0, 1.0], [0.5, 0.0, 1.0], [0.6, 0.7, 1.0], [-0.1, 0.6, 1.0]], unit="1")
    ground = gt.part(Ground)
    joint = gt.parts(4, Revolute, axis=axes)

    def equations(self):
        yield gt.connect([self.ground.frame, self.joint[0].b], [self.joint[0].a, self.joint[1].a])
        yield gt.connect([self.joint[1].b, self.joint[2].b], [self.joint[2].a, self.joint[3].a])
        yield gt.connect(self.joint[3].b, self.ground.frame)


class Piston(gt.Model):
    """A hydraulic cylinder between two pins about y: revolute joints at its ends and a driven slide along x."""

    a = gt.port(gt.mechanics.Frame)
    b = gt.port(gt.mechanics.Frame)
    length = gt.variable(unit="m", start=1.0, prefer=1)
    foot = gt.part(Revolute, axis=Y)
    slide = gt.part(Prismatic)
    head = gt.part(Revolute, axis=Y)
    motor = gt.part(gt.mechanics.ForceMotor)

    def equations(self):
        yield gt.connect([self.a, self.foot.b, self.slide.b], [self.foot.a, self.slide.a, self.head.a])
        yield gt.connect([self.head.b, self.motor.flange], [self.b, self.slide.flange])
        yield self.length == self.slide.flange.s


class Loader(gt.Model):
    """A wheel loader's Z-bar linkage: boom, rocker, link and bucket, moved by a lift and a tilt cylinder."""

    ground = gt.part(Ground)
    names = ("boom", "rocker", "link", "bucket", "last")
    boom, rocker, bucket, link, last = (gt.part(Revolute, axis=Y) for _ in range(5))
    foot, lift_foot, tilt_foot = (
        gt.part(FixedTranslation, d=d) for d in ([0.0, 0.0, 2.0], [0.3, 0.0, 1.0], [0.2, 0.0, 2.6])
    )
    lift_eye, pivot, tip = (gt.part(FixedTranslation, d=d) for d in ([1.2, 0.0, 0.0], [1.5, 0.0, 0.3], [2.5, 0.0, 0.0]))
    upper, lower = (gt.part(FixedTranslation, d=d) for d in ([0.1, 0.0, 0.6], [0.0, 0.0, -0.6]))
    bar = gt.part(FixedTranslation, d=[0.7, 0.0, 0.1])
    ear = gt.part(FixedTranslation, d=[-0.1, 0.0, 0.4])
    lift, tilt = gt.part(Piston), gt.part(Piston, length={"start": 1.4})

    def equations(self):
        ground, boom, rocker = self.ground.frame, self.boom, self.rocker
        yield gt.connect(
            [ground, self.foot.b, ground, ground], [self.foot.a, boom.a, self.lift_foot.a, self.tilt_foot.a]
        )
        yield gt.connect([boom.b, boom.b, boom.b], [self.lift_eye.a, self.pivot.a, self.tip.a])
        yield gt.connect([self.lift_foot.b, self.lift_eye.b], [self.lift.a, self.lift.b])
        yield gt.connect([self.pivot.b, rocker.b, rocker.b], [rocker.a, self.upper.a, self.lower.a])
        yield gt.connect([self.tilt_foot.b, self.upper.b], [self.tilt.a, self.tilt.b])
        yield gt.connect([self.tip.b, self.bucket.b], [self.bucket.a, self.ear.a])
        yield gt.connect(
            [self.lower.b, self.link.b, self.bar.b, self.ear.b], [self.link.a, self.bar.a, self.last.a, self.last.b]
        )
