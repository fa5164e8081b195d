"""Events that are easy to miss or to take twice: between rows, at equality, at the resolution of floats."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import gtmodel as gt
from gtmodel.simulation.hybrid.comparisons import dips, first_root

PERIOD = 2 * np.pi


class Oscillator(gt.Model):
    """x = exp(growth t) sin(t), and y that follows x: counts when one of them exceeds a threshold."""

    growth = gt.parameter(0.0)
    threshold = gt.parameter(0.5)
    rate = gt.parameter(1.0)
    of = "x"
    x = gt.variable(start=0.0, fixed=True)
    v = gt.variable(start=1.0, fixed=True)
    y = gt.variable(start=0.0, fixed=True)
    n = gt.discrete(0.0)

    def equations(self):
        yield gt.der(self.x) == self.growth * self.x + self.v
        yield gt.der(self.v) == self.growth * self.v - self.x
        yield gt.der(self.y) == self.rate * (self.x - self.y)
        yield gt.when(getattr(self, self.of) >= self.threshold, self.n == gt.pre(self.n) + 1.0)


class Follower(Oscillator):
    of = "y"


@pytest.mark.parametrize(
    ("step", "threshold"),
    [
        (PERIOD, 0.5), (3 * PERIOD, 0.9999), (5.5, 0.5),
        *(pytest.param(step, threshold, marks=pytest.mark.proof)
          for step, threshold in ((PERIOD, 0.9999), (3 * PERIOD, 0.5), (5.5, 0.9999))),
    ],
)  # fmt: skip
def test_between_rows_that_are_whole_periods_apart(step: float, threshold: float) -> None:
    run = gt.simulate(Oscillator(threshold=threshold), 30 * PERIOD, step=step)
    times = np.array([e.time for e in run.events])
    assert len(times) == 30
    sharp = np.sqrt(1 - threshold**2)  # a flat crossing is found so much worse
    assert np.max(np.abs(times - (np.arcsin(threshold) + PERIOD * np.arange(30)))) < 1e-7 / sharp


@pytest.mark.parametrize(
    ("model", "rate", "late", "tolerance"), [(Oscillator, 1.0, 0.0, 1e-6), (Follower, 1e4, 1e-4, 1e-8)]
)
def test_in_a_long_run_whose_rows_are_whole_periods_apart(
    model: type, rate: float, late: float, tolerance: float
) -> None:
    """The amplitude exceeds the threshold in the last ones of 500 periods; y is stiff."""
    growth, count = 1e-3, 500
    threshold = float(np.exp(growth * (count - 4) * PERIOD))
    run = gt.simulate(model(growth=growth, threshold=threshold, rate=rate), count * PERIOD, tolerance=tolerance)
    begin = PERIOD * np.arange(count - 10, count)
    x = lambda t: np.exp(growth * t) * np.sin(t) - threshold  # noqa: E731
    expected = [brentq(x, t, t + PERIOD / 4) for t in begin if x(t + np.pi / 2) > 0]
    times = np.array([e.time for e in run.events])
    assert len(times) == len(expected) == 4
    # of 3000 rad, the growth, and the slow crossing of the first one
    assert np.max(np.abs(times - late - expected)) < 2e4 * tolerance


class Belt(gt.Model):
    """A mass on a slow belt: sticks for 400 s, slips within 0.3 s."""

    belt = gt.parameter(1e-4)
    x = gt.variable(start=0.0, fixed=True)
    v = gt.variable(start=1e-4, fixed=True)
    F = gt.variable()
    slides = gt.discrete(0.0)

    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == -100.0 * self.x + self.F
        stuck = (self.slides > -0.5) & (self.slides < 0.5)
        yield gt.If(stuck, gt.der(self.v) == 0.0, self.F == -3.0 * self.slides)
        yield gt.when(self.F >= 5.0, self.slides == -1.0)
        yield gt.when(self.F <= -5.0, self.slides == 1.0)
        yield gt.when(self.slides * (self.v - self.belt) <= 0.0, self.slides == 0.0)


def test_a_slip_that_is_a_thousandth_of_what_sticks() -> None:
    run = gt.simulate(Belt(), 1500.0)
    slide = 2 * (np.pi - np.arctan(10 * 0.02 / 1e-4)) / 10
    end = 0.03 + 0.02 * np.cos(10 * slide) + 1e-5 * np.sin(10 * slide)
    stick = (0.05 - end) / 1e-4
    expected = 500.0 + np.cumsum([0.0, slide, stick, slide, stick, slide])
    times = np.array([e.time for e in run.events])
    assert len(times) == len(expected)
    # places are right to the tolerance of 1e-9 m; the belt moves by 1e-4 m/s
    assert np.max(np.abs(times - expected)) < 5e-9 / 1e-4


class Carrier(gt.Model):
    """Compares a fast function of time with a threshold; nothing else of it moves fast."""

    w = gt.parameter(1000.0, unit="rad/s")
    x = gt.variable(start=0.0, fixed=True)
    n = gt.discrete(0.0)

    def equations(self):
        yield gt.der(self.x) == 1.0
        yield gt.when(gt.sin(self.w * self.time) >= 0.9, self.n == gt.pre(self.n) + 1.0)


class Swelling(Carrier):
    top = gt.parameter(unit="s")

    def equations(self):
        yield gt.der(self.x) == 1.0
        yield gt.when(self.time * gt.sin(self.w * self.time) >= self.top, self.n == 1.0)


def test_a_swelling_function_of_time_that_only_a_condition_reads() -> None:
    """Its periods are as long as rows are apart."""
    w = PERIOD / 0.004
    run = gt.simulate(Swelling(w=w, top=0.99), 1.0)
    value = lambda t: t * np.sin(w * t) - 0.99  # noqa: E731
    tops = 0.004 * (np.arange(250) + 0.25)
    expected = [brentq(value, t - 0.001, t, xtol=1e-14) for t in tops if value(t) > 0]
    assert len(expected) == 2
    assert [e.time for e in run.events] == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("start", [0.0, 1000.0])
def test_a_function_of_time_that_only_a_condition_reads(start: float) -> None:
    """From 1000 s on the comparison changes by 1e-10 from one float to the next."""
    run = gt.simulate(Carrier(), start + 0.1, start_time=start)
    n = np.arange(np.ceil((1000 * start - np.arcsin(0.9)) / PERIOD), (1000 * (start + 0.1) - np.arcsin(0.9)) / PERIOD)
    times = np.array([e.time for e in run.events])
    assert len(times) == len(n) == 16
    assert np.max(np.abs(times - (np.arcsin(0.9) + PERIOD * n) / 1000)) < 1e-12 * max(start, 1.0)


class Compared(gt.Model):
    """Counts how often an input reaches 1, how often it falls below, and integrates over the time above."""

    u = gt.input()
    x = gt.variable(start=0.0, fixed=True)
    ups = gt.discrete(0.0)
    downs = gt.discrete(0.0)

    def equations(self):
        yield gt.der(self.x) == gt.If(self.u >= 1.0, 1.0, 0.0)
        yield gt.when(self.u >= 1.0, self.ups == gt.pre(self.ups) + 1.0)
        yield gt.when(self.u < 1.0, self.downs == gt.pre(self.downs) + 1.0)


def test_a_short_pulse_of_an_input() -> None:
    run = gt.simulate(Compared(), 10.0, inputs={"u": lambda t: 2.0 * np.exp(-(((t - 3.33337) / 1e-4) ** 2))})
    half = 1e-4 * np.sqrt(np.log(2.0))
    assert [e.time for e in run.events] == pytest.approx([3.33337 - half, 3.33337 + half], abs=1e-12)


@pytest.mark.parametrize(
    ("kind", "rows", "above", "ups", "downs"),
    [
        ("previous", [0.0, 1.0, 0.0, 1.0, 1.0], 2.0, 2, 1),
        ("previous", [0.0, 1.5, 0.0, 1.5, 1.0], 2.0, 2, 1),
        ("previous", [1.0, 0.0, 0.0, 1.0, 1.0], 2.0, 1, 1),
        ("linear", [0.0, 1.0, 1.0, 0.0, 0.0], 1.0, 1, 1),
        ("linear", [0.0, 1.0, 1.0, 2.0, 2.0], 3.0, 1, 0),
        ("linear", [2.0, 1.0, 1.0, 0.0, 0.0], 2.0, 0, 1),
        ("linear", [1.0, 1.0, 1.0, 1.0, 1.0], 4.0, 0, 0),
    ],
)
def test_an_input_that_rests_at_the_threshold_has_reached_it(
    kind: str, rows: list[float], above: float, ups: int, downs: int
) -> None:
    run = gt.simulate(Compared(), 4.0, inputs={"u": ((np.arange(5.0), np.array(rows)), kind)})
    last = {name: run.trajectory[name][-1] for name in ("x", "ups", "downs")}
    assert last == pytest.approx({"x": above, "ups": ups, "downs": downs}, abs=1e-9)


class Jumps(gt.Model):
    """x jumps by 1 at samples, k too: at the second one both are 2."""

    x = gt.variable(start=0.0, fixed=True)
    k = gt.discrete(0.0)
    reached = gt.discrete([0.0, 0.0])
    beyond = gt.discrete([0.0, 0.0])

    def equations(self):
        yield gt.der(self.x) == 0.0
        yield gt.when(gt.sample(1.0, offset=1.0), gt.reinit(self.x, self.x + 1.0), self.k == gt.pre(self.k) + 1.0)
        sums = self.x, self.k + 0.0 * self.x
        for n, s in enumerate(sums):
            yield gt.when(s >= 2.0, self.reached[n] == self.time)
            yield gt.when(s > 2.0, self.beyond[n] == self.time)


def test_what_jumps_to_a_threshold_has_reached_it_and_not_exceeded_it() -> None:
    run = gt.simulate(Jumps(), 4.5)
    assert run.trajectory["reached"][-1] == pytest.approx([2.0, 2.0])
    assert run.trajectory["beyond"][-1] == pytest.approx([3.0, 3.0])


class Chain(gt.Model):
    """An event that leads to the next one, forty times."""

    x = gt.variable(start=0.0, fixed=True)
    n = gt.discrete(np.zeros(40))

    def equations(self):
        yield gt.der(self.x) == 1.0
        yield gt.when(self.x >= 0.5, self.n[0] == 1.0)
        for k in range(39):
            yield gt.when(self.n[k] >= 0.5, self.n[k + 1] == self.n[k] + 1.0)


def test_a_long_chain_of_events_settles() -> None:
    (event,) = gt.simulate(Chain(), 1.0).events
    assert event.discrete["n[39]"] == (0.0, 40.0)


class AntiWindup(gt.Model):
    """A PI law whose integral waits while its output is at a limit that the error pushes it to."""

    y = gt.variable(start=0.0, fixed=True)
    integral = gt.variable(start=0.0, fixed=True)
    u = gt.variable()
    r = gt.input()

    def equations(self):
        e = self.r - self.y
        w = 2.0 * e + self.integral
        yield gt.der(self.y) == self.u - self.y
        yield self.u == gt.If(w >= 1.0, 1.0 + 0.0 * w, gt.If(w <= -1.0, -1.0 + 0.0 * w, w))
        yield gt.der(self.integral) == gt.If(((w >= 1.0) & (e >= 0.0)) | ((w <= -1.0) & (e <= 0.0)), 0.0 * e, 1.5 * e)


def test_several_comparisons_that_an_input_changes_at_once() -> None:
    from scipy.integrate import solve_ivp

    rows = np.array([0.8, -0.9, 0.3, 2.0, 0.1, 0.1])
    run = gt.simulate(AntiWindup(), 10.0, inputs={"r": ((2.0 * np.arange(6), rows), "previous")})

    def rate(_: float, s: np.ndarray, r: float) -> list[float]:
        e, w = r - s[0], 2 * (r - s[0]) + s[1]
        return [np.clip(w, -1, 1) - s[0], 0.0 if (w >= 1 and e >= 0) or (w <= -1 and e <= 0) else 1.5 * e]

    s = np.zeros(2)
    for r in rows[:5]:
        s = solve_ivp(rate, (0, 2), s, args=(r,), rtol=1e-10, atol=1e-11, max_step=2e-3, method="DOP853").y[:, -1]
    assert [run.trajectory[n][-1] for n in ("y", "integral")] == pytest.approx(s, abs=1e-6)


@pytest.mark.parametrize(("rate", "dips_there"), [(1e-3, True), (1e-15, False)])
def test_a_dip_within_round_off_is_none(rate: float, dips_there: bool) -> None:
    """A force that stays at its threshold dips below it by the last bit: an event at one instant for ever."""
    share = dips(np.ones(1), np.zeros((2, 1)), np.array([[-rate], [rate]]), np.full(1, 1e-13))
    assert np.isfinite(share).all() == dips_there
    assert not dips_there or share == pytest.approx(0.5)


@pytest.mark.parametrize(("value", "root", "most"), [
    (lambda t: (-t, -1.0), 0.0, 4),
    (lambda t: (-t - 0.3 * t**2, -1.0 - 0.6 * t), 0.0, 10),
    (lambda t: (t * (0.2 - t), 0.2 - 2 * t), 0.2, 20),
    (lambda t: (-np.sin(9 * t), -9 * np.cos(9 * t)), 2 * np.pi / 9, 20),
])  # fmt: skip
def test_what_falls_at_once_is_seen_to_in_a_few_looks(value: Any, root: float, most: int) -> None:
    """A comparison that was zero and fell was looked at in forty places, ever nearer to its begin."""
    looks: list[float] = []

    def signed(t: float) -> tuple[np.ndarray, np.ndarray]:
        looks.append(t)
        v, rate = value(t)
        return np.array([v]), np.array([rate])

    assert first_root(signed, 0, 0.0, 0.8) == pytest.approx(root, abs=1e-12)
    assert len(looks) <= most
