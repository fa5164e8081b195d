"""Consistent points of equations with roots and logarithms: steps and draws stay where these have numbers."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der

TANKS = 8


class Cascade(gt.Model):
    """Tanks with outflows by Torricelli's law, one into the next; the levels are to be found."""

    c = gt.parameter(np.linspace(0.3, 1.0, TANKS))
    h = gt.variable(TANKS)
    Q = gt.variable(start=0.3)
    total = gt.variable()

    def equations(self):
        for k in range(TANKS):
            yield self.c[k] * gt.sqrt(self.h[k]) == self.Q + 0.1 * k
        yield self.total == sum(self.h[k] for k in range(TANKS))


class StartedCascade(Cascade):
    """The same with start values that lie far above."""

    h = gt.variable(TANKS, start=[4.0] * TANKS)
    total = gt.variable(start=32.0)


@pytest.mark.parametrize("model", [Cascade, StartedCascade])
def test_levels_by_their_roots(model: type[gt.Model]):
    f = model().causal(known="Q", targets=["h", "total"])
    for Q in (0.0, 0.02, 0.5, 3.0):
        expected = ((Q + 0.1 * np.arange(TANKS)) / np.linspace(0.3, 1.0, TANKS)) ** 2
        h, total, status = f(Q)
        if Q == 0.0:  # the edge of the domain: an answer or a status, never another number
            assert status is not gt.Status.OK or h == pytest.approx(expected, abs=1e-9)
            continue
        assert status is gt.Status.OK
        assert h == pytest.approx(expected, rel=1e-9) and total == pytest.approx(expected.sum(), rel=1e-9)


class Valve(gt.Model):
    """A logarithm and a root of what is unknown, with one solution; z is of no concern."""

    z0 = gt.parameter(1.0)
    p = gt.variable(start=3.0)
    y = gt.variable()
    z = gt.variable(start=1.0)
    u = gt.variable(start=2.5)

    def equations(self):
        yield gt.log(self.p) + self.y == -3 + self.u
        yield gt.sqrt(self.y) == 0.1 + self.p
        yield self.z == self.z0 * (self.p + self.y)


class ValveWithoutStart(Valve):
    z = gt.variable()


def test_an_irrelevant_start_value_refuses_nothing():
    found = []
    for model in (Valve, ValveWithoutStart):
        p, y, status = model().causal(known="u", targets=["p", "y"])(2.5)
        assert status is gt.Status.OK
        assert np.log(p) + y == pytest.approx(-0.5, abs=1e-11) and np.sqrt(y) == pytest.approx(0.1 + p, abs=1e-11)
        found.append((p, y))
    np.testing.assert_allclose(*found, rtol=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_drawn_powers_and_roots(seed: int):
    """Monotone equations of a root or a logarithm have one solution, from wherever one starts."""
    rng = np.random.default_rng(seed)
    start, solution, scale = 10.0 ** rng.uniform(-1, 3), 10.0 ** rng.uniform(-3, 0), 10.0 ** rng.uniform(-1, 1)
    function = (gt.sqrt, gt.log)[seed % 2]
    of = (np.sqrt, np.log)[seed % 2]

    class Monotone(gt.Model):
        x = gt.variable(start=start)
        u = gt.variable(start=float(of(solution) + scale * solution**3))

        def equations(self):
            yield function(self.x) + scale * self.x**3 == self.u

    x, status = Monotone().causal(known="u", targets="x")(of(solution) + scale * solution**3)
    assert status is gt.Status.OK and x == pytest.approx(solution, rel=1e-8)


class Draining(gt.Model):
    h = gt.variable(start=1.0, fixed=True)
    v = gt.variable(start=50.0)

    def equations(self):
        yield gt.sqrt(self.v) == 0.1 * self.h
        yield der(self.h) == -self.v

    # 1 / h(t) - 1 / h(0) = 0.01 t


def test_a_simulation_starts_from_a_guess_far_above():
    run = gt.simulate(Draining(), 100.0)
    assert run.trajectory["h"][-1] == pytest.approx(0.5, rel=1e-6)
