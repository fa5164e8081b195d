"""Serial arms from parts, and the same arms in pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

import gtmodel as gt
from gtmodel.mechanics import Fixed, Frame, Ground, Revolute, RigidBody, TorqueMotor

Array = np.ndarray


class RevoluteLink(gt.Model):
    """Placement of the joint on the link before, a driven revolute joint, and the body that it turns."""

    d = gt.parameter(shape=3, unit="m")
    R = gt.parameter(shape=(3, 3), unit="1")
    axis = gt.parameter(shape=3, unit="1")
    before = gt.port(Frame)
    after = gt.port(Frame)
    placement = gt.part(Fixed, d=d, R=R)
    joint = gt.part(Revolute, axis=axis)
    body = gt.part(RigidBody)
    motor = gt.part(TorqueMotor)

    def equations(self):
        yield gt.connect(self.before, self.placement.a)
        yield gt.connect(self.placement.b, self.joint.a)
        yield gt.connect(self.joint.b, self.body.frame)
        yield gt.connect(self.joint.b, self.after)
        yield gt.connect(self.joint.shaft, self.motor.shaft)


@dataclass(frozen=True)
class ArmData:
    """Numbers of an arm, one row (or matrix) per link."""

    d: Array
    R: Array
    axis: Array
    m: Array
    c: Array
    I: Array
    J: Array
    ratio: Array

    def model(self) -> gt.Model:
        n = len(self.d)
        links = [
            dict(
                d=self.d[k],
                R=self.R[k],
                axis=self.axis[k],
                body=dict(m=self.m[k], c=self.c[k], I=self.I[k]),
                motor=dict(J=self.J[k], ratio=self.ratio[k]),
            )
            for k in range(n)
        ]
        return arm_class(n)(link=links)

    def pinocchio(self):
        """The same arm; rotor inertias as pinocchio's armature."""
        import pinocchio as pin

        model = pin.Model()
        parent = 0
        for k in range(len(self.d)):
            joint = pin.JointModelRevoluteUnaligned(*(self.axis[k] / np.linalg.norm(self.axis[k])))
            parent = model.addJoint(parent, joint, pin.SE3(self.R[k], self.d[k]), f"joint_{k}")
            model.appendBodyToJoint(parent, pin.Inertia(self.m[k], self.c[k], self.I[k]), pin.SE3.Identity())
        model.armature = self.J * self.ratio**2
        return model


@cache
def arm_class(n: int) -> type[gt.Model]:
    """A serial arm of n revolute joints: angles q, torques tau at the joints (motor torque times ratio), tip T."""

    class SerialArm(gt.Model):
        q = gt.variable(n, unit="rad", start=np.zeros(n), prefer=1)
        tau = gt.input(n, unit="N.m", nominal=100.0)
        T = gt.variable(3, unit="m")
        ground = gt.part(Ground)
        link = gt.parts(n, RevoluteLink)

        def equations(self):
            before = self.ground.frame
            for k, link in enumerate(self.link):
                yield gt.connect(before, link.before)
                yield self.q[k] == link.joint.shaft.phi
                yield self.tau[k] == link.motor.ratio * link.motor.torque
                before = link.after
            yield before.r == self.T

    return SerialArm


def random_arm(n: int, seed: int) -> ArmData:
    """Axes, placements and inertias of no particular kind."""
    rng = np.random.default_rng(seed)
    turn = np.array([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(n)])
    turn *= np.sign(np.linalg.det(turn))[:, None, None]
    root = rng.normal(size=(n, 3, 3)) * 0.2
    return ArmData(
        d=rng.uniform(-0.5, 0.5, (n, 3)),
        R=turn,
        axis=rng.normal(size=(n, 3)),
        m=rng.uniform(1.0, 5.0, n),
        c=rng.uniform(-0.2, 0.2, (n, 3)),
        I=root @ root.transpose(0, 2, 1) + 0.01 * np.eye(3),
        J=np.zeros(n),
        ratio=np.ones(n),
    )


def industrial_arm() -> ArmData:
    """A 6R arm with a spherical wrist, sized like a medium industrial robot; all numbers are ours."""
    z, y, x = np.eye(3)[2], np.eye(3)[1], np.eye(3)[0]
    return ArmData(
        d=np.array([[0, 0, 0.4], [0.18, 0, 0.3], [0, 0, 0.7], [0.3, 0, 0.1], [0.35, 0, 0], [0.1, 0, 0]], dtype=float),
        R=np.tile(np.eye(3), (6, 1, 1)),
        axis=np.array([z, y, y, x, y, x]),
        m=np.array([60.0, 45.0, 30.0, 12.0, 6.0, 1.5]),
        c=np.array([[0.1, 0, 0.1], [0, 0.05, 0.3], [0.1, 0, 0.08], [0.15, 0, 0], [0.03, 0, 0.01], [0.02, 0.0, 0]]),
        I=np.array([np.diag(d) for d in ([2, 2, 1.5], [3, 3, 0.4], [1, 1, 0.8], [0.1, 0.3, 0.3], [0.02, 0.03, 0.03],
                                         [0.002, 0.002, 0.003])]),
        J=np.array([3e-3, 3e-3, 2e-3, 5e-4, 5e-4, 3e-4]),
        ratio=np.array([120.0, -150.0, 130.0, 60.0, 70.0, -50.0]),
    )  # fmt: skip
