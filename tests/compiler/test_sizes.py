"""How large inputs may be: from the model's own lengths, the same in every face of a causality."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status
from gtmodel.compiler.analysis.sizes import DOUBLE
from gtmodel.compiler.rows import RowFunction

HUGE = (1e5, 1e20, 1e100, 1e300)


class Pressure(gt.Model):
    """A nozzle: no length of its own, so that any size is as good as another."""

    p = gt.input(2, unit="Pa", start=[2e5, 1e5])
    root = gt.variable(unit="Pa", start=1e5)

    def equations(self):
        yield self.root**2 == self.p[0] ** 2 - self.p[1] ** 2


class Crank(gt.Model):
    r = gt.parameter(0.1, unit="m", positive=True)
    rod = gt.parameter(0.3, unit="m", positive=True)
    phi = gt.variable(unit="rad", start=0.6)
    x = gt.variable(unit="m", start=0.35)

    def equations(self):
        yield (self.x - self.r * gt.cos(self.phi)) ** 2 + (self.r * gt.sin(self.phi)) ** 2 == self.rod**2
        yield gt.branch("ahead", self.x - self.r * gt.cos(self.phi))


@pytest.fixture(scope="module")
def fk() -> gt.CausalFunction:
    return gt.robots.gantry_tau("l1_tape").causal("q", "T")


@pytest.mark.parametrize("size", HUGE)
@pytest.mark.parametrize("sign", [1, -1])
def test_huge_places_are_out_of_range_in_every_face(fk: gt.CausalFunction, size: float, sign: int) -> None:
    q = sign * size * np.ones(3)
    assert fk(q)[-1] is Status.OUT_OF_RANGE and "check its unit" in fk.diagnose(q)
    assert RowFunction(fk)(q[None])[-1] == Status.OUT_OF_RANGE
    assert fk.jacobian(q)[-1] is Status.OUT_OF_RANGE
    assert int(fk.casadi(q)[1]) == Status.OUT_OF_RANGE


def test_huge_rates_are_too() -> None:
    robot = gt.robots.gantry_tau("l1_tape")
    T = np.asarray(robot.home, dtype=float)
    for size in HUGE[1:]:
        assert robot.causal("T", "der(q)")(T, [size, 0.0, 0.0])[-1] is Status.OUT_OF_RANGE
        assert robot.causal("T", "tau")(T, np.zeros(3), [0.0, 0.0, size])[-1] is Status.OUT_OF_RANGE
    tau, status = robot.causal("T", "tau")(T, np.zeros(3), [0.0, 0.0, 1e6])  # an impact is none of that
    assert status is Status.OK and np.max(np.abs(tau)) > 1e6


def test_up_to_the_limit_places_keep_their_digits(fk: gt.CausalFunction) -> None:
    """Pushed along the guideways the robot is the same."""
    (limit,) = fk.sizes.limits
    q = np.array([-1.04, -1.14, -1.09])
    here, far = fk(q)[0], fk(q + limit / 2)
    assert far[-1] is Status.OK and np.allclose(far[0] - [limit / 2, 0, 0], here, rtol=0, atol=1e-11)
    assert np.isnan(fk([np.nan, limit * 2, 0.0])[0]).all() and fk([np.nan, limit * 2, 0.0])[-1] is Status.NOT_FINITE


def test_what_has_no_length_of_its_own_has_no_limit_but_the_last() -> None:
    f = Pressure().causal("p", "root")
    assert f.sizes.limits == (DOUBLE.largest,)
    root, status = f([5e9, 3e9])
    assert status is Status.OK and np.isclose(root, 4e9, rtol=1e-14)


def test_an_angle_turns_on() -> None:
    f = Crank().causal("phi", "x")
    turns = 1e5 * 2 * np.pi
    assert f(turns + 0.5)[-1] is Status.OK and np.isclose(f(turns + 0.5)[0], f(0.5)[0], rtol=0, atol=1e-10)


def test_the_limit_grows_with_the_lengths() -> None:
    class Scaled(Crank):
        r = gt.parameter(100.0, unit="m", positive=True)
        rod = gt.parameter(300.0, unit="m", positive=True)
        x = gt.variable(unit="m", start=350.0)

    small, large = (robot().causal("x", "phi").sizes.limits[0] for robot in (Crank, Scaled))
    assert 500 <= large / small <= 2000
