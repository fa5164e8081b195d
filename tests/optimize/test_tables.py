"""Collocation tables against closed forms, SciPy's roots and the orders they must have."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.special import roots_jacobi

from gtmodel.optimize import Blocks, Mesh
from gtmodel.optimize.mesh import SCHEMES, basis, basis_slope, points, table

# Values of order one after some ten operations in double precision (2.2e-16).
ROUND_OFF = 1e-14
# Differentiation matrices of nine points have entries up to 40; their rows sum to zero by cancellation.
SLOPE_ROUND_OFF = 1e-12
COUNTS = range(1, 10)

r3, r6, r15 = np.sqrt([3.0, 6.0, 15.0])
CLOSED_FORMS = {
    ("radau", 1): [1.0],
    ("radau", 2): [1 / 3, 1.0],
    ("radau", 3): [(4 - r6) / 10, (4 + r6) / 10, 1.0],
    ("gauss", 1): [0.5],
    ("gauss", 2): [(3 - r3) / 6, (3 + r3) / 6],
    ("gauss", 3): [(5 - r15) / 10, 0.5, (5 + r15) / 10],
}
WEIGHTS = {
    ("radau", 1): [1.0],
    ("radau", 2): [3 / 4, 1 / 4],
    ("radau", 3): [(16 - r6) / 36, (16 + r6) / 36, 1 / 9],
    ("gauss", 1): [1.0],
    ("gauss", 2): [1 / 2, 1 / 2],
    ("gauss", 3): [5 / 18, 8 / 18, 5 / 18],
}
# Butcher's matrix of Radau IIA with three points (Hairer and Wanner 1996, Table IV.5.6)
RADAU_IIA = np.array(
    [
        [(88 - 7 * r6) / 360, (296 - 169 * r6) / 1800, (-2 + 3 * r6) / 225],
        [(296 + 169 * r6) / 1800, (88 + 7 * r6) / 360, (-2 - 3 * r6) / 225],
        [(16 - r6) / 36, (16 + r6) / 36, 1 / 9],
    ]
)


def monic(roots):
    return Polynomial(np.poly(roots)[::-1] if len(roots) else [1.0])


@pytest.mark.parametrize("scheme, count", CLOSED_FORMS)
def test_closed_forms(scheme, count):
    t = table(scheme, count)
    assert t.points == pytest.approx(CLOSED_FORMS[scheme, count], abs=ROUND_OFF)
    assert t.weights == pytest.approx(WEIGHTS[scheme, count], abs=ROUND_OFF)


@pytest.mark.parametrize("count", COUNTS)
def test_points_are_jacobi_roots(count):
    # Radau IIA without its end point: roots of the Jacobi polynomial with weight (1 - x), shifted to [0, 1]
    inner = (roots_jacobi(count - 1, 1, 0)[0] + 1) / 2 if count > 1 else []
    assert points("radau", count) == pytest.approx([*inner, 1.0], abs=ROUND_OFF)
    assert points("radau", count)[-1] == 1.0  # exactly: the element's end is a node
    assert points("gauss", count) == pytest.approx((roots_jacobi(count, 0, 0)[0] + 1) / 2, abs=ROUND_OFF)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("count", COUNTS)
class TestTable:
    def degree(self, scheme, count):
        """Highest degree that the quadrature integrates exactly."""
        return 2 * count - (2 if scheme == "radau" else 1)

    def test_quadrature_is_exact_up_to_its_degree_and_no_further(self, scheme, count):
        t = table(scheme, count)
        top = self.degree(scheme, count)
        moments = [t.weights @ t.points**k for k in range(top + 1)]
        assert moments == pytest.approx([1 / (k + 1) for k in range(top + 1)], abs=ROUND_OFF)
        # one degree more: the error is the integral of the squared nodal polynomial (Gauss) or of its like (Radau)
        nodal = monic(t.points) * monic(t.points if scheme == "gauss" else t.points[:-1])
        assert nodal.degree() == top + 1
        expected = nodal.integ()(1.0) - nodal.integ()(0.0)
        missing = 1 / (top + 2) - t.weights @ t.points ** (top + 1)
        assert missing == pytest.approx(expected, abs=ROUND_OFF)
        if count < 6:  # beyond that the error itself is round-off
            assert abs(missing) > 1e-9

    def test_differentiation_is_exact_on_polynomials(self, scheme, count):
        t = table(scheme, count)
        for k in range(count + 1):
            jacobian = t.nodes**k @ t.derivative
            expected = k * t.points ** max(0, k - 1)
            assert jacobian == pytest.approx(expected, abs=SLOPE_ROUND_OFF)

    def test_end_row(self, scheme, count):
        t = table(scheme, count)
        for k in range(count + 1):
            assert t.end @ t.nodes**k == pytest.approx(1.0, abs=SLOPE_ROUND_OFF)
        if scheme == "radau":
            assert np.array_equal(t.end, np.eye(count + 1)[-1])

    def test_one_step_is_the_runge_kutta_method(self, scheme, count):
        """x' = x: the end value is the stability function, a Pade approximant of exp with the order's error."""
        t = table(scheme, count)
        z = 0.1
        inner = np.linalg.solve(t.derivative[1:].T - z * np.eye(count), -t.derivative[0])
        end = t.end @ [1.0, *inner]
        order = 2 * count - (1 if scheme == "radau" else 0)
        assert abs(end - np.exp(z)) < z ** (order + 1) + ROUND_OFF


def test_radau_iia_is_butchers():
    t = table("radau", 3)
    assert np.linalg.inv(t.derivative[1:].T) == pytest.approx(RADAU_IIA, abs=ROUND_OFF)


def test_one_radau_point_has_weight_one():
    # casadi.collocation_coeff gives 0.5 here: implicit Euler would cost half
    assert table("radau", 1).weights == pytest.approx([1.0], abs=ROUND_OFF)


def test_slopes_of_the_basis_by_differences():
    nodes, at, step = np.array([0.0, 0.2, 0.5, 1.0]), np.linspace(0.0, 1.0, 7), 1e-6
    difference = (basis(nodes, at + step) - basis(nodes, at - step)) / (2 * step)
    # step^2 times third derivatives of some tens, and 1e-16 / step of cancellation
    assert basis_slope(nodes, at) == pytest.approx(difference, abs=1e-8)


def test_tables_are_shared_and_read_only():
    assert table("radau", 3) is table("radau", 3)
    with pytest.raises(ValueError, match="read-only"):
        table("radau", 3).weights[0] = 0.0


class TestMesh:
    def test_unequal_lengths(self):
        mesh = Mesh(3, 2, lengths=(1.0, 2.0, 5.0))
        assert mesh.h == pytest.approx([0.125, 0.25, 0.625], abs=ROUND_OFF)
        assert mesh.edges == pytest.approx([0.0, 0.125, 0.375, 1.0], abs=ROUND_OFF)
        assert mesh.edges[-1] == 1.0

    @pytest.mark.parametrize(
        "arguments, sentence",
        [
            (dict(elements=0), "a mesh needs at least one element and one point; found 0 x 3"),
            (dict(points=0), "a mesh needs at least one element and one point; found 50 x 0"),
            (dict(scheme="lobatto"), "scheme must be 'radau' or 'gauss'; found 'lobatto'"),
            (dict(control="spline"), "control must be one of polynomial, bernstein, linear, constant; found 'spline'"),
            (
                dict(length_ratio=(0.0, 2.0)),
                r"length_ratio must be \(low, high\) with 0 < low <= 1 <= high.*found \(0.0, 2.0\)",
            ),
            (dict(length_ratio=(1.2, 2.0)), r"length_ratio must be .*found \(1.2, 2.0\)"),
            (
                dict(elements=4, control="constant", blocks=Blocks(sizes=(2, 3))),
                "block sizes sum to 5, but the mesh has 4",
            ),
            (dict(elements=5, blocks=Blocks(sizes=(2, 3))), "blocks need control 'constant'; found 'polynomial'"),
            (dict(elements=3, lengths=(1.0, 2.0)), "a mesh of 3 elements needs 3 positive"),
            (dict(elements=2, lengths=(1.0, 0.0)), "a mesh of 2 elements needs 2 positive"),
        ],
    )
    def test_wrong_meshes(self, arguments, sentence):
        with pytest.raises(ValueError, match=sentence):
            Mesh(**arguments)

    @pytest.mark.parametrize(
        "scheme, count, sentence",
        [("lobatto", 3, "unknown collocation scheme 'lobatto'"), ("radau", 0, "at least one point; found 0")],
    )
    def test_wrong_tables(self, scheme, count, sentence):
        with pytest.raises(ValueError, match=sentence):
            table(scheme, count)
