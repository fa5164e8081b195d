"""Pendulum, slider-crank, four-bar and circuits against their textbook formulas."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, strategies as st

import gtmodel as gt
from gtmodel import Status
from tests.support.compare import relative_error
from tests.support.examples import examples
from tests.support.models import Bridge, FourBar, Pendulum, SeriesRLC, SliderCrank

# Some dozen operations; poses keep away from singular ones by a factor of ten.
ROUND_OFF = 1e-12

QUICK = examples(40)

# one configuration each: a model keeps its compiled functions
PENDULUM = Pendulum(L=0.7, m=2.0, x=dict(start=0.4), y=dict(start=-0.55))
SLIDER_CRANK = SliderCrank()
FOUR_BAR = FourBar()
BRIDGE = Bridge()


def values(f: gt.CausalFunction, *arguments: Any) -> Any:
    *result, status = f(*arguments)
    assert np.all(np.asarray(status) == Status.OK), f.diagnose(*arguments)
    return result[0] if len(result) == 1 else result


class TestPendulum:
    """Angle phi from the lower rest position: L phi'' = -g sin(phi)."""

    @QUICK
    @given(st.floats(0.1, 1.4), st.floats(-3, 3))
    def test_against_the_angle(self, phi, rate):
        L, m, g = 0.7, 2.0, 9.81
        f = PENDULUM.causal((), ["y", "der(y)", "der(x,2)", "der(y,2)", "tension"], prefer="x")
        assert [s.name for s in f.inputs] == ["x", "der(x)"]
        bent = -g / L * np.sin(phi)
        expected = [
            -L * np.cos(phi),
            L * np.sin(phi) * rate,
            L * (np.cos(phi) * bent - np.sin(phi) * rate**2),
            L * (np.sin(phi) * bent + np.cos(phi) * rate**2),
            m * (rate**2 + g / L * np.cos(phi)),
        ]
        found = values(f, L * np.sin(phi), L * np.cos(phi) * rate)
        assert relative_error(found, expected) < ROUND_OFF

    def test_velocity_without_the_factor_two_of_the_square(self):
        # y' = -x x'/y, from (x^2 + y^2)' = 2 x x' + 2 y y'
        f = PENDULUM.causal((), ["y", "der(y)"], prefer="x").closed  # without the status that `.casadi` adds
        steps = [f.instruction_id(k) for k in range(f.n_instructions())]
        assert ca.OP_TWICE not in steps
        assert steps.count(ca.OP_MUL) == 1

    def test_prescribed_motion_with_a_force(self):
        # x known needs a force to be unknown: the horizontal push that moves the bob as prescribed
        class Pushed(Pendulum):
            push = gt.input(unit="N")

            def equations(self):
                yield self.m * gt.der(self.x, 2) == self.push - self.tension * self.x
                yield self.m * gt.der(self.y, 2) == -self.tension * self.y - self.m * self.g
                yield self.x**2 + self.y**2 == self.L**2

        f = Pushed().causal("x", ["push", "tension", "y"])
        push, tension, y = values(f, 0.6, 0.0, 0.0)
        assert relative_error([y, tension, push], [-0.8, 9.81 / 0.8, 9.81 * 0.6 / 0.8]) < ROUND_OFF


class TestSliderCrank:
    """Crank angle phi: P = r (cos, sin), s = r cos + sqrt(l^2 - r^2 sin^2); forces by virtual work."""

    r, l, m_P, m_s = 0.3, 0.8, 1.5, 2.5

    def motion(self, phi: float, w: float, a: float) -> dict[str, Any]:
        r, l = self.r, self.l
        root = np.sqrt(l**2 - r**2 * np.sin(phi) ** 2)
        slope = -r * np.sin(phi) - r**2 * np.sin(phi) * np.cos(phi) / root  # ds/dphi
        bend = -r * np.cos(phi) - r**2 * np.cos(2 * phi) / root - r**4 * (np.sin(phi) * np.cos(phi)) ** 2 / root**3
        return {
            "P": r * np.array([np.cos(phi), np.sin(phi)]),
            "der(P)": r * w * np.array([-np.sin(phi), np.cos(phi)]),
            "der(P,2)": r * a * np.array([-np.sin(phi), np.cos(phi)]) - r * w**2 * np.array([np.cos(phi), np.sin(phi)]),
            "s": r * np.cos(phi) + root,
            "der(s)": slope * w,
            "der(s,2)": slope * a + bend * w**2,
            "slope": slope,
            "tension along x": root,  # S - P along x
        }

    def torque(self, m: dict[str, Any], a: float, force: float) -> float:
        return self.m_P * self.r**2 * a + (self.m_s * m["der(s,2)"] - force) * m["slope"]

    @QUICK
    @given(st.floats(0.3, 2.8), st.floats(-3, 3), st.floats(-5, 5), st.floats(-50, 50), st.sampled_from([1, -1]))
    def test_driven_by_the_slider(self, phi, w, a, force, up):
        phi *= up
        m = self.motion(phi, w, a)
        f = SLIDER_CRANK.causal(["s", "force"], ["P", "der(P)", "der(P,2)", "torque", "tension"], branches={"up": up})
        P, Pd, Pdd, torque, tension = values(f, m["s"], m["der(s)"], m["der(s,2)"], force)
        for found, name in ((P, "P"), (Pd, "der(P)"), (Pdd, "der(P,2)")):
            assert relative_error(found, m[name]) < ROUND_OFF
        assert relative_error(torque, self.torque(m, a, force)) < ROUND_OFF
        pull = (force - self.m_s * m["der(s,2)"]) / m["tension along x"]
        assert relative_error(tension, pull) < ROUND_OFF

    @pytest.mark.parametrize("up", [1, -1])
    @pytest.mark.parametrize("right", [1, -1])
    def test_two_branches_one_after_the_other(self, up, right):
        f = SLIDER_CRANK.causal(["P[0]", "force"], ["P[1]", "s"], branches={"up": up, "right": right})
        y, s = values(f, 0.2)
        height = np.sqrt(0.3**2 - 0.2**2)
        assert relative_error([y, s], [up * height, 0.2 + right * np.sqrt(0.8**2 - height**2)]) < ROUND_OFF

    @QUICK
    @given(st.floats(0.3, 2.8), st.floats(-3, 3), st.floats(-3, 3), st.floats(-50, 50))
    def test_forward_dynamics(self, phi, w, torque, force):
        # (m_P r^2 + m_s s'^2) phi'' = torque + force s' - m_s s' s'' phi'^2
        m = self.motion(phi, w, 0.0)
        a = (torque + force * m["slope"] - self.m_s * m["slope"] * m["der(s,2)"]) / (
            self.m_P * self.r**2 + self.m_s * m["slope"] ** 2
        )
        f = SLIDER_CRANK.causal(["torque", "force"], ["der(s,2)", "der(P,2)"], prefer="s")
        found = values(f, m["s"], m["der(s)"], torque, force)
        expected = self.motion(phi, w, a)
        assert relative_error(found[0], expected["der(s,2)"]) < ROUND_OFF
        assert relative_error(found[1], expected["der(P,2)"]) < ROUND_OFF


class TestFourBar:
    """Position by the law of cosines in the triangle B, C, D."""

    a, b, c, d = 0.3, 0.7, 0.6, 0.8

    @QUICK
    @given(st.floats(-3.1, 3.1), st.floats(-2, 2), st.sampled_from([1, -1]))
    def test_both_branches_and_their_velocity(self, theta, rate, side):
        B = self.a * np.array([np.cos(theta), np.sin(theta)])
        D = np.array([self.d, 0.0])
        e = np.linalg.norm(D - B)
        along = (D - B) / e
        left = np.array([-along[1], along[0]])
        x = (e**2 + self.b**2 - self.c**2) / (2 * e)
        C = B + x * along + side * np.sqrt(self.b**2 - x**2) * left
        f = FOUR_BAR.causal("theta", ["C", "der(C)"], branches={"open": side})
        found, speed = values(f, theta, rate)
        assert relative_error(found, C) < ROUND_OFF
        # C turns about D, and along the coupler it moves as B does
        Bd = rate * np.array([-B[1], B[0]])
        expected = np.linalg.solve(np.array([C - D, C - B]), [0.0, (C - B) @ Bd])
        assert relative_error(speed, expected) < ROUND_OFF

    def test_the_branches_are_told_apart_by_the_declared_name(self):
        f = FOUR_BAR.causal("theta", "C")
        assert [r.settled_by for b in f.plan.blocks for r in b.roots] == ["open"]
        assert "from branch 'open'" in f.explain()
        assert "sphere pencil" in f.explain()


class TestCircuits:
    def test_series_circuit(self):
        R, L, C = 2.0, 0.5, 0.1
        f = SeriesRLC().causal(
            "u", ["der(capacitor.v)", "der(inductor.i)", "resistor.v", "source.i"], prefer=["capacitor.v", "inductor.i"]
        )
        assert sorted(s.name for s in f.inputs) == ["capacitor.v", "inductor.i", "u"]
        by_name = {"capacitor.v": 3.0, "inductor.i": -0.7, "u": 12.0}
        found = values(f, *[by_name[s.name] for s in f.inputs])
        expected = [-0.7 / C, (12.0 - R * -0.7 - 3.0) / L, R * -0.7, 0.7]  # the source delivers: current into p < 0
        assert relative_error(found, expected) < ROUND_OFF

    def test_series_circuit_turned_round(self):
        # which source voltage makes a given capacitor voltage: u = v + R C v' + L C v''
        f = SeriesRLC().causal("capacitor.v", "u")
        assert [s.name for s in f.inputs] == ["capacitor.v", "der(capacitor.v)", "der(capacitor.v,2)"]
        assert relative_error(values(f, 3.0, 5.0, 7.0), 3.0 + 2.0 * 0.1 * 5.0 + 0.5 * 0.1 * 7.0) < ROUND_OFF

    @QUICK
    @given(st.lists(st.floats(0.1, 10.0), min_size=5, max_size=5))
    def test_bridge_by_nodal_analysis(self, R):
        g = 1 / np.array(R)
        # nodes: left middle, right middle; source 1 V above both
        nodal = np.array([[g[0] + g[1] + g[4], -g[4]], [-g[4], g[2] + g[3] + g[4]]])
        left, right = np.linalg.solve(nodal, [g[0], g[2]])
        detector = (left - right) * g[4]
        total = (1 - left) * g[0] + (1 - right) * g[2]
        f = BRIDGE.causal("u", ["resistor[4].i", "source.i"])
        assert f.parameter_names == [f"R[{i}]" for i in range(5)]
        found = [float(x) for x in f.casadi_parametric(1.0, R)[:2]]
        assert relative_error(found, [detector, -total]) < ROUND_OFF

    def test_parameters_folded_in_or_kept(self):
        f = BRIDGE.causal("u", "resistor[4].i")
        kept = float(f.casadi_parametric(1.0, [4.0, 1.0, 2.0, 6.0, 3.0])[0])
        folded = values(BRIDGE.with_(R=[4.0, 1.0, 2.0, 6.0, 3.0]).causal("u", "resistor[4].i"), 1.0)
        assert relative_error(kept, folded, floor=0.0) < ROUND_OFF
