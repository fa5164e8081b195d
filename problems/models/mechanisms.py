"""Three parallel robots of joints and rods, drawn by connecting: a rotary delta, a planar 3-RRR and a five-bar (5R).

The dimensions are an example of ours. `gtmodel explain problems/models/mechanisms.py:Delta --mobility` counts their
degrees of freedom. Motor angles q are read by encoders; the angle of an arm is q + zero.
"""

import numpy as np

import gtmodel as gt
from gtmodel.geometry.rotations import rotation_about
from gtmodel.mechanics import (
    Fixed,
    FixedTranslation,
    Ground,
    Planar,
    Plane,
    PointMass,
    PointOnFrame,
    Revolute,
    RigidBody,
    TorqueMotor,
    UniformRod,
    World,
)

TURNS = np.array([rotation_about(np.array([0.0, 0.0, 1.0]), 2 * np.pi / 3 * k) for k in range(3)])


def left_of(along, arm):
    return along[0] * arm[1] - along[1] * arm[0]


def _polar(length, angle, plane="xy"):
    c, s = length * gt.cos(angle), length * gt.sin(angle)
    return [c, s, 0.0] if plane == "xy" else [c, 0.0, s]


class Delta(gt.Model):
    """Delta robot: motor angles q [rad], positive down, and the tool centre point T [m].

    The platform stays parallel, so one rod stands for each parallelogram, and its length leads from the elbow to the
    tool centre point. Branch `below`: the tool is below the elbows; branches `knee_0` to `knee_2`: the elbow is outside
    the line from its shoulder to the tool.
    """

    radius = gt.parameter([0.15] * 3, unit="m", positive=True, description="shoulders, less the joints of the platform")
    upper = gt.parameter([0.3] * 3, unit="m", positive=True, description="lengths of the arms")
    lower = gt.parameter([0.8] * 3, unit="m", positive=True, description="lengths of the rods")
    zero = gt.parameter([0.0] * 3, unit="rad", description="angles of the arms at q = 0")
    T = gt.variable(3, unit="m", start=[0.0, 0.0, -0.757])
    q = gt.variable(3, unit="rad", start=[0.291, 0.291, 0.291], prefer=2)
    tau = gt.input(3, unit="N.m")
    world = gt.part(World)
    ground = gt.part(Ground)
    base = gt.parts(3, Fixed, d=lambda s: [list(s.radius[k] * TURNS[k, :, 0]) for k in range(3)], R=TURNS)
    arm = gt.parts(3, Revolute, axis=gt.each([0.0, 1.0, 0.0]))
    motor = gt.parts(3, TorqueMotor)
    elbow = gt.parts(3, PointOnFrame, d=lambda s: [_polar(s.upper[k], -s.zero[k], "xz") for k in range(3)])
    rod = gt.parts(3, UniformRod, L=lower, m=gt.each(0.1))
    tool = gt.part(PointMass, m=1.0)

    def equations(self):
        for k in range(3):
            yield gt.connect([self.ground.frame, self.base[k].b], [self.base[k].a, self.arm[k].a])
            yield gt.connect([self.arm[k].b, self.arm[k].shaft], [self.elbow[k].frame, self.motor[k].shaft])
            yield gt.connect([self.elbow[k].point, self.rod[k].b], [self.rod[k].a, self.tool.frame])
            yield self.q[k] == self.arm[k].shaft.phi
            yield self.tau[k] == self.motor[k].torque
            shoulder, out = self.base[k].b.r, TURNS[k, :, 0]
            tool, elbow = self.T - shoulder, self.elbow[k].point.r - shoulder
            yield gt.branch(f"knee_{k}", gt.dot(out, tool) * elbow[2] - tool[2] * gt.dot(out, elbow))
        yield self.T == self.tool.frame.r
        yield gt.branch("below", self.elbow[0].point.r[2] - self.T[2])


