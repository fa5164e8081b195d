"""Slider-crank and four-bar from parts: closed form, and against textbook formulas, derivatives by series."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest

from gtmodel import Status
from tests.mechanics.balance import power_balance
from tests.mechanics.linkages import FourBar, SliderCrank
from tests.support.compare import relative_error
from tests.support.residuals import original_residuals

# Some hundred operations on numbers of order 1 to 1e2.
ROUND_OFF = 1e-12
RESIDUAL = 1e-10
CLOSED = {"explicit", "linear", "quadratic", "sphere pencil"}
RNG = np.random.default_rng(7)
STATES = RNG.uniform([-3, -2, -5], [3, 2, 5], (12, 3))  # phi, its rate and acceleration


@cache
def model(cls):
    return cls()


def derivatives(expression, phi, at, rate, acceleration):
    """Value, first and second time derivative of an expression of the angle phi."""
    first = ca.jacobian(expression, phi)
    second = ca.jacobian(first, phi)
    f = ca.Function("f", [phi], [expression, first, second])
    y, dy, ddy = (np.asarray(x.full()).reshape(-1) for x in f(at))
    return y, dy * rate, ddy * rate**2 + dy * acceleration


def check(f):
    assert {b.kind for b in f.plan.blocks} <= CLOSED
    return f


def generalised_force(kinetic, phi, at, rate, acceleration):
    """Lagrange: T = M(phi) rate^2 / 2 gives M acceleration + M' rate^2 / 2."""
    f = ca.Function("M", [phi], [kinetic, ca.jacobian(kinetic, phi)])
    mass, slope = (float(x) for x in f(at))
    return mass * acceleration + slope * rate**2 / 2


class TestSliderCrank:
    def formula(self, side):
        m = model(SliderCrank)
        phi = ca.SX.sym("phi")
        pin = ca.vertcat(m.r * ca.cos(phi), m.r * ca.sin(phi), 0)
        s = pin[0] + side * ca.sqrt(m.l**2 - pin[1] ** 2)
        return m, phi, pin, s

    @pytest.mark.parametrize("side", [1, -1])
    def test_motion(self, side):
        _, phi, _, s = self.formula(side)
        f = check(model(SliderCrank).causal(["phi", "force"], ["s", "der(s)", "der(s,2)"], branches={"ahead": side}))
        for state in STATES:
            *found, status = f(*state)
            assert status == Status.OK
            assert relative_error(found, np.ravel(derivatives(s, phi, *state))) < ROUND_OFF

    def test_the_crank_from_the_slider(self):
        # the same model the other way round; no closed form, because the unknown is an angle
        m = model(SliderCrank)
        f = m.causal(["s", "force"], ["phi", "der(phi)"])
        back = m.causal(["phi", "force"], ["s", "der(s)"])
        phi, rate, status = f(0.9, 0.4)
        assert status == Status.OK
        s, speed, _ = back(phi, rate)
        assert relative_error([s, speed], [0.9, 0.4]) < ROUND_OFF

    def test_dynamics_by_lagrange(self):
        m, phi, pin, s = self.formula(1)
        v_pin = ca.jacobian(pin, phi)
        v_s = ca.jacobian(ca.vertcat(s, 0, 0), phi)
        rod = m.m_rod / 3 * (ca.dot(v_pin, v_pin) + ca.dot(v_pin, v_s) + ca.dot(v_s, v_s))
        mass = m.J + m.m * v_s[0] ** 2 + rod
        inverse = check(m.causal(["phi", "force"], "torque"))
        forward = check(m.causal(["torque", "force"], "der(phi,2)"))
        assert [x.name for x in forward.inputs] == ["phi", "der(phi)", "torque", "force"]
        for state in STATES:
            torque, status = inverse(*state, 20.0)
            assert status == Status.OK
            _, lever, _ = derivatives(s, phi, state[0], 1.0, 0.0)
            assert relative_error(torque, generalised_force(mass, phi, *state) - 20.0 * lever[0]) < ROUND_OFF
            back, status = forward(state[0], state[1], torque, 20.0)
            assert status == Status.OK
            assert relative_error(back, state[2]) < 100 * ROUND_OFF  # an inertia down to 0.1 kg m2 is divided by

    def test_every_equation_as_written_holds(self):
        values = {"phi": 0.5, "der(phi)": 1.0, "torque": 3.0, "force": -4.0}
        assert np.max(np.abs(original_residuals(model(SliderCrank), values, ["torque", "force"]))) < RESIDUAL
        assert power_balance(model(SliderCrank), values, ["torque", "force"]) < ROUND_OFF


