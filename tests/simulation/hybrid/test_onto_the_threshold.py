"""Events that end exactly at their own threshold, and modes of very different stiffness that meet there."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel import der

# of the simulation's tolerance of 1e-6 per step, which may add over some hundred steps
CLOSE = 1e-4
PAIRS = [(ron, goff) for ron in (1e-3, 1e-4, 1e-5) for goff in (1e-4, 1e-5, 1e-6)]
FAILED_BEFORE = [(1e-4, 1e-6), (1e-5, 1e-6)]


class Belt(gt.Model):
    """A mass on a moving belt, which sticks until the spring pulls with `hold`, then slides under `slide`."""

    m = gt.parameter(1.3)
    k = gt.parameter(100.0)
    vb = gt.parameter(0.1)
    hold = gt.parameter(2.0)
    slide = gt.parameter(1.0)
    x = gt.variable(start=0.0, fixed=True)
    v = gt.variable(start=0.1, fixed=True)
    stuck = gt.discrete(1.0)

    def equations(self):
        force = gt.If(self.stuck > 0.5, self.k * self.x, self.slide)
        yield der(self.x) == self.v
        yield self.m * der(self.v) == force - self.k * self.x
        yield gt.when((self.stuck > 0.5) & (self.k * self.x > self.hold), self.stuck == 0.0)
        yield gt.when((self.stuck < 0.5) & (self.v > self.vb), self.stuck == 1.0, gt.reinit(self.v, self.vb))


def test_a_state_set_onto_the_threshold_is_not_beyond_it():
    p = {"m": 1.3, "k": 100.0, "vb": 0.1, "hold": 2.0, "slide": 1.0}
    run = Belt(**p).simulate(8.0)
    # sliding is harmonic about slide / k: from x to its mirror image, with the same speed
    w, far = np.sqrt(p["k"] / p["m"]), (p["hold"] - p["slide"]) / p["k"]
    slides = (2 * np.pi - 2 * np.arctan(w * far / p["vb"])) / w
    sticks = 2 * far / p["vb"]
    first = p["hold"] / p["k"] / p["vb"]
    expected = [first + n * (slides + sticks) + late for n in range(20) for late in (0.0, slides)]
    expected = [t for t in expected if t < 8.0]
    assert [e.time for e in run.events] == pytest.approx(expected, rel=CLOSE)


class Rectifier(gt.Model):
    Ron = gt.parameter(1e-3)
    Goff = gt.parameter(1e-4)
    w = gt.parameter(100 * np.pi, unit="rad/s")
    s = gt.variable(start=0.0)
    vd = gt.variable()
    i = gt.variable(start=0.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield self.vd == self.s * gt.If(self.s < 0, 1.0, self.Ron)
        yield self.i == self.s * gt.If(self.s < 0, self.Goff, 1.0)
        yield 10 * gt.sin(self.w * self.time) == 10 * self.i + 1e-3 * der(self.i) + self.vd + self.v
        yield 1e-4 * der(self.v) == self.i - self.v / 100


def rectified(ron: float, goff: float, time: float) -> float:
    """The voltage at the load by an integrator that knows of no events: the resistance changes with the current's
    sign, where its voltage is continuous."""

    def rates(t: float, y: np.ndarray) -> list[float]:
        i, v = y
        drop = i * (ron if i >= 0 else 1 / goff)
        return [(10 * np.sin(100 * np.pi * t) - 10 * i - drop - v) / 1e-3, (i - v / 100) / 1e-4]

    run = scipy.integrate.solve_ivp(rates, (0, time), [0, 0], "Radau", rtol=1e-8, atol=1e-11, max_step=1e-4)
    return float(run.y[1, -1])


@pytest.mark.parametrize(
    ("ron", "goff"), [p if p in FAILED_BEFORE else pytest.param(*p, marks=pytest.mark.proof) for p in PAIRS]
)
def test_a_diode_of_stiff_modes_goes_on_in_the_mode_that_its_current_wants(ron: float, goff: float):
    run = Rectifier(Ron=ron, Goff=goff).simulate(0.1)
    assert len(run.events) == 9
    assert run.trajectory["v"][-1] == pytest.approx(rectified(ron, goff, 0.1), rel=CLOSE)


class Pushed(gt.Model):
    """Both sides push back to x = 0, and nothing rubs."""

    x = gt.variable(start=0.5, fixed=True)

    def equations(self):
        yield der(self.x) == gt.If(self.x > 0, -1.0, 1.0)


def test_advice_on_friction_only_where_there_is_friction():
    run = Pushed().simulate(1.0, throw=False)
    assert not run.status.ok
    assert not any(word in run.message for word in ("friction", "stuck", "sliding"))
