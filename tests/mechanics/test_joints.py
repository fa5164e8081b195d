"""Prismatic and universal joints and the wrist against pinocchio; the transmission scale of a slide."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status
from gtmodel.mechanics import (
    FixedTranslation,
    ForceMotor,
    FrameLoad,
    Ground,
    Prismatic,
    Revolute,
    RigidBody,
    TorqueMotor,
    Universal,
    Wrist,
)
from tests.mechanics.balance import power_balance
from tests.support.compare import relative_error
from tests.support.residuals import original_residuals

pin = pytest.importorskip("pinocchio", reason="pinocchio, the oracle of joints, is not installed")

# Two recursions of some hundred operations on numbers of order 1 to 1e2.
ROUND_OFF = 1e-12
RESIDUAL = 1e-10

RNG = np.random.default_rng(0)
STATES = [(RNG.uniform(-1, 1, 3), RNG.normal(size=3), RNG.normal(size=3)) for _ in range(10)]
M, C, I = 2.0, np.array([0.1, 0.02, -0.05]), np.diag([0.03, 0.05, 0.04])
V = np.array([0.6, -0.3, 0.2])  # direction and scale of the slide
AXIS = np.array([0.2, -1.0, 0.4])


class PolarArm(gt.Model):
    """A revolute axis about z, a slide along V, a revolute axis along AXIS; a body on each of the last two."""

    q = gt.variable(3, unit=None, start=np.zeros(3), prefer=1)
    tau = gt.input(3, unit=None)
    ground = gt.part(Ground)
    swivel = gt.part(Revolute)
    slide = gt.part(Prismatic, v=V)
    tilt = gt.part(Revolute, axis=AXIS)
    slider = gt.part(RigidBody, m=M, c=C, I=I)
    hand = gt.part(RigidBody, m=M, c=C, I=I)
    motors = gt.parts(2, TorqueMotor)
    pusher = gt.part(ForceMotor)

    def equations(self):
        yield gt.connect(self.ground.frame, self.swivel.a)
        yield gt.connect(self.swivel.b, self.slide.a)
        yield gt.connect(self.slide.b, self.tilt.a)
        yield gt.connect(self.slide.b, self.slider.frame)
        yield gt.connect(self.tilt.b, self.hand.frame)
        yield gt.connect(self.motors[0].shaft, self.swivel.shaft)
        yield gt.connect(self.motors[1].shaft, self.tilt.shaft)
        yield gt.connect(self.pusher.flange, self.slide.flange)
        yield self.q[0] == self.swivel.shaft.phi
        yield self.q[1] == self.slide.flange.s
        yield self.q[2] == self.tilt.shaft.phi
        yield self.tau[0] == self.motors[0].torque
        yield self.tau[1] == self.pusher.force
        yield self.tau[2] == self.motors[1].torque


def body():
    return pin.Inertia(M, C, I)


def test_slide_with_scale():
    oracle = pin.Model()
    scale = np.linalg.norm(V)
    j1 = oracle.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "swivel")
    j2 = oracle.addJoint(j1, pin.JointModelPrismaticUnaligned(*(V / scale)), pin.SE3.Identity(), "slide")
    axis = AXIS / np.linalg.norm(AXIS)
    j3 = oracle.addJoint(j2, pin.JointModelRevoluteUnaligned(*axis), pin.SE3.Identity(), "tilt")
    oracle.appendBodyToJoint(j2, body(), pin.SE3.Identity())
    oracle.appendBodyToJoint(j3, body(), pin.SE3.Identity())
    work = oracle.createData()
    model = PolarArm()
    inverse, forward = model.causal("q", "tau"), model.causal("tau", "der(q,2)")
    unit = np.array([1.0, scale, 1.0])  # pinocchio's slide travels scale * q, and its force does scale times the work
    for q, qd, qdd in STATES:
        tau, status = inverse(q, qd, qdd)
        assert status == Status.OK
        expected = unit * pin.rnea(oracle, work, unit * q, unit * qd, unit * qdd)
        assert relative_error(tau, expected) < ROUND_OFF
        back, status = forward(q, qd, tau)
        assert status == Status.OK
        assert relative_error(back, qdd) < 100 * ROUND_OFF  # one linear solve
    values = {"q": STATES[0][0], "der(q)": STATES[0][1], "tau": STATES[0][2]}
    assert np.max(np.abs(original_residuals(model, values, "tau"))) < RESIDUAL
    assert power_balance(model, values, "tau") < ROUND_OFF


class UniversalPendulum(gt.Model):
    """A body hanging on a universal joint with motors on both shafts."""

    q = gt.variable(2, unit="rad", start=np.zeros(2), prefer=1)
    tau = gt.input(2, unit="N.m")
    ground = gt.part(Ground)
    joint = gt.part(Universal)
    body = gt.part(RigidBody, m=M, c=C, I=I)
    motors = gt.parts(2, TorqueMotor)

    def equations(self):
        yield gt.connect(self.ground.frame, self.joint.a)
        yield gt.connect(self.joint.b, self.body.frame)
        shafts = [self.joint.shaft_1, self.joint.shaft_2]
        yield gt.connect([m.shaft for m in self.motors], shafts)
        for i in range(2):
            yield self.q[i] == shafts[i].phi
            yield self.tau[i] == self.motors[i].torque


def test_universal_joint():
    oracle = pin.Model()
    j1 = oracle.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "x")
    j2 = oracle.addJoint(j1, pin.JointModelRY(), pin.SE3.Identity(), "y")
    oracle.appendBodyToJoint(j2, body(), pin.SE3.Identity())
    work = oracle.createData()
    model = UniversalPendulum()
    inverse, forward = model.causal("q", "tau"), model.causal("tau", "der(q,2)")
    for state in STATES:
        q, qd, qdd = (x[:2] for x in state)
        tau, status = inverse(q, qd, qdd)
        assert status == Status.OK
        assert relative_error(tau, pin.rnea(oracle, work, q, qd, qdd)) < ROUND_OFF
        back, status = forward(q, qd, tau)
        assert status == Status.OK
        assert relative_error(back, qdd) < 100 * ROUND_OFF  # one linear solve


class HangingWrist(gt.Model):
    """The wrist on the world, a load at its tool."""

    q = gt.variable(2, unit="rad", start=np.zeros(2), prefer=1)
    tau = gt.input(2, unit="N.m")
    force = gt.input(3, unit="N")
    ground = gt.part(Ground)
    mount = gt.part(FixedTranslation, d=[0.3, 0.0, 1.0])
    wrist = gt.part(Wrist)
    load = gt.part(FrameLoad)

    def equations(self):
        yield gt.connect(self.ground.frame, self.mount.a)
        yield gt.connect(self.mount.b, self.wrist.mount)
        yield gt.connect(self.wrist.tool, self.load.frame)
        yield self.q == self.wrist.q
        yield self.tau == self.wrist.tau
        yield self.force == self.load.force
        yield self.load.torque == np.zeros(3)


def test_wrist_under_load():
    model = HangingWrist()
    w = Wrist()
    d, m, c, J = (np.array(getattr(w, k)) for k in ("d", "m", "c", "J"))
    oracle = pin.Model()
    j1 = oracle.addJoint(0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([0.3, 0.0, 1.0])), "first")
    j2 = oracle.addJoint(j1, pin.JointModelRY(), pin.SE3(np.eye(3), d[0]), "second")
    for k, j in enumerate((j1, j2)):
        oracle.appendBodyToJoint(j, pin.Inertia(m[k], c[k], np.diag(J[k])), pin.SE3.Identity())
    tool = oracle.addFrame(pin.Frame("tool", j2, 0, pin.SE3(np.eye(3), d[1]), pin.FrameType.OP_FRAME))
    work = oracle.createData()
    f = model.causal(["q", "force"], ["tau", "wrist.tool.r"])
    for state in STATES:
        q, qd, qdd = (x[:2] for x in state)
        force = 50 * state[0]
        tau, r, status = f(q, qd, qdd, force)
        assert status == Status.OK
        expected = pin.rnea(oracle, work, q, qd, qdd)
        pin.framesForwardKinematics(oracle, work, q)
        jacobian = pin.computeFrameJacobian(oracle, work, q, tool, pin.LOCAL_WORLD_ALIGNED)
        assert relative_error(r, work.oMf[tool].translation) < ROUND_OFF
        assert relative_error(tau, expected - jacobian[:3].T @ force) < ROUND_OFF
