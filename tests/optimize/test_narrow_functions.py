"""A function of time that moves between all points of a mesh: the checks see what it does all the same."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, solve
from gtmodel.optimize.judgement.discretisation import COST, NAME

AREA = np.sqrt(np.pi)
# a step inside an element, as five points see it: a part of that one element of ten
RULE = 0.05


def pulse(t, at, width):
    return gt.exp(-(((t - at) / width) ** 2)) / width


class Pushed(gt.Optimization):
    """A mass that a pulse pushes; the input brings it back."""

    at = gt.parameter(4.321)
    width = gt.parameter(0.01)
    push = gt.parameter(1.0)
    x = gt.variable(start=0.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=-5.0, max=5.0)
    final_time = 10.0

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == self.u + self.push * pulse(self.time, self.at, self.width)

    def objective(self):
        return gt.integral(self.u**2)

    def constraints(self):
        yield self.x.at(self.final_time) == 1.0
        yield self.v.at(self.final_time) == 0.0


class Paid(gt.Optimization):
    """A rate at a price that is high for a moment."""

    at = gt.parameter(4.321)
    width = gt.parameter(0.01)
    x = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=0.0, max=1.0)
    final_time = 10.0

    def equations(self):
        yield der(self.x) == self.u

    def objective(self):
        return gt.integral(self.u**2 * (1 + pulse(self.time, self.at, self.width)))

    def constraints(self):
        yield self.x.at(self.final_time) == 1.0


@pytest.mark.parametrize("width", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("seed", range(3))
def test_a_pulse_between_the_points_is_in_the_estimate(width, seed):
    at = float(np.random.default_rng(seed).uniform(0.5, 9.5))
    s = solve(Pushed(at=at, width=width), Mesh(10))
    # what the solution does not know of: a step of the speed, and the ramp that it makes
    missed = [AREA * (10.0 - at) / np.ptp(s.trajectory["x"]), AREA / np.ptp(s.trajectory["v"])]
    assert s.status.value == "check_failed"
    if width < 1e-2:  # no point lies in it
        assert s.checks[NAME].value == pytest.approx(max(missed), rel=RULE)
    without = solve(Pushed(at=at, width=width, push=0.0), Mesh(10))
    assert without.status.ok


def test_a_price_between_the_points_is_in_the_estimate():
    s = solve(Paid(width=1e-4), Mesh(10))
    assert s.status.value == "check_failed" and s.checks[NAME].passed
    # u is 0.1 all the time: 0.1 are paid, and sqrt(pi) / 100 not seen
    assert s.checks[COST].value == pytest.approx(AREA / 100 / 0.1, rel=0.2)


def test_a_function_that_the_mesh_resolves_passes():
    assert solve(Pushed(width=1.0), Mesh(60)).status.ok
    assert solve(Paid(width=1.0), Mesh(60)).status.ok
