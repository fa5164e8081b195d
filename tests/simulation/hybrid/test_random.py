"""Random small models whose pieces are known: each instant against its closed form, where instants are awkward."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.optimize import brentq

import gtmodel as gt

INSTANT = 1e-9


class Saw(gt.Model):
    """Rises at its rate, and falls to zero at its height."""

    rate = gt.parameter(1.0)
    height = gt.parameter(1.0)
    x = gt.variable(start=0.0)
    n = gt.discrete(0.0)

    def equations(self):
        yield gt.der(self.x) == self.rate
        yield gt.when(self.x >= self.height, gt.reinit(self.x, 0.0), self.n == gt.pre(self.n) + 1.0)


class Saws(gt.Model):
    """Three of them."""

    saw = gt.parts(3, Saw)


@pytest.mark.parametrize("seed", range(6))
def test_nested_saws_meet_at_rows_and_at_each_other(seed: int) -> None:
    # rates and heights of small whole numbers: many teeth end together, at rows, and at the end
    rng = np.random.default_rng(seed)
    rates, heights = rng.integers(1, 5, 3).astype(float), rng.integers(1, 4, 3).astype(float)
    begin = float(rng.integers(0, 3))
    values = {f"saw[{k}].{name}": v for k in range(3) for name, v in (("rate", rates[k]), ("height", heights[k]))}
    start = {f"saw[{k}].x": 0.0 for k in range(3)}
    run = gt.simulate(Saws(), begin + 7.0, start_time=begin, parameters=values, start=start, step=0.25)
    teeth = [h / r * np.arange(1, 1 + int(np.floor(7.0 * r / h + 1e-9))) for r, h in zip(rates, heights, strict=True)]
    expected = np.unique(np.round(np.concatenate(teeth), 10)) + begin
    assert [e.time for e in run.events] == pytest.approx(expected, abs=INSTANT)
    for k in range(3):
        assert run.trajectory[f"saw[{k}].n"][-1] == len(teeth[k])
    assert np.all(np.diff(run.trajectory.time) > 0)


class Halves(gt.Model):
    """An oscillator whose stiffness differs on both sides of zero."""

    k = gt.parameter([1.0, 1.0])
    x = gt.variable(start=1.0)
    v = gt.variable(start=0.0)

    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == -gt.If(self.x >= 0.0, self.k[0], self.k[1]) * self.x


@pytest.mark.parametrize("seed", range(6))
def test_an_oscillator_of_two_stiffnesses_from_anywhere(seed: int) -> None:
    rng = np.random.default_rng(seed)
    k = rng.uniform(1.0, 50.0, 2)
    # the last ones begin on the switch itself, one way and the other
    x, v = (0.0, rng.choice([-1.0, 1.0])) if seed > 3 else rng.normal(size=2)
    run = gt.simulate(Halves(), 6.0, parameters={"k": k}, start={"x": x, "v": v})
    half = np.pi / np.sqrt(k)
    side = 0 if x > 0 or (x == 0 and v > 0) else 1
    w = np.sqrt(k[side])
    sign = 1.0 if side == 0 else -1.0
    phase = np.arctan2(sign * w * x, sign * v)  # of sin(w t + phase)
    times = [(np.pi - phase) / w]
    while times[-1] < 6.0:
        side = 1 - side
        times.append(times[-1] + half[side])
    assert [e.time for e in run.events] == pytest.approx(times[:-1], abs=1e-7)


class Relay(gt.Model):
    """Along a table of slopes, between two levels."""

    h = gt.parameter(1e-6)
    u = gt.input()
    x = gt.variable(start=0.0)
    s = gt.discrete(1.0)

    def equations(self):
        yield gt.der(self.x) == self.u * self.s
        yield gt.when(self.x >= self.h, self.s == -1.0)
        yield gt.when(self.x <= -self.h, self.s == 1.0)


@pytest.mark.parametrize("h", [1e-9, 1e-6, 1e-3])
def test_a_tiny_hysteresis_is_kept(h: float) -> None:
    run = gt.simulate(Relay(), 100.0 * h, parameters={"h": h}, inputs={"u": 1.0}, start={"x": 0.0}, throw=False)
    expected = h + 2 * h * np.arange(50)
    assert [e.time for e in run.events] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_a_table_that_jumps_at_events_and_elsewhere(seed: int) -> None:
    # whole numbers: events fall on knots of the table, and beside them
    rng = np.random.default_rng(seed)
    knots = np.concatenate([[0.0], np.sort(rng.choice(np.arange(1, 40), 12, replace=False)) / 4, [10.0]])
    slopes = rng.integers(1, 5, len(knots)).astype(float)
    run = gt.simulate(
        Relay(), 10.0, parameters={"h": 1.0}, inputs={"u": ((knots, slopes), "previous")}, start={"x": 0.0}, step=0.5
    )
    # the way travelled decides: it turns at 1, 3, 5, ...
    way = np.concatenate([[0.0], np.cumsum(np.diff(knots) * slopes[:-1])])
    turns = np.arange(1.0, way[-1] + 1e-9, 2.0)
    assert [e.time for e in run.events] == pytest.approx(np.interp(turns, way, knots), abs=INSTANT)
    # x after that way, up and down between -1 and 1
    assert run.trajectory["x"][-1] == pytest.approx(1 - abs((way[-1] + 1) % 4 - 2), abs=1e-8)


class Implicit(gt.Model):
    """A quantity that Newton finds, y + sin(y) / 2 = x, decides."""

    x = gt.variable(start=0.0)
    y = gt.variable(start=0.0)
    rate = gt.parameter(1.0)
    s = gt.discrete(1.0)

    def equations(self):
        yield gt.der(self.x) == self.rate * self.s
        yield self.y + 0.5 * gt.sin(self.y) == self.x
        yield gt.when(self.y >= 1.0, self.s == -1.0)
        yield gt.when(self.y <= -1.0, self.s == 1.0)


@pytest.mark.parametrize("rate", [0.3, 1.0, 7.0])
def test_what_newton_finds_decides_on_events(rate: float) -> None:
    top = 1.0 + 0.5 * np.sin(1.0)
    run = gt.simulate(Implicit(), 11 * top / rate, parameters={"rate": rate}, start={"x": 0.0})
    assert [e.time for e in run.events] == pytest.approx(top / rate * np.arange(1, 12, 2), abs=1e-8)


class Late(gt.Model):
    """An event right after the start, one of several kinds at once, and what they lead to."""

    eps = gt.parameter(1e-9)
    x = gt.variable(2, start=[0.0, 0.0])
    a = gt.discrete(0.0)
    b = gt.discrete([0.0, 0.0])

    def equations(self):
        yield gt.der(self.x) == [1.0 + self.b[0], 1.0]
        yield gt.when(self.x[0] >= self.eps, self.a == 1.0)
        yield gt.when(self.a >= 0.5, self.b == [2.0, gt.pre(self.b[1]) + 1.0])
        yield gt.when((self.b[1] >= 1.0) & (self.x[1] >= 1.0), gt.reinit(self.x[1], -1.0), self.a == 0.0)


@pytest.mark.parametrize("eps", [1e-14, 1e-13, 1e-11, 1e-9, 1e-6])
def test_right_after_the_start(eps: float) -> None:
    run = gt.simulate(Late(), 2.5, parameters={"eps": eps}, start={"x": [0.0, 0.0]})
    assert [e.time for e in run.events] == pytest.approx([eps, 1.0], abs=INSTANT)
    assert run.trajectory["b"][-1].tolist() == [2.0, 1.0]
    assert run.trajectory["x"][-1] == pytest.approx([3 * 2.5 - 2 * eps, 0.5], abs=1e-8)


class Spinning(gt.Model):
    """A pendulum in Cartesian coordinates that goes over the top: its states switch, and each turn is counted."""

    x = gt.variable(unit="m", start=0.0)
    y = gt.variable(unit="m", start=-1.0)
    L = gt.parameter(1.0, unit="m", positive=True)
    pull = gt.variable(unit="1/s2")
    turns = gt.discrete(0.0)

    def equations(self):
        yield self.x**2 + self.y**2 == self.L**2
        yield gt.der(self.x, 2) == -self.pull * self.x
        yield gt.der(self.y, 2) == -self.pull * self.y
        yield gt.when((self.x >= 0) & (self.y <= 0), self.turns == gt.pre(self.turns) + 1.0)
        yield gt.when(self.turns >= 3.0, self.turns == 0.0)


@pytest.mark.parametrize("begin", [0.0, -2.0, 1000.0])
def test_events_between_changes_of_states(begin: float) -> None:
    run = gt.simulate(Spinning(), begin + 5.0, start_time=begin, start={"x": 0.6, "y": -0.8, "der(x)": 0.8 * 7})
    assert run.switches
    # without gravity it turns by 7 rad/s; at the bottom its angle is zero
    angle = np.arctan2(0.6, 0.8)
    times = (2 * np.pi * np.arange(1, 7) - angle) / 7
    times = times[times < 5.0]
    assert [e.time - begin for e in run.events] == pytest.approx(times, abs=1e-7)
    assert run.trajectory["turns"][-1] == len(times) % 3


def test_one_model_in_several_threads() -> None:
    model = Relay()

    def times(h: float) -> list[float]:
        run = gt.simulate(model, 5.0, parameters={"h": h}, inputs={"u": 1.0}, start={"x": 0.0})
        return [e.time for e in run.events]

    heights = [0.1, 0.2, 0.3, 0.4]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(times, heights))
    assert together == [times(h) for h in heights]


def test_growth_between_thresholds_of_a_vector() -> None:
    class Cells(gt.Model):
        """Each cell grows exponentially and divides when it is large."""

        growth = gt.parameter([1.0, 1.5, 2.0, 2.5])
        m = gt.variable(4, start=[1.0, 1.1, 1.2, 1.3])
        total = gt.discrete(0.0)

        def equations(self):
            for k in range(4):
                yield gt.der(self.m[k]) == self.growth[k] * self.m[k]
                yield gt.when(self.m[k] >= 2.0, gt.reinit(self.m[k], 1.0))

    class Counted(Cells):
        def equations(self):
            yield from super().equations()
            yield gt.when(gt.sample(0.5), self.total == self.m[0] + self.m[1] + self.m[2] + self.m[3])

    run = gt.simulate(Counted(), 4.0, start={"m": [1.0, 1.1, 1.2, 1.3]})
    g, m0 = np.array([1.0, 1.5, 2.0, 2.5]), np.array([1.0, 1.1, 1.2, 1.3])
    expected = [np.arange(1, 20) * np.log(2) / a - np.log(m) / a for a, m in zip(g, m0, strict=True)]
    times = np.sort(np.concatenate([t[t < 4.0] for t in expected]))
    divided = [e.time for e in run.events if e.restarted]
    assert divided == pytest.approx(times, abs=1e-8)
    share = (np.log(m0) + g * 4.0) / np.log(2)
    assert run.trajectory["total"][-1] == pytest.approx(np.sum(2 ** (share - np.floor(share))), abs=1e-7)


def test_the_first_of_several_thresholds_on_one_curve() -> None:
    class Ladder(gt.Model):
        """x = sin(w t) passes levels that lie close together, up and down."""

        x = gt.variable(start=0.0)
        w = gt.parameter(3.0, unit="rad/s")
        up = gt.discrete([0.0] * 5)

        def equations(self):
            yield gt.der(self.x) == 3.0 * gt.cos(self.w * self.time)
            for k in range(5):
                level = 0.5 + 1e-7 * k
                yield gt.when(self.x >= level, self.up[k] == gt.pre(self.up[k]) + 1.0)

    run = gt.simulate(Ladder(), 6.0, tolerance=1e-12, start={"x": 0.0})
    levels = 0.5 + 1e-7 * np.arange(5)
    times = np.sort(np.concatenate([(np.arcsin(levels) + 2 * np.pi * n) / 3 for n in range(3)]))
    assert [e.time for e in run.events] == pytest.approx(times, abs=1e-9)
    assert brentq(lambda t: np.sin(3 * t) - 0.5, 0.0, 0.3) == pytest.approx(run.events[0].time, abs=1e-9)
