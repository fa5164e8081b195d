"""Functions of time that rest and move: no pulse is stepped over, however many there are and however short."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.compiler.analysis.bounds import bounds, functions_of_time, pace_of
from gtmodel.simulation import simulate

OMEGA, DECAY = np.sqrt(100.0 - 0.25), 0.5
# of the largest deflection: edges of a hundred-thousandth of a second are no jumps, and the integrator's own error
ACCURACY = 1e-5


class Oscillator(gt.Model):
    """x'' = F - 100 x - x', from rest."""

    x = gt.variable(start=0.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    F = gt.input()

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == self.F - 100 * self.x - self.v


SIXTY = np.linspace(1.0, 98.0, 60), np.full(60, 0.01), np.full(60, 100.0)


class OwnPulses(gt.Model):
    """The same, where the model's equations hold the time."""

    second = gt.parameter(1.0, unit="s")
    x = gt.variable(unit="1", start=0.0, fixed=True)
    v = gt.variable(unit="1", start=0.0, fixed=True)

    def equations(self):
        yield self.second * der(self.x) == self.v
        yield self.second * der(self.v) == train(*SIXTY, 1e-6)(self.time / self.second) - 100 * self.x - self.v


def train(begins, widths, heights, edge):
    """Pulses with edges of a hyperbolic tangent."""

    def function(t):
        pulses = zip(begins.tolist(), widths.tolist(), heights.tolist(), strict=True)
        return sum(0.5 * h * (np.tanh((t - a) / edge) - np.tanh((t - a - w) / edge)) for a, w, h in pulses)

    return function


def answer(begins, widths, heights, t):
    """Closed form for rectangular pulses."""

    def step(s):
        s = np.maximum(s, 0.0)
        return (1 - np.exp(-DECAY * s) * (np.cos(OMEGA * s) + DECAY / OMEGA * np.sin(OMEGA * s))) / 100

    pulses = zip(begins, widths, heights, strict=True)
    return sum(h * (step(t - a) - step(t - a - w)) for a, w, h in pulses)


@pytest.mark.parametrize("count", [1, 51, pytest.param(120, marks=pytest.mark.proof)])
def test_a_train_of_any_length(count):
    rng = np.random.default_rng(count)
    begins = np.linspace(1.0, 98.0, count) + rng.uniform(0, 0.2, count)
    widths, heights = rng.uniform(0.005, 0.02, count), rng.uniform(50.0, 150.0, count)
    run = simulate(Oscillator(), 100.0, inputs={"F": train(begins, widths, heights, 1e-6)})
    expected = answer(begins, widths, heights, run.trajectory.time)
    assert np.max(np.abs(run.trajectory["x"] - expected)) <= ACCURACY * np.max(np.abs(expected))


@pytest.mark.parametrize("seed", range(3))
def test_pulses_beside_ripple_and_far_shorter_than_it(seed):
    rng = np.random.default_rng(seed)
    width = 10.0 ** rng.uniform(-6, -3)
    at, height, ripple = rng.uniform(2, 18), 0.5 / width, rng.uniform(0.1, 20)
    run = simulate(
        Oscillator(), 20.0, inputs={"F": lambda t: gt.sin(ripple * t) + height * gt.exp(-(((t - at) / width) ** 2))}
    )
    alone = simulate(Oscillator(), 20.0, inputs={"F": lambda t: gt.sin(ripple * t)})
    t = run.trajectory.time
    s = np.maximum(t - at, 0.0)
    area = np.sqrt(np.pi) * 0.5
    kick = area * np.exp(-DECAY * s) * np.sin(OMEGA * s) / OMEGA
    found = run.trajectory["x"] - alone.trajectory["x"]
    away = np.abs(t - at) > 5 * width
    assert np.max(np.abs(found - kick)[away]) <= ACCURACY * np.max(np.abs(kick)) + width**2 * 100


def test_pulses_in_the_equations_themselves():
    run = simulate(OwnPulses(), 100.0)
    expected = answer(*SIXTY, run.trajectory.time)
    assert np.max(np.abs(run.trajectory["x"] - expected)) <= ACCURACY * np.max(np.abs(expected))


def test_what_moves_evenly_is_left_alone():
    t = ca.SX.sym("t")
    for e in (3 * t, ca.sin(3 * t), t**3 * (10 - 15 * t + 6 * t**2), ca.sin(t) ** 2 + ca.cos(t) ** 2):
        assert pace_of(e, t, 0.0, 1.0).knots.size == 0


X = ca.SX.sym("t")
FUNCTIONS = [
    ca.tanh((X - 0.3) / 1e-3), ca.exp(-(((X - 0.5) / 0.01) ** 2)), ca.sin(30 * X) * ca.cos(7 * X), ca.erf(5 * X - 2),
    1 / (1 + (X / 0.1) ** 2), ca.fabs(X - 0.4), ca.if_else(X < 0.5, ca.sin(X), X**3), ca.fmin(X, ca.sin(9 * X)),
    ca.fmax(X, ca.cos(9 * X)), ca.sqrt((X - 0.4) ** 2 + 1e-4), ca.floor(3 * X), ca.sign(X - 0.5), (X - 0.5) ** 5,
    (X - 0.2) ** -2, (X + 0.1) ** 1.7, X**X, ca.log(X + 1e-3), ca.tan(9 * X), ca.atan(50 * (X - 0.7)), ca.sinh(X - 0.5),
    ca.cosh(X - 0.5), ca.asin(X - 0.5), ca.asinh(X - 0.5), ca.log1p(X), ca.expm1(X), 1 - X, ca.fmod(X, 0.3),
]  # fmt: skip


@pytest.mark.parametrize("function", FUNCTIONS, ids=range(len(FUNCTIONS)))
def test_bounds_hold_what_lies_between(function):
    rng = np.random.default_rng(0)
    low = rng.uniform(0.01, 0.9, 200)
    high = low + 10.0 ** rng.uniform(-5, -1, 200)
    (a, b), (da, db) = bounds(functions_of_time(function, X)[0], low, high)
    times = low + np.linspace(0, 1, 101)[:, None] * (high - low)
    value, rate = (
        np.asarray(ca.Function("f", [X], [e])(times.reshape(1, -1))).reshape(times.shape)
        for e in (function, ca.jacobian(function, X))
    )
    slack = 1e-9 * (1 + np.abs(value))
    assert np.all(value >= a - slack) and np.all(value <= b + slack)
    known = np.isfinite(rate)
    slack = 1e-9 * (1 + np.abs(rate))
    assert np.all((rate >= da - slack)[known]) and np.all((rate <= db + slack)[known])


@pytest.mark.parametrize("width", [1e-2, 1e-4, 1e-7])
def test_pulses_written_as_differences_of_large_terms(width):
    """Bounds of such differences are far wider than the range of what they bound."""
    at = np.random.default_rng(7).uniform(1.0, 18.0, 9)

    def triangle(s):
        return (width - abs(s) + abs(width - abs(s))) / (2 * width**2)

    run = simulate(Oscillator(), 20.0, inputs={"F": lambda t: sum(triangle(t - a) for a in at.tolist())})
    t = run.trajectory.time
    away = np.all(np.abs(t[:, None] - at) > width, axis=1)
    # after a pulse, the impulse that it is, by the mean of e^(z s) over the triangle
    z = -DECAY + 1j * OMEGA
    gain = 2 * (np.cosh(z * width) - 1) / (z * width) ** 2 if width > 1e-3 else 1.0
    expected = sum(np.where(t > a, np.imag(gain * np.exp(z * np.maximum(t - a, 0.0))), 0.0) / OMEGA for a in at)
    assert np.max(np.abs(run.trajectory["x"] - expected)[away]) <= ACCURACY * np.max(np.abs(expected))
