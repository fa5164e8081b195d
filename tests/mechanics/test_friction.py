"""Friction laws: limits, passivity, both directions, translation and rotation alike."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import gtmodel as gt
from gtmodel import mechanics as m

# A tanh and some sums on numbers of order 1e2.
ROUND_OFF = 1e-13
SCALE = 0.05
PLUS, MINUS = dict(coulomb=189.12, viscous=205.03), dict(coulomb=145.69, viscous=158.01)  # Dressler 2012, Table 6.1
BOTH = dict(**PLUS, coulomb_minus=MINUS["coulomb"], viscous_minus=MINUS["viscous"])
STRIBECK = dict(coulomb=100.0, viscous=50.0, breakaway=160.0, stribeck_velocity=0.2)
CASES = {
    "Frictionless": {},
    "TanhFriction": PLUS,
    "PiecewiseLinearFriction": PLUS,
    "DirectionalTanhFriction": BOTH,
    "DirectionalPiecewiseLinearFriction": BOTH,
    "StribeckFriction": STRIBECK,
    "RotationalTanhFriction": PLUS,
    "RotationalPiecewiseLinearFriction": PLUS,
    "RotationalDirectionalTanhFriction": BOTH,
    "RotationalDirectionalPiecewiseLinearFriction": BOTH,
    "RotationalStribeckFriction": STRIBECK,
}


class Sliding(gt.Model):
    """Friction alone on a flange that is moved from outside."""

    x = gt.variable(unit="m")
    friction = gt.part(m.Friction)
    motor = gt.part(m.ForceMotor)
    force = gt.variable(unit="N")

    def equations(self):
        yield gt.connect(self.friction.flange, self.motor.flange)
        yield self.x == self.motor.flange.s
        yield self.force == self.motor.force


class Turning(gt.Model):
    """Friction alone on a shaft that is moved from outside."""

    x = gt.variable(unit="rad")
    friction = gt.part(m.RotationalFriction)
    motor = gt.part(m.TorqueMotor)
    force = gt.variable(unit="N.m")

    def equations(self):
        yield gt.connect(self.friction.shaft, self.motor.shaft)
        yield self.x == self.motor.shaft.phi
        yield self.force == self.motor.torque


@cache
def law(name: str, scale: float = SCALE):
    """Force over velocity, arrays to arrays: the force that a motor needs to keep the velocity."""
    values = CASES[name] | ({} if name == "Frictionless" else {"velocity_scale": scale})
    model = (Turning if name.startswith("Rotational") else Sliding)(friction=getattr(m, name)(**values))
    f = model.causal("x", "force")

    def force(velocity):
        velocity = np.asarray(velocity, dtype=float)
        given = [velocity if s.name == "der(x)" else 0 * velocity for s in f.inputs]
        return f(*given)[0] if given else 0 * velocity

    return force


@pytest.mark.parametrize("name", CASES)
@settings(max_examples=60, deadline=None)
@given(st.floats(-3, 3))
def test_friction_never_drives(name, velocity):
    assert law(name)(np.array([velocity]))[0] * velocity >= 0


@pytest.mark.parametrize("name", [n for n in CASES if "Tanh" in n or "Piecewise" in n])
def test_far_from_standstill_it_is_coulomb_and_viscous_by_direction(name):
    minus = MINUS if "Directional" in name else PLUS
    v = np.array([1.5, 2.0])  # tanh(30) is 1 to the last digit
    assert np.allclose(law(name)(v), PLUS["coulomb"] + PLUS["viscous"] * v, rtol=ROUND_OFF)
    assert np.allclose(law(name)(-v), -minus["coulomb"] - minus["viscous"] * v, rtol=ROUND_OFF)


@pytest.mark.parametrize("name", [n for n in CASES if n != "Frictionless"])
def test_no_jump_at_standstill(name):
    # slope at 0: (coulomb level at 0) / scale + viscous; the directional laws take the mean of both sides
    both = CASES[name]
    level = both.get("breakaway", (both["coulomb"] + both.get("coulomb_minus", both["coulomb"])) / 2)
    slope = level / SCALE + (both["viscous"] + both.get("viscous_minus", both["viscous"])) / 2
    h = 1e-7
    assert law(name)(np.array([0.0]))[0] == 0
    for v in (h, -h):
        assert abs(law(name)(np.array([v]))[0] / v - slope) < 1e-5 * slope  # h / SCALE


@pytest.mark.parametrize("name", [n for n in CASES if not n.startswith("Rotational") and n != "Frictionless"])
def test_rotation_follows_the_same_laws(name):
    v = np.linspace(-2, 2, 81)
    assert np.array_equal(law(name)(v), law(f"Rotational{name}")(v))


def test_tanh_and_piecewise_linear_converge_to_each_other():
    # they differ where |v| is of the order of the scale only: the mean difference shrinks with it
    v = np.linspace(-1, 1, 20001)
    for pair in (("TanhFriction", "PiecewiseLinearFriction"),
                 ("DirectionalTanhFriction", "DirectionalPiecewiseLinearFriction")):  # fmt: skip
        gaps = [np.mean(np.abs(law(pair[0], s)(v) - law(pair[1], s)(v))) for s in (0.1, 0.05, 0.025, 0.0125)]
        ratios = np.array(gaps[:-1]) / gaps[1:]
        assert np.all(np.abs(ratios - 2) < 0.05)


def test_stribeck_falls_from_breakaway_to_coulomb():
    f = law("StribeckFriction", 0.001)
    v = np.array([0.005, 0.1, 0.2, 0.4, 2.0])  # tanh(5) = 0.9999
    expected = 100 + 60 * np.exp(-((v / 0.2) ** 2)) + 50 * v
    assert np.allclose(f(v), expected, rtol=1e-4)
    assert f(np.array([0.25]))[0] < f(np.array([0.01]))[0]


def test_a_base_class_says_what_to_use():
    for cls, model in ((m.Friction, Sliding), (m.RotationalFriction, Turning)):
        with pytest.raises(gt.ModelError, match=f"a {cls.__name__} must define law"):
            model().causal("x", "force")
