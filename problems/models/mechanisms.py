"""Two parallel robots of joints and rods, drawn by connecting: a rotary delta robot and a planar 3-RRR.

The dimensions are an example of ours. `gtmodel explain problems/models/mechanisms.py:Delta --mobility` counts their
degrees of freedom.
"""

import numpy as np

import gtmodel as gt
from gtmodel.geometry.rotations import rotation_about
from gtmodel.mechanics import (
    Fixed,
    FixedTranslation,
    Ground,
    Planar,
    PointMass,
    PointOnFrame,
    Revolute,
    RigidBody,
    TorqueMotor,
    UniformRod,
)

TURNS = np.array([rotation_about(np.array([0.0, 0.0, 1.0]), 2 * np.pi / 3 * k) for k in range(3)])


def left_of(along, arm):
    return along[0] * arm[1] - along[1] * arm[0]


class Delta(gt.Model):
    """Delta robot: motor angles q [rad], positive down, and the tool centre point T [m].

    The platform stays parallel, so one rod stands for each parallelogram, and its length leads from the elbow to the
    tool centre point. Branch `below`: the tool is below the elbows.
    """

    T = gt.variable(3, unit="m", start=[0.0, 0.0, -0.7])
    q = gt.variable(3, unit="rad", start=[0.3, 0.3, 0.3], prefer=1)
    tau = gt.variable(3, unit="N.m")
    ground = gt.part(Ground)
    base = gt.parts(3, Fixed, d=TURNS @ [0.15, 0.0, 0.0], R=TURNS)
    arm = gt.parts(3, Revolute, axis=gt.each([0.0, 1.0, 0.0]))
    motor = gt.parts(3, TorqueMotor)
    elbow = gt.parts(3, PointOnFrame, d=gt.each([0.3, 0.0, 0.0]))
    rod = gt.parts(3, UniformRod, L=gt.each(0.8), m=gt.each(0.1))
    tool = gt.part(PointMass, m=1.0)

    def equations(self):
        for k in range(3):
            yield gt.connect([self.ground.frame, self.base[k].b], [self.base[k].a, self.arm[k].a])
            yield gt.connect([self.arm[k].b, self.arm[k].shaft], [self.elbow[k].frame, self.motor[k].shaft])
            yield gt.connect([self.elbow[k].point, self.rod[k].b], [self.rod[k].a, self.tool.frame])
            yield self.q[k] == self.arm[k].shaft.phi
            yield self.tau[k] == self.motor[k].torque
        yield self.T == self.tool.frame.r
        yield gt.branch("below", self.elbow[0].point.r[2] - self.T[2])


class ThreeArms(gt.Model):
    """Planar 3-RRR: motor angles q [rad], origin x [m] and angle [rad] of the platform.

    The forearms are rods between ball joints, so no constraint is redundant. Branches `elbow_0` to `elbow_2`: the elbow
    is on the left of the line from its base to the platform. All eight selections are inverse solutions.
    """

    A = gt.parameter([[0.0, 0.0, 0.0], [0.8, 0.0, 0.0], [0.4, 0.7, 0.0]], unit="m")
    B = gt.parameter([[-0.1, -0.06, 0.0], [0.1, -0.06, 0.0], [0.0, 0.12, 0.0]], unit="m")
    x = gt.variable(3, unit="m", start=[0.4, 0.25, 0.0])
    angle = gt.variable(unit="rad", start=0.1)
    q = gt.variable(3, unit="rad", start=[1.6466, -2.6253, -0.4343], prefer=1)
    ground = gt.part(Ground)
    table = gt.part(Planar)
    base = gt.parts(3, FixedTranslation, d=A)
    arm = gt.parts(3, Revolute)
    motor = gt.parts(3, TorqueMotor)
    elbow = gt.parts(3, PointOnFrame, d=gt.each([0.3, 0.0, 0.0]))
    rod = gt.parts(3, UniformRod, L=gt.each(0.35), m=gt.each(0.1))
    corner = gt.parts(3, PointOnFrame, d=B)
    platform = gt.part(RigidBody, m=2.0, I=0.02 * np.eye(3))

    def equations(self):
        yield gt.connect([self.ground.frame, self.table.b], [self.table.a, self.platform.frame])
        yield self.x == self.platform.frame.r
        yield self.angle == self.table.shaft.phi
        for k, (base, arm, elbow, corner) in enumerate(zip(self.base, self.arm, self.elbow, self.corner, strict=True)):
            yield gt.connect([self.ground.frame, base.b, arm.b], [base.a, arm.a, elbow.frame])
            yield gt.connect([self.platform.frame, arm.shaft], [corner.frame, self.motor[k].shaft])
            yield gt.connect([elbow.point, corner.point], [self.rod[k].a, self.rod[k].b])
            yield self.q[k] == arm.shaft.phi
            yield gt.branch(f"elbow_{k}", left_of(corner.point.r - base.b.r, elbow.point.r - base.b.r))