class ThreeArms(gt.Model):
    """Planar 3-RRR: motor angles q [rad], origin x [m] and angle [rad] of the platform; the plane is horizontal.

    The forearms are rods between ball joints, so no constraint is redundant. Branches `elbow_0` to `elbow_2`: the elbow
    is on the left of the line from its base to the platform. All eight selections are inverse solutions in closed form.
    """

    A = gt.parameter([[0.0, 0.0], [0.8, 0.0], [0.4, 0.7]], unit="m", description="motors")
    B = gt.parameter([[-0.1, -0.06], [0.1, -0.06], [0.0, 0.12]], unit="m", description="corners of the platform")
    upper = gt.parameter([0.3] * 3, unit="m", positive=True, description="lengths of the arms")
    lower = gt.parameter([0.35] * 3, unit="m", positive=True, description="lengths of the rods")
    zero = gt.parameter([0.0] * 3, unit="rad", description="angles of the arms at q = 0")
    x = gt.variable(2, unit="m", start=[0.4, 0.25])
    angle = gt.variable(unit="rad", start=0.1)
    q = gt.variable(3, unit="rad", start=[1.6466, -2.6253, -0.4343], prefer=2)
    tau = gt.input(3, unit="N.m")
    ground = gt.part(Ground)
    table = gt.part(Planar)
    base = gt.parts(3, FixedTranslation, d=lambda s: [[s.A[k, 0], s.A[k, 1], 0.0] for k in range(3)])
    arm = gt.parts(3, Revolute)
    motor = gt.parts(3, TorqueMotor)
    elbow = gt.parts(3, PointOnFrame, d=lambda s: [_polar(s.upper[k], s.zero[k]) for k in range(3)])
    rod = gt.parts(3, UniformRod, L=lower, m=gt.each(0.1))
    corner = gt.parts(3, PointOnFrame, d=lambda s: [[s.B[k, 0], s.B[k, 1], 0.0] for k in range(3)])
    platform = gt.part(RigidBody, m=2.0, I=0.02 * np.eye(3))

    def equations(self):
        yield gt.connect([self.ground.frame, self.table.b], [self.table.a, self.platform.frame])
        yield self.x[0] == self.table.flange_1.s
        yield self.x[1] == self.table.flange_2.s
        yield self.angle == self.table.shaft.phi
        for k, (base, arm, elbow, corner) in enumerate(zip(self.base, self.arm, self.elbow, self.corner, strict=True)):
            yield gt.connect([self.ground.frame, base.b, arm.b], [base.a, arm.a, elbow.frame])
            yield gt.connect([self.platform.frame, arm.shaft], [corner.frame, self.motor[k].shaft])
            yield gt.connect([elbow.point, corner.point], [self.rod[k].a, self.rod[k].b])
            yield self.q[k] == arm.shaft.phi
            yield self.tau[k] == self.motor[k].torque
            yield gt.branch(f"elbow_{k}", left_of(corner.point.r - base.b.r, elbow.point.r - base.b.r))


class FiveBar(gt.Model):
    """Planar five-bar (5R): motor angles q [rad] and the tool centre point x [m] between the forearms.

    Gravity is along -y. The forearms are rods between ball joints. Branches: `above`, the tool above the line of the
    elbows, and `knee_0`, `knee_1`, the elbow outside the line from its motor to the tool.
    """

    A = gt.parameter([[0.0, 0.0], [0.4, 0.0]], unit="m", description="motors")
    upper = gt.parameter([0.4] * 2, unit="m", positive=True, description="lengths of the arms")
    lower = gt.parameter([0.5] * 2, unit="m", positive=True, description="lengths of the rods")
    zero = gt.parameter([0.0] * 2, unit="rad", description="angles of the arms at q = 0")
    x = gt.variable(2, unit="m", start=[0.2, 0.704])
    q = gt.variable(2, unit="rad", start=[2.0, 1.1416], prefer=2)
    tau = gt.input(2, unit="N.m")
    world = gt.part(World, g=[0.0, -9.81, 0.0])
    ground = gt.part(Ground)
    base = gt.parts(2, FixedTranslation, d=lambda s: [[s.A[k, 0], s.A[k, 1], 0.0] for k in range(2)])
    arm = gt.parts(2, Revolute)
    motor = gt.parts(2, TorqueMotor)
    elbow = gt.parts(2, PointOnFrame, d=lambda s: [_polar(s.upper[k], s.zero[k]) for k in range(2)])
    rod = gt.parts(2, UniformRod, L=lower, m=gt.each(0.3))
    tool = gt.part(PointMass, m=1.0)
    plane = gt.part(Plane)

    def equations(self):
        for k in range(2):
            yield gt.connect([self.ground.frame, self.base[k].b], [self.base[k].a, self.arm[k].a])
            yield gt.connect([self.arm[k].b, self.arm[k].shaft], [self.elbow[k].frame, self.motor[k].shaft])
            yield gt.connect([self.elbow[k].point, self.rod[k].b], [self.rod[k].a, self.tool.frame])
            yield self.q[k] == self.arm[k].shaft.phi
            yield self.tau[k] == self.motor[k].torque
            tool, elbow = self.tool.frame.r - self.base[k].b.r, self.elbow[k].point.r - self.base[k].b.r
            yield gt.branch(f"knee_{k}", left_of(tool, elbow) if k == 0 else left_of(elbow, tool))
        yield gt.connect(self.plane.frame, self.tool.frame)
        yield self.x == self.tool.frame.r[:2]
        first, second = self.elbow[0].point.r, self.elbow[1].point.r
        yield gt.branch("above", left_of(second - first, self.tool.frame.r - first))