class TestFourBar:
    def formula(self, side):
        m = model(FourBar)
        phi = ca.SX.sym("phi")
        pin = ca.vertcat(m.a * ca.cos(phi), m.a * ca.sin(phi))
        diagonal = ca.vertcat(m.d, 0) - pin
        f = ca.norm_2(diagonal)
        along = (f**2 + m.b**2 - m.c**2) / (2 * f)
        across = side * ca.sqrt(m.b**2 - along**2)
        C = pin + (along * diagonal + across * ca.vertcat(-diagonal[1], diagonal[0])) / f
        return m, phi, pin, C

    @pytest.mark.parametrize("side", [1, -1])
    def test_motion(self, side):
        m, phi, _, C = self.formula(side)
        f = check(m.causal("phi", ["C", "der(C)", "der(C,2)", "der(psi)"], branches={"open": side}))
        for state in STATES:
            *found, spin, status = f(*state)
            assert status == Status.OK
            expected = derivatives(C, phi, *state)
            for x, e in zip(found, expected, strict=True):
                assert relative_error(x, [*e, 0.0]) < 10 * ROUND_OFF  # the circles cut at angles down to 0.3
            lever = expected[0] - [m.d, 0]
            assert (
                relative_error(spin, (lever[0] * expected[1][1] - lever[1] * expected[1][0]) / m.c**2) < 10 * ROUND_OFF
            )

    def test_dynamics_by_lagrange(self):
        m, phi, pin, C = self.formula(1)
        v_pin, v_C = ca.jacobian(pin, phi), ca.jacobian(C, phi)
        rods = 0.9 / 3 * (ca.dot(v_pin, v_pin) + ca.dot(v_pin, v_C) + ca.dot(v_C, v_C)) + 1.1 / 3 * ca.dot(v_C, v_C)
        mass = m.m * ca.dot(v_C, v_C) + rods
        f = check(m.causal("phi", "torque"))
        forward = check(m.causal("torque", "der(phi,2)"))
        for state in STATES:
            torque, status = f(*state)
            assert status == Status.OK
            assert relative_error(torque, generalised_force(mass, phi, *state)) < 100 * ROUND_OFF
            back, status = forward(*state[:2], torque)
            assert status == Status.OK
            assert relative_error(back, state[2]) < 1000 * ROUND_OFF  # an inertia down to 0.01 kg m2 is divided by

    def test_weight_lies_on_the_plane(self):
        # gravity along -z: the plane carries what the rods cannot
        f = model(FourBar).causal("phi", ["plane.pressure"])
        pressure, status = f(0.5, 0.0, 0.0)
        assert status == Status.OK
        assert relative_error(pressure, 9.81 * (1.5 + 0.9 / 2 + 1.1 / 2)) < ROUND_OFF

    def test_every_equation_as_written_holds(self):
        values = {"phi": 0.5, "der(phi)": 1.0, "torque": 3.0}
        assert np.max(np.abs(original_residuals(model(FourBar), values, "torque"))) < RESIDUAL
        assert power_balance(model(FourBar), values, "torque") < ROUND_OFF


def test_an_unreachable_crank_angle_is_a_status():
    s, status = SliderCrank(l=0.2).causal(["phi", "force"], "s")(1.5)
    assert status == Status.OUT_OF_RANGE and np.isnan(s)
