"""An angle whose sine and cosine lie on a line: against arcs of cosines, at the edges of its range, in C."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

import gtmodel as gt
from gtmodel import Status
from tests.support.examples import examples

# a root of 1 - cos^2 > 0.19 loses less than a digit
ROUND_OFF = 1e-12
HOME, NEAR = 1.0, 0.05  # the consistent point nearest to the start values is at most so far from the start of phi


class Crank(gt.Model):
    """The tip of a crank of length r on a line n.tip = h; branch: left of the line's normal."""

    r = gt.parameter(0.5, unit="m", positive=True)
    squeeze = gt.parameter(1.0, unit="1", positive=True)
    phi = gt.variable(unit="rad", start=1.0)
    n = gt.input(2, start=[1.0, 0.0])
    h = gt.input(unit="m", start=0.2)

    def equations(self):
        tip = [self.r * gt.cos(self.phi), self.squeeze * self.r * gt.sin(self.phi)]
        yield self.n[0] * tip[0] + self.n[1] * tip[1] == self.h
        yield gt.branch("left", self.n[0] * tip[1] - self.n[1] * tip[0])


class Rod(gt.Model):
    """The tip of a crank at a distance of a point P: the squares of sine and cosine add up if it is round."""

    r = gt.parameter(0.5, unit="m", positive=True)
    squeeze = gt.parameter(1.0, unit="1", positive=True)
    phi = gt.variable(unit="rad", start=0.3)
    P = gt.input(2, unit="m", start=[0.9, -0.3])

    def equations(self):
        d = [self.P[0] - self.r * gt.cos(self.phi), self.P[1] - self.squeeze * self.r * gt.sin(self.phi)]
        yield d[0] ** 2 + d[1] ** 2 == 0.6**2


def kinds(f):
    return [b.kind for b in f.plan.blocks if b.kind != "explicit"]


@examples(60)
@given(st.floats(-3.0, 3.0), st.floats(0.2, 3.0), st.floats(-0.9, 0.9), st.sampled_from([1, -1]))
def test_both_sides_against_the_arc(direction, length, cosine, side):
    f = Crank().causal(["n", "h"], "phi", branches={"left": side})
    assert kinds(f) == ["angle"]
    n = length * np.array([np.cos(direction), np.sin(direction)])
    phi, status = f(n, 0.5 * length * cosine)
    assert status == Status.OK
    assert abs(np.exp(1j * phi) - np.exp(1j * (direction + side * np.arccos(cosine)))) < ROUND_OFF
    assert abs(phi - HOME) <= np.pi + NEAR


def test_out_of_range_and_singular():
    phi, status = Crank().causal(["n", "h"], "phi")([[1.0, 0.0], [0.0, 0.0], [1.0, 0.0]], [0.51, 0.0, 0.2])
    assert status.tolist() == [Status.OUT_OF_RANGE, Status.SINGULAR, Status.OK]
    assert np.isnan(phi[:2]).all()


@pytest.mark.parametrize(("low", "high"), [(0.0, 2 * np.pi), (-6.5, -0.3)])
def test_limits_choose_the_turn(low, high):
    f = Crank(phi={"min": low, "max": high, "start": (low + high) / 2}).causal(["n", "h"], "phi", branches={"left": -1})
    phi, status = f([1.0, 0.0], 0.3)
    assert status == Status.OK
    assert abs(phi - (-np.arccos(0.6) + (2 * np.pi if low == 0.0 else 0.0))) < ROUND_OFF


def test_an_ellipse_is_left_to_newton_also_if_a_parameter_makes_it_round():
    assert kinds(Rod().causal("P", "phi")) == ["angle"]
    assert kinds(Rod(squeeze=0.8).causal("P", "phi")) == ["Newton"]
    f = Rod().causal("P", "phi").casadi_parametric  # of all values of the parameters
    P = np.array([0.9, -0.3])
    for squeeze in (1.0, 0.8):
        phi, status = (float(x) for x in f(P, [0.5, squeeze])[:2])
        assert status == Status.OK
        assert abs(np.linalg.norm(P - [0.5 * np.cos(phi), squeeze * 0.5 * np.sin(phi)]) - 0.6) < 1e-9  # of Newton


def test_with_states_newton_continues_the_angle_over_further_turns():
    class Turning(gt.Model):
        """A point that circles, and the angle of its direction."""

        s = gt.variable(unit="rad", start=0.3)
        phi = gt.variable(unit="rad", start=0.3)

        def equations(self):
            yield gt.der(self.s) == 1.0
            yield gt.sin(self.phi) == gt.sin(self.s)

    f = Turning().causal(targets="phi")
    assert [s.name for s in f.inputs] == ["s"]
    assert kinds(f) == ["Newton"]


def test_derivatives_and_c_equal_python(tmp_path):
    f = Rod().causal("P", "phi")
    P, e = np.array([0.9, -0.3]), 1e-6
    J, status = f.jacobian(P)
    central = [(f(P + e * d)[0] - f(P - e * d)[0]) / (2 * e) for d in np.eye(2)]
    assert status == Status.OK
    assert np.allclose(J, [central], rtol=1e-8)
    box = {"P": [[0.7, 0.9], [-0.4, 0.0]]}
    gt.cgen.generate({"phi": f}, tmp_path / "c", name="rod", box=box)
    report = gt.cgen.check(tmp_path / "c", {"phi": f}, points=200, seed=1)
    assert all(c.passed for c in report.checks.values())
