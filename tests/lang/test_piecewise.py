"""gt.piecewise: polynomial pieces as an expression, against scipy's own evaluation."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import gtmodel as gt

AT = np.array([0.0, 0.3, 0.7, 1.5])
CURVE = CubicSpline(AT, np.array([[0.0, 1.0], [1.0, 0.5], [-1.0, 0.2], [0.4, 2.0]]))


class Curve(gt.Model):
    x = gt.variable(unit="1")
    y = gt.variable(2)

    def equations(self):
        yield self.y == gt.piecewise(self.x, CURVE.x, CURVE.c)


def test_values_and_derivatives():
    x = np.concatenate([np.linspace(-0.5, 2.0, 97), AT[:-1]])  # beyond the ends too, and on the breaks
    y, v, a, status = Curve().causal("x", ["y", "der(y)", "der(y,2)"])(x, np.full(len(x), 2.0), np.zeros(len(x)))
    assert np.all(status == 0)
    assert y == pytest.approx(CURVE(x), abs=1e-12)
    assert v == pytest.approx(2.0 * CURVE(x, 1), abs=1e-11) and a == pytest.approx(4.0 * CURVE(x, 2), abs=1e-10)


@pytest.mark.parametrize(
    "arguments, words",
    [
        (lambda m: (1.0, CURVE.x, CURVE.c), "takes a scalar expression"),
        (lambda m: (m.y, CURVE.x, CURVE.c), "takes a scalar expression"),
        (lambda m: (m.x, CURVE.x[::-1], CURVE.c), "strictly increasing breaks"),
        (lambda m: (m.x, CURVE.x[:-1], CURVE.c), r"takes coefficients of shape \(order \+ 1, 2\)"),
    ],
)
def test_wrong_arguments(arguments, words):
    class Wrong(Curve):
        def equations(self):
            yield self.y == gt.piecewise(*arguments(self))

    with pytest.raises(gt.ModelError, match=words):
        Wrong().causal("x", "y")


# a step of 1e16 beside pieces of order one, and pieces closer than 1e-6
HARD = [
    (np.array([0.0, 1.0, 1.0 + 1e-9, 2.0, 3.0]), [[1e16, 1.0, 1e16, 0.3], [0.1, 0.7, 0.1, 0.9]]),
    (np.array([0.0, 1e-9, 2e-9, 1.0, 2.0]), [[1e9, -1e9, 0.25, 0.3], [0.0, 1.0, 1e-7, 0.9]]),
]


@pytest.mark.parametrize("breaks, coefficients", HARD)
def test_each_piece_has_all_its_digits(breaks, coefficients):
    class Pieces(Curve):
        y = gt.variable()

        def equations(self):
            yield self.y == gt.piecewise(self.x, breaks, coefficients)

    jacobian, values = np.array(coefficients)
    middles = (breaks[1:] + breaks[:-1]) / 2
    found, status = Pieces().causal("x", "y")(middles)
    assert np.all(status == 0)
    # Horner in the order of the curve: not a digit is lost
    assert np.array_equal(found, jacobian * (middles - breaks[:-1]) + values)
