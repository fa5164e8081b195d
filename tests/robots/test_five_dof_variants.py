"""Variants with five degrees of freedom, the triangular arm and the ball screws: against NumPy by hand."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status
from gtmodel.mechanics import BallScrew, ForceMotor, Inertia
from gtmodel.robots.f1 import f1_ball_screws
from gtmodel.robots.six_link import ExtraCarts, extra_carts, queensland_gantry_tau
from gtmodel.robots.with_wrist import gantry_tau_wrist
from tests.oracle.f1_by_hand import F1ByHand
from tests.oracle.six_link import rotation
from tests.support.compare import relative_error
from tests.support.strategies import columns, random_states

# Some thousand operations, poses lose two digits, and Newton stops at 1e-13 of the nominals.
ROUND_OFF = 1e-10
COUNT = 30

TABLE = tomllib.loads(files("gtmodel.robots").joinpath("data", "gantry_tau.toml").read_text(encoding="utf-8"))["f1"]


def ok(*found):
    *values, status = found
    assert np.all(np.asarray(status) == Status.OK)
    return values[0] if len(values) == 1 else values


class TestWrist:
    """GantryTauWrist: plate in translation, then Rz(a) and Ry(b), links of 0.12 m and 0.08 m downwards."""

    @staticmethod
    @cache
    def robot():
        return gantry_tau_wrist("l1_camera")

    @staticmethod
    def by_hand(T, a, b):
        Rz = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
        Ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        return T + Rz @ [0, 0, -0.12] + Rz @ Ry @ [0, 0, -0.08], Rz @ Ry

    @pytest.fixture(scope="class")
    @staticmethod
    def drawn():
        T, *_, q = columns(random_states(gt.robots.gantry_tau("l1_camera"), COUNT, seed=1))
        angles = np.random.default_rng(1).uniform([-1.0, 0.2], [1.0, 1.2], (COUNT, 2))
        tool = [TestWrist.by_hand(t, *a) for t, a in zip(T, angles, strict=True)]
        return np.column_stack([q, angles]), np.array([x for x, _ in tool]), np.array([R for _, R in tool])

    def test_forward(self, drawn):
        axes, P, R = drawn
        f = self.robot().causal("axes", ["P", "R_tool"])
        assert not f.plan.newton
        found = ok(*f(axes))
        assert relative_error(found[0], P) < ROUND_OFF and relative_error(found[1], R) < ROUND_OFF

    def test_inverse_by_angles_and_by_direction(self, drawn):
        axes, P, R = drawn
        closed = self.robot().causal(["P", "wrist.q"], "axes")
        assert not closed.plan.newton
        assert relative_error(ok(*closed(P, axes[:, 3:])), axes) < ROUND_OFF
        by_direction = self.robot().causal(["P", "direction[0]", "direction[1]"], "axes")
        assert relative_error(ok(*by_direction(P, R[:, 0, 2], R[:, 1, 2])), axes) < ROUND_OFF

    def test_along_the_first_axis_is_singular(self, drawn):
        _, P, _ = drawn
        f = self.robot().causal(["P", "direction[0]", "direction[1]"], "axes")
        axes, status = f(P[:3], np.array([0.3, 0.0, 2.0]), np.array([0.1, 0.0, 0.0]))
        assert status[0] == Status.OK and status[1] != Status.OK and status[2] != Status.OK
        assert np.isfinite(axes[0]).all() and np.isnan(axes[1:]).all()

    def test_weight_of_the_wrist(self, drawn):
        # at rest, by the slope of the potential energy over the wrist's second angle
        a = drawn[0][0]
        rest = np.zeros(5)
        torque = ok(*self.robot().causal("axes", "wrist.tau")(a, rest, rest))
        expected = -9.81 * 1.2 * 0.04 * -np.sin(a[4])  # d/db of m g (-c cos b), c = 0.04 m below the axis
        assert abs(torque[0]) < ROUND_OFF
        assert abs(torque[1] - expected) < ROUND_OFF


class TestExtraCarts:
    @staticmethod
    @cache
    def robot():
        return extra_carts()

    def test_paired_carts_are_the_six_link_robot(self):
        q = np.random.default_rng(2).uniform(0.2, 0.8, (COUNT, 3))
        five = ok(*self.robot().causal("q", ["T", "e"])(q[:, [0, 1, 2, 1, 2]]))
        six = ok(*gt.robots.six_link_gantry_tau().causal("q", ["T", "e"])(q))
        for a, b in zip(five, six, strict=True):
            assert relative_error(a, b) < ROUND_OFF

    def test_links_and_the_two_more_freedoms(self):
        rng = np.random.default_rng(3)
        q = rng.uniform(0.2, 0.8, (COUNT, 3))[:, [0, 1, 2, 1, 2]]
        q[:, 3:] += 0.02 * rng.uniform(-1, 1, (COUNT, 2))
        r = self.robot()
        T, e = ok(*r.causal("q", ["T", "e"])(q))
        for x, t, u in zip(q, T, e, strict=True):
            d = t + np.asarray(r.B) @ rotation(u).T - r.A - x[list(ExtraCarts.stands_on), None] * np.asarray(r.v)
            assert relative_error(np.linalg.norm(d, axis=1), r.L) < ROUND_OFF
        # the pose has five freedoms: T and two elements of e prescribe the carts
        back, whole = ok(*r.causal(["T", "e[1]", "e[2]"], ["q", "e"])(T, e[:, 1], e[:, 2]))
        assert relative_error(back, q) < ROUND_OFF and relative_error(whole, e) < ROUND_OFF
        w, status = r.causal("q", "plate.frame.w").jacobian(q[0], np.zeros(5))
        assert status is Status.OK
        turns = np.linalg.svd(w[:, -5:], compute_uv=False)  # [rad/s per m/s]
        assert turns[1] > 1.0 > turns[2]


def test_triangular_arm_turns_the_plate():
    # over a cube of 0.6 m, where the plate of the six-link D1 turns by half a degree (tests/robots/test_six_link.py)
    robot = queensland_gantry_tau()
    T = np.asarray(robot.home) + 0.3 * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    q, e = ok(*robot.causal("T", ["q", "e"])(T))
    R = [rotation(x) for x in e]
    for x, t, r in zip(q, T, R, strict=True):
        d = t + np.asarray(robot.B) @ r.T - robot.A - x[[0, 1, 1, 2, 2, 2], None] * np.asarray(robot.v)
        assert relative_error(np.linalg.norm(d, axis=1), robot.L) < ROUND_OFF
    least = min(np.trace(R[0].T @ r) for r in R)
    assert np.degrees(np.arccos((least - 1) / 2)) > 10.0
    assert np.array_equal(robot.A[4], robot.A[5])


class ScrewAxis(gt.Model):
    """A ball screw between a motor and an inertia."""

    screw = gt.part(BallScrew)
    body = gt.part(Inertia, J=0.5)
    motor = gt.part(ForceMotor)

    def equations(self):
        yield gt.connect(self.screw.shaft, self.body.shaft)
        yield gt.connect(self.screw.flange, self.motor.flange)


class TestBallScrew:
    @staticmethod
    @cache
    def axis():
        return ScrewAxis()

    def test_law_of_cosines_both_ways(self):
        phi = np.linspace(-0.5, 0.5, 11)
        a, b = 0.25, 0.10
        expected = np.hypot(a - b * np.cos(np.pi / 2 + phi), b * np.sin(np.pi / 2 + phi)) - np.hypot(a, b)
        s = ok(*self.axis().causal("screw.shaft.phi", "screw.flange.s")(phi))
        assert relative_error(s, expected) < ROUND_OFF
        assert relative_error(ok(*self.axis().causal("screw.flange.s", "screw.shaft.phi")(expected)), phi) < ROUND_OFF
        assert np.all(np.diff(s) > 0)

    def test_no_losses(self):
        known, targets = "screw.shaft.phi", ["motor.force", "der(screw.flange.s)"]
        force, speed = ok(*self.axis().causal(known, targets)(0.3, 0.7, -1.1))
        assert abs(force * speed - 0.5 * -1.1 * 0.7) < ROUND_OFF  # motor power = J phi'' phi'

    def test_out_of_travel_is_a_status(self):
        f = self.axis().causal("screw.flange.s", "screw.shaft.phi")
        phi, status = f(np.array([0.0, 0.2, np.nan]))  # the longest screw is a + b = 0.35 m, 0.08 m more than at rest
        assert status.tolist() == [Status.OK, Status.OUT_OF_RANGE, Status.NOT_FINITE]
        assert abs(phi[0]) < ROUND_OFF and np.isnan(phi[1:]).all()

    def test_on_the_f1(self):
        f1 = gt.robots.f1_gantry_tau()
        robot = f1_ball_screws()
        s = np.array([0.7, 0.26, 0.2, 0.004, -0.006, 0.002])
        T, q, phi = ok(*robot.causal("s", ["T", "q", "screw[1].shaft.phi"])(s))
        turns = ok(*self.axis().causal("screw.flange.s", "screw.shaft.phi")(s[3:]))
        assert relative_error(q, [*s[:3], *turns]) < ROUND_OFF and abs(phi - turns[1]) < ROUND_OFF
        by_hand = F1ByHand.printed(TABLE).pose(q, np.asarray(f1.home), rotation(np.asarray(f1.home_e)))
        assert relative_error(T, by_hand[0]) < ROUND_OFF
