"""Loops closed by connecting: motion and dynamics by hand and by pinocchio, whichever joint is cut."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.causal import flat_of
from tests.support import mechanisms
from tests.support.mechanisms import dropped

pin = pytest.importorskip("pinocchio")
# the loop is solved to 1e-12, and forces are of order 10
TOLERANCE = 1e-9
RNG = np.random.default_rng(11)


def circles(A, a, B, b, side):
    """The intersection of two circles in the plane, on the left (side 1) of the line from A to B."""
    d = np.linalg.norm(B - A)
    along = (d**2 + a**2 - b**2) / (2 * d)
    e = (B - A) / d
    return A + along * e + side * np.sqrt(a**2 - along**2) * np.array([-e[1], e[0]])


class Chains:
    """Two planar chains of uniform bars, each bar a revolute joint about z; the tips of the chains coincide."""

    def __init__(self, feet, lengths):
        self.model, self.tips = pin.Model(), []
        self.model.gravity.linear = np.array([0.0, -9.81, 0.0])
        for foot, bars in zip(feet, lengths, strict=True):
            parent, at = 0, np.array([*foot, 0.0])
            for L in bars:
                parent = self.model.addJoint(
                    parent, pin.JointModelRZ(), pin.SE3(np.eye(3), at), f"j{self.model.njoints}"
                )
                inertia = np.diag([0.0, L**2 / 12, L**2 / 12])
                self.model.appendBodyToJoint(
                    parent, pin.Inertia(1.0, np.array([L / 2, 0, 0]), inertia), pin.SE3.Identity()
                )
                at = np.array([L, 0.0, 0.0])
            frame = pin.Frame(f"tip{parent}", parent, 0, pin.SE3(np.eye(3), at), pin.FrameType.OP_FRAME)
            self.tips.append(self.model.addFrame(frame))
        self.data = self.model.createData()

    def torques(self, x, driven, rate, acceleration):
        """Motor torques of the driven joints for their rates and accelerations, at joint angles x of a closed pose."""
        model, data, n = self.model, self.data, self.model.nv
        free = [k for k in range(n) if k not in driven]
        pin.computeJointJacobians(model, data, x)
        pin.updateFramePlacements(model, data)
        a, b = self.tips
        assert np.max(np.abs(data.oMf[a].translation - data.oMf[b].translation)) < 1e-12
        frame = pin.LOCAL_WORLD_ALIGNED
        J = (pin.getFrameJacobian(model, data, a, frame) - pin.getFrameJacobian(model, data, b, frame))[:2]
        v, dv = np.zeros(n), np.zeros(n)
        v[driven], dv[driven] = rate, acceleration
        v[free] = np.linalg.solve(J[:, free], -J[:, driven] @ rate)
        pin.forwardKinematics(model, data, x, v, np.zeros(n))
        drift = (
            pin.getFrameClassicalAcceleration(model, data, a, frame)
            - pin.getFrameClassicalAcceleration(model, data, b, frame)
        ).linear[:2]
        dv[free] = np.linalg.solve(J[:, free], -drift - J[:, driven] @ acceleration)
        force = pin.rnea(model, data, x, v, dv)
        pull = np.linalg.solve(J[:, free].T, force[free])  # only the loop's force acts on the passive joints
        return force[driven] - J[:, driven].T @ pull


def angle(a, b):
    return float(np.arctan2(b[1] - a[1], b[0] - a[0]))


@cache
def four_bar(*cut):
    return dropped(mechanisms.FourBar, *cut)


@pytest.mark.parametrize("cut", [(), ("coupler",), ("rocker",), ("pin",)])
def test_four_bar_of_four_revolute_joints(cut):
    model = four_bar(*cut)
    follow = model.causal(known="crank.phi", targets=["rocker.phi", "pin.a.r"])
    drive = model.causal(known="crank.phi", targets="motor.torque")
    chains = Chains([(0.0, 0.0), (0.8, 0.0)], [(0.3, 0.7), (0.6,)])
    for phi in (0.3, 0.7, 1.3, 2.0):
        A = 0.3 * np.array([np.cos(phi), np.sin(phi)])
        C = circles(A, 0.7, np.array([0.8, 0.0]), 0.6, 1)
        psi, found, status = follow(phi)
        assert status == gt.Status.OK
        assert np.allclose([*found[:2], psi], [*C, angle((0.8, 0.0), C)], atol=TOLERANCE)
        rate, acceleration = RNG.uniform(-2, 2, 2)
        torque, status = drive(phi, rate, acceleration)
        assert status == gt.Status.OK
        x = np.array([phi, angle(A, C) - phi, angle((0.8, 0.0), C)])
        assert abs(torque - chains.torques(x, [0], [rate], [acceleration])[0]) < TOLERANCE


def test_five_bar():
    model = dropped(mechanisms.FiveBar)
    forward, drive = model.causal(known="q", targets="T"), model.causal(known="q", targets="tau")
    chains = Chains([(0.0, 0.0), (0.4, 0.0)], [(0.4, 0.5), (0.4, 0.5)])
    for q in ([2.2, 0.9], [2.0, 1.2], [2.1, 0.8]):
        elbows = np.array([[0.4 * k + 0.4 * np.cos(a), 0.4 * np.sin(a)] for k, a in enumerate(q)])
        C = circles(elbows[0], 0.5, elbows[1], 0.5, 1)
        T, status = forward(q)
        assert status == gt.Status.OK
        assert np.allclose(T, [*C, 0.0], atol=TOLERANCE)
        rate, acceleration = RNG.uniform(-2, 2, (2, 2))
        tau, status = drive(q, rate, acceleration)
        assert status == gt.Status.OK
        x = np.array([q[0], angle(elbows[0], C) - q[0], q[1], angle(elbows[1], C) - q[1]])
        assert np.allclose(tau, chains.torques(x, [0, 2], rate, acceleration), atol=TOLERANCE)


def test_bennett_moves_as_its_closed_form_says():
    class Driven(mechanisms.Bennett):
        motor = gt.part(gt.mechanics.TorqueMotor)

        def equations(self):
            yield from super().equations()
            yield gt.connect(self.motor.shaft, self.joint[0].shaft)
            yield gt.loops(redundant="drop")

    f = Driven().causal(known="motor.shaft.phi", targets="theta")
    alpha, beta = np.radians([35.0, 70.0])
    for first in (0.6, 1.0, 1.4):
        theta, status = f(first)
        second = 2 * np.arctan(np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2) / np.tan(first / 2))
        assert status == gt.Status.OK
        assert np.allclose(theta, [first, second, -first, -second], atol=TOLERANCE)


def test_redundant_constraints_are_reported_unless_the_user_drops_them():
    with pytest.raises(gt.ModelError, match=r"'pin'.* 3 of .*redundant=\"drop\".*mechanisms.py:\d+"):
        mechanisms.FourBar().causal(known="crank.phi", targets="rocker.phi")
    assert len(flat_of(four_bar()).loops.dropped) == 3


def test_a_cut_joint_that_closes_no_loop_is_named_with_its_line():
    with pytest.raises(gt.ModelError, match=r"'base', which closes no loop; .*mechanisms.py:\d+"):
        dropped(mechanisms.FourBar, "base").causal(known="crank.phi", targets="rocker.phi")


@pytest.mark.parametrize(
    ("given", "sentence"), [({"redundant": "keep"}, "'error' or 'drop'; found 'keep'"), ({"cut": "pin"}, "takes parts")]
)
def test_wrong_words_on_loops(given, sentence):
    with pytest.raises(gt.ModelError, match=sentence):
        gt.loops(**given)


class SliderCrank(gt.Model):
    """Crank, rod and a slide along x of the ground; the axis of a cylindrical slide may turn too."""

    world = gt.part(gt.mechanics.World, g=[0.0, -9.81, 0.0])
    ground = gt.part(gt.mechanics.Ground)
    motor = gt.part(gt.mechanics.TorqueMotor)
    crank = gt.part(mechanisms.Bar, L=0.3, phi={"start": 0.7})
    rod = gt.part(mechanisms.Bar, L=0.8)
    pin = gt.part(gt.mechanics.Revolute)
    slide = gt.part(gt.mechanics.Prismatic)

    def equations(self):
        yield gt.connect([self.ground.frame, self.crank.b], [self.crank.a, self.rod.a])
        yield gt.connect([self.ground.frame, self.slide.b], [self.slide.a, self.pin.a])
        yield gt.connect([self.rod.b, self.crank.shaft], [self.pin.b, self.motor.shaft])


class SlideAndTurn(SliderCrank):
    slide = gt.part(gt.mechanics.Cylindrical, axis=[1.0, 0.0, 0.0])


@cache
def slider_crank():
    return dropped(SliderCrank).causal(known="crank.phi", targets=["slide.flange.s", "motor.torque"])


@pytest.mark.parametrize("cls", [SliderCrank, SlideAndTurn])
@pytest.mark.parametrize("cut", ["pin", "slide", "rod", "crank"])
def test_a_slider_crank_does_not_depend_on_the_joint_that_is_cut(cls, cut):
    model = dropped(cls, cut)
    f = model.causal(known="crank.phi", targets=["slide.flange.s", "motor.torque"])
    reference = slider_crank()
    for phi in (0.5, 0.9, 1.4):
        s, torque, status = f(phi, 1.5, -0.7)
        side = np.sign(s - 0.3 * np.cos(phi))
        assert status == gt.Status.OK
        assert abs(s - 0.3 * np.cos(phi) - side * np.sqrt(0.64 - (0.3 * np.sin(phi)) ** 2)) < TOLERANCE
        other, expected, _ = reference(phi, 1.5, -0.7)
        assert abs(s - other) < TOLERANCE
        assert abs(torque - expected) < TOLERANCE


def test_energy_is_kept_in_a_simulation_of_a_four_bar():
    run = four_bar().simulate(0.5, inputs={"motor.torque": 0.5}, start={"crank.phi": 0.7})
    assert run.status.ok
    assert run.checks["energy_balance"].passed
