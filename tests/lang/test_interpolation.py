"""Interpolation through points against numpy and scipy, units, and what is refused."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import gtmodel as gt
from gtmodel.lang.units import UnitError

# some ten operations per piece on numbers of order one
ROUND_OFF = 1e-13
RNG = np.random.default_rng(3)
AT = np.array([-0.6, -0.5, -0.1, 0.0, 0.4, 0.45, 0.9])
VALUES = RNG.normal(size=(len(AT), 3))
INSIDE = np.concatenate([np.linspace(-0.6, 0.9, 301)[1:-1], AT])


class Curve(gt.Model):
    """y(x) and its slope through points that are parameters."""

    at = gt.parameter(shape=(None,), unit="m", increasing=True)
    values = gt.parameter(shape=(None, 3), unit="N")
    x = gt.variable(unit="m")
    linear, linear_slope = gt.variable(3, unit="N"), gt.variable(3, unit="N/m")
    cubic, cubic_slope = gt.variable(3, unit="N"), gt.variable(3, unit="N/m")

    def equations(self):
        for method in ("linear", "cubic"):
            yield getattr(self, method) == gt.interpolate(self.x, self.at, self.values, method)
            slope = gt.interpolate(self.x, self.at, self.values, method, derivative=1)
            yield getattr(self, f"{method}_slope") == slope


@cache
def curve() -> gt.Model:
    return Curve(at=AT, values=VALUES)


def at(x, *targets: str, **given):
    f = curve().causal("x", targets)
    *found, status = f(*[np.broadcast_to(given.get(s.name, x), np.shape(x)) for s in f.inputs])
    assert np.all(status == gt.Status.OK)
    return found


def test_straight_pieces_are_those_of_numpy():
    expected = np.column_stack([np.interp(INSIDE, AT, VALUES[:, k]) for k in range(3)])
    assert np.max(np.abs(at(INSIDE, "linear")[0] - expected)) < ROUND_OFF


def test_cubic_is_the_natural_spline_of_scipy():
    spline = CubicSpline(AT, VALUES, bc_type="natural")
    # slopes reach 40 between points 0.05 apart
    for target, order in (("cubic", 0), ("cubic_slope", 1)):
        assert np.max(np.abs(at(INSIDE, target)[0] - spline(INSIDE, order))) < 100 * ROUND_OFF
    rate = at(INSIDE, "der(cubic,2)", **{"der(x)": 2.0, "der(x,2)": 0.5})[0]
    expected = 4.0 * spline(INSIDE, 2) + 0.5 * spline(INSIDE, 1)
    assert np.max(np.abs(rate - expected)) < 1e-12 * np.max(np.abs(expected))


@pytest.mark.parametrize("method", ["linear", "cubic"])
def test_it_goes_on_straight_beyond_the_points(method):
    spline = CubicSpline(AT, VALUES, bc_type="natural")
    for end, inner in ((0, 1), (-1, -2)):
        slope = (VALUES[end] - VALUES[inner]) / (AT[end] - AT[inner]) if method == "linear" else spline(AT[end], 1)
        x = AT[end] + (1 if end else -1) * np.array([0.0, 1e-9, 0.3, 5.0])
        expected = VALUES[end] + (x - AT[end])[:, None] * slope
        found, found_slope = at(x, method, f"{method}_slope")
        assert np.max(np.abs(found - expected)) < 1e-12 * np.max(np.abs(expected))
        assert np.max(np.abs(found_slope - slope)) < 1e-12 * np.max(np.abs(slope))


def test_at_a_point_the_slope_is_that_of_the_piece_to_its_right():
    jacobian = np.diff(VALUES, axis=0) / np.diff(AT)[:, None]
    found, rate = at(AT, "linear_slope", "der(linear)", **{"der(x)": 1.0})
    assert np.max(np.abs(found - np.vstack([jacobian, jacobian[-1]]))) < 1e-12 * np.max(np.abs(jacobian))
    assert np.array_equal(found, rate)  # one piece counts at its ends, not two


def test_two_points_are_a_line_for_both_methods():
    model = Curve(at=[0.0, 2.0], values=[[0, 0, 0], [2, 4, 6]])
    f = model.causal("x", ["linear", "cubic", "cubic_slope"])
    linear, cubic, slope, status = f(3.0)
    assert status == gt.Status.OK
    assert np.array_equal(linear, [3, 6, 9]) and np.array_equal(cubic, linear) and np.array_equal(slope, [1, 2, 3])


def test_a_value_that_is_not_finite_has_a_status():
    *found, status = curve().causal("x", ["cubic"])(np.array([0.1, np.nan]))
    assert list(status) == [gt.Status.OK, gt.Status.NOT_FINITE] and np.all(np.isfinite(found[0][0]))


class TestRefused:
    def test_points_that_do_not_increase(self):
        with pytest.raises(gt.ModelError, match="parameter 'at' is declared increasing; found"):
            Curve(at=[0.0, 1.0, 1.0], values=np.zeros((3, 3)))

    def test_another_shape(self):
        with pytest.raises(gt.ModelError, match=r"'values' has shape \(n, 3\); found a value of shape \(3, 2\)"):
            Curve(at=[0.0, 1.0, 2.0], values=np.zeros((3, 2)))

    def test_no_value(self):
        with pytest.raises(gt.ModelError, match=r"parameter 'values' of shape \(n, 3\) has no value; set it"):
            Curve(at=[0.0, 1.0]).causal("x", "linear")

    def test_lengths_that_differ(self):
        with pytest.raises(gt.ModelError, match=r"and n values; found shapes \(\), \(2,\) and \(3, 3\)"):
            Curve(at=[0.0, 1.0], values=np.zeros((3, 3))).causal("x", "linear")

    @pytest.mark.parametrize(
        ("call", "sentence"),
        [
            (lambda m: gt.interpolate(m.t, m.at, m.values), "x is in s, the abscissae are in m"),
            (lambda m: gt.interpolate(m.x, [0.0, 0.0], [1.0, 2.0]), "strictly increasing abscissae"),
            (lambda m: gt.interpolate(m.x, [0.0], [1.0]), "n >= 2 abscissae"),
            (lambda m: gt.interpolate(m.x, m.at, m.values, "quintic"), "'linear' or 'cubic'"),
            (lambda m: gt.interpolate(m.x, m.at, m.values, derivative=2), "derivative 0 or 1"),
            (lambda m: gt.interpolate(1.0, [0.0, 1.0], [1.0, 2.0]), "at least one expression"),
            (lambda m: m.y == gt.interpolate(m.x, m.at, m.values)[0], "units differ"),
        ],
    )
    def test_in_the_equation(self, call, sentence):
        class Wrong(Curve):
            t = gt.variable(unit="s")
            y = gt.variable(unit="m")

            def equations(self):
                yield call(self)

        with pytest.raises((gt.ModelError, UnitError), match=sentence):
            Wrong(at=AT, values=VALUES).causal("x", "y")

    def test_a_variable_of_open_length(self):
        with pytest.raises(gt.ModelError, match=r"the shape of a variable must consist of integers; found \(None, 3\)"):
            gt.variable((None, 3), unit="m")


@pytest.mark.parametrize("method", ["linear", "cubic"])
def test_points_close_together_leave_the_others_their_digits(method):
    """A jump of 1 within 1e-12: slopes of 1e12 beside slopes of order one."""
    x = np.array([-1.0, 0.0, 1e-12, 1.0, 2.0])
    y = np.column_stack([[0.2, 0.0, 1.0, 1.3, 1.1], [0.0, 0.0, 1.0, 1.0, 0.5], [0.1, 0.2, 0.3, 0.4, 0.5]])
    f = Curve(at=x, values=y).causal("x", [method, f"{method}_slope"])
    inside = np.array([-0.5, 0.25, 1.5, 1.9])
    found, slope, status = f(inside)
    assert np.all(status == gt.Status.OK)
    if method == "linear":
        expected = np.column_stack([np.interp(inside, x, y[:, k]) for k in range(3)])
        jacobian = (np.diff(y, axis=0) / np.diff(x)[:, None])[np.searchsorted(x, inside) - 1]
    else:
        spline = CubicSpline(x, y, bc_type="natural")
        expected, jacobian = spline(inside), spline(inside, 1)
    size = np.max(np.abs(expected), axis=1, keepdims=True)
    assert np.max(np.abs(found - expected) / size) < ROUND_OFF
    assert np.max(np.abs(slope - jacobian) / np.max(np.abs(jacobian), axis=1, keepdims=True)) < ROUND_OFF
