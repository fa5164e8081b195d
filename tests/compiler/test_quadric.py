"""Closed forms of nonlinear blocks: one quadratic, pencils of circles and spheres, planes among them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import gtmodel as gt
from gtmodel import Status
from tests.support.compare import relative_error
from tests.support.examples import examples

# A root loses half of the digits of its discriminant: 1e-3 of margin leaves thirteen.
ROUND_OFF = 1e-11
MARGIN = 1e-3
# two units in the last place of a coordinate of 1 km
FAR = 2 * float(np.spacing(1024.0))

number = st.integers(-2000, 2000).map(lambda k: k / 1000)


def kinds(f: gt.CausalFunction) -> list[str]:
    return [b.kind for b in f.plan.blocks if b.kind != "explicit"]


class Quadratic(gt.Model):
    """a x^2 + b x + c = 0 with all coefficients known; branch: on which side of the vertex."""

    x = gt.variable()
    a = gt.input(start=1.0)
    b = gt.input(start=0.0)
    c = gt.input(start=-1.0)

    def equations(self):
        yield self.a * self.x**2 + self.b * self.x + self.c == 0
        yield gt.branch("right", self.x + self.b / (2 * self.a))


class TwoCircles(gt.Model):
    """Circles round A and B in the metric x^2 + k y^2; branch: left of the line from A to B."""

    k = gt.parameter(1.0, positive=True)
    P = gt.variable(2, start=[0.5, 0.5])
    A = gt.input(2, start=[0.0, 0.0])
    B = gt.input(2, start=[1.0, 0.0])
    r = gt.input(2, start=[0.8, 0.9])

    def equations(self):
        for centre, radius in ((self.A, self.r[0]), (self.B, self.r[1])):
            d = self.P - centre
            yield d[0] ** 2 + self.k * d[1] ** 2 == radius**2
        along, across = self.B - self.A, self.P - self.A
        yield gt.branch("left", along[0] * across[1] - along[1] * across[0])


class LineAndCircle(gt.Model):
    """The unit circle cut by n.P = h; branch: ahead along the line."""

    P = gt.variable(2, start=[0.5, 0.5])
    n = gt.input(2, start=[1.0, -1.0])
    h = gt.input(start=0.0)

    def equations(self):
        yield self.n @ self.P == self.h
        yield self.P @ self.P == 1
        yield gt.branch("ahead", self.n[0] * self.P[1] - self.n[1] * self.P[0])


class PlaneAndSpheres(gt.Model):
    """Two spheres and a plane."""

    P = gt.variable(3, start=[0.5, 0.6, 0.2])
    h = gt.input(start=0.2)
    r = gt.input(2, start=[0.8, 0.9])

    def equations(self):
        d = self.P - [1.0, 0.0, 0.0]
        yield self.P @ self.P == self.r[0] ** 2
        yield self.P[2] == self.h
        yield 3.0 * (d @ d) == 3.0 * self.r[1] ** 2
        yield gt.branch("left", self.P[1])


QUADRATIC, CIRCLES, LINE, PLANE = Quadratic(), TwoCircles(), LineAndCircle(), PlaneAndSpheres()


class TestQuadratic:
    @examples(60)
    @given(number.map(lambda x: abs(x) + 0.05), number, number, st.sampled_from([1, -1]))
    def test_both_roots(self, a, b, c, side):
        # a > 0 as at the start values: a sign is fixed there, and with a leading coefficient of the other sign the
        # same sign of the root stands on the other side
        assume(b**2 - 4 * a * c > MARGIN)
        f = QUADRATIC.causal(["a", "b", "c"], "x", branches={"right": side})
        x, status = f(a, b, c)
        roots = np.sort(np.roots([a, b, c]).real)
        assert status == Status.OK
        assert kinds(f) == ["quadratic"]
        assert relative_error(x, roots[0 if side < 0 else 1]) < ROUND_OFF
        assert relative_error(a * x**2 + b * x, -c) < ROUND_OFF

    def test_no_root_a_double_root_and_no_quadratic_at_all(self):
        f = QUADRATIC.causal(["a", "b", "c"], "x")
        x, status = f([1.0, 1.0, 0.0], [0.0, 2.0, 1.0], [1.0, 1.0, 1.0])
        assert status.tolist() == [Status.OUT_OF_RANGE, Status.OK, Status.SINGULAR]
        assert x[1] == -1.0
        assert np.all(np.isnan(x[[0, 2]]))

    @pytest.mark.parametrize("side", [1, -1])
    @pytest.mark.parametrize("weight", [1.0, 3.0])
    def test_far_from_the_origin(self, side, weight):
        # a slider at (x, 0) with a rod to P: of x^2 - 2 P[0] x + P[0]^2 + ... six digits would cancel, twice
        class Slider(gt.Model):
            length = gt.parameter(1.25, unit="m", positive=True)
            weight = gt.parameter(1.0, unit="1", positive=True)
            P = gt.input(2, unit="m", start=[1024.5, 0.75])
            x = gt.variable(unit="m", start=1025.5 if side > 0 else 1023.5)

            def equations(self):
                d = self.P[0] - self.x
                yield self.weight * (d**2 + self.P[1] ** 2) == self.weight * self.length**2
                yield gt.branch("right", self.x - self.P[0])

        f = Slider(weight=weight).causal("P", "x", branches={"right": side})
        P = [1024.1, 0.3]
        expected = P[0] + side * np.sqrt(1.25**2 - P[1] ** 2)
        x, status = f(P)
        assert status == Status.OK
        assert abs(x - expected) < FAR
        assert abs(float(f.casadi_parametric(P, [1.25, weight])[0]) - expected) < FAR

    def test_a_known_leading_coefficient_needs_no_pivot(self):
        class Known(Quadratic):
            a = gt.parameter(1.0, unit="1", positive=True)

        f = Known().causal(["b", "c"], "x")
        assert [m.kind for m in f.margins] == ["discriminant"]
        x, status = f([0.0, 2.0, 0.0], [-4.0, 1.0, 1.0])
        assert status.tolist() == [Status.OK, Status.OK, Status.OUT_OF_RANGE]
        assert x[:2].tolist() == [2.0, -1.0]
        assert f.casadi_parametric(0.0, -4.0, [4.0])[0] == 1.0


class TestPencils:
    @examples(60)
    @given(st.lists(number, min_size=6, max_size=6), st.sampled_from([1, -1]))
    def test_two_circles(self, numbers, side):
        A, B, r = np.reshape(numbers, (3, 2)) - [[0, 0], [0, 0], [-2.1, -2.1]]
        distance = np.linalg.norm(B - A)
        x = (distance**2 + r[0] ** 2 - r[1] ** 2) / (2 * distance) if distance > 0.1 else np.inf
        assume(r[0] ** 2 - x**2 > MARGIN)
        f = CIRCLES.causal(["A", "B", "r"], "P", branches={"left": side})
        P, status = f(A, B, r)
        along = (B - A) / distance
        expected = A + x * along + side * np.sqrt(r[0] ** 2 - x**2) * np.array([-along[1], along[0]])
        assert status == Status.OK
        assert kinds(f) == ["sphere pencil"]
        assert relative_error(P, expected) < ROUND_OFF

    @pytest.mark.parametrize("k", [0.25, 4.0, 1e-3])
    @pytest.mark.parametrize("side", [1, -1])
    def test_a_metric_with_a_parameter(self, k, side):
        # y' = sqrt(k) y makes circles of the ellipses
        A, B, r = np.array([[0.1, 0.3], [1.0, 0.5], [0.8, 0.9]])
        scale = np.array([1.0, np.sqrt(k)])
        stretched, _ = CIRCLES.causal(["A", "B", "r"], "P", branches={"left": side})(A * scale, B * scale, r)
        f = CIRCLES.with_(k=k).causal(["A", "B", "r"], "P", branches={"left": side})
        P, status = f(A, B, r)
        assert status == Status.OK
        assert kinds(f) == ["sphere pencil"]
        assert relative_error(P * scale, stretched) < ROUND_OFF
        parametric = f.casadi_parametric(A, B, r, [k])[0].full().reshape(-1)
        assert relative_error(parametric * scale, stretched) < ROUND_OFF

    @pytest.mark.parametrize("side", [1, -1])
    def test_a_line_among_them(self, side):
        f = LINE.causal(["n", "h"], "P", branches={"ahead": side})
        n = np.array([0.6, -1.1])
        P, status = f(n, 0.4)
        foot = 0.4 * n / (n @ n)
        expected = foot + side * np.sqrt(1 - foot @ foot) * np.array([-n[1], n[0]]) / np.linalg.norm(n)
        assert status == Status.OK
        assert relative_error(P, expected) < ROUND_OFF

    @pytest.mark.parametrize("side", [1, -1])
    def test_a_plane_among_spheres_and_a_scaled_equation(self, side):
        f = PLANE.causal(["h", "r"], "P", branches={"left": side})
        P, status = f(0.3, [0.8, 0.9])
        x = (0.8**2 - 0.9**2 + 1) / 2
        assert status == Status.OK
        assert relative_error(P, [x, side * np.sqrt(0.8**2 - 0.3**2 - x**2), 0.3]) < ROUND_OFF

    def test_circles_that_do_not_meet_and_circles_with_one_centre(self):
        f = CIRCLES.causal(["A", "B", "r"], "P")
        P, status = f([0.0, 0.0], [[5.0, 0.0], [0.0, 0.0], [1.0, 0.0]], [0.8, 0.9])
        assert status.tolist() == [Status.OUT_OF_RANGE, status[1], Status.OK]
        assert status[1] in (Status.SINGULAR, Status.OUT_OF_RANGE, Status.NOT_FINITE)
        assert np.all(np.isnan(P[:2]))
        assert "P[0]" in f.diagnose([0.0, 0.0], [5.0, 0.0], [0.8, 0.9])

    def test_unknowns_that_stand_explicitly_are_taken_out_first(self):
        class WithDifference(TwoCircles):
            d = gt.variable(2)
            twice = gt.variable()

            def equations(self):
                yield from super().equations()
                yield self.d == self.P - self.A
                yield 2 * self.P[0] == self.twice

        f: Any = WithDifference().causal(["A", "B", "r"], ["P", "d", "twice"])
        P, d, twice, status = f([0.1, 0.0], [1.0, 0.0], [0.8, 0.9])
        assert status == Status.OK
        assert relative_error(d, P - [0.1, 0.0]) < ROUND_OFF
        assert twice == pytest.approx(2 * P[0], rel=ROUND_OFF)
