"""Models with events against their exact piecewise solutions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import gtmodel as gt

# instants of closed forms, integrated to a hundredth of 1e-9 of polynomials that the method solves exactly
INSTANT = 1e-10
# instants and states of motions that the integrator's tolerance of 1e-9 decides on
TOLERANCE = 1e-9


class Ball(gt.Model):
    """Falls from 1 m and bounces; the loss of each impact is declared."""

    m = gt.parameter(2.0, unit="kg")
    g = gt.parameter(9.81, unit="m/s2")
    e = gt.parameter(0.8)
    h = gt.variable(unit="m", start=1.0, fixed=True)
    v = gt.variable(unit="m/s", start=0.0, fixed=True)
    bounces = gt.discrete(0.0)

    def equations(self):
        yield gt.der(self.h) == self.v
        yield gt.der(self.v) == -self.g
        yield gt.energy(stored=self.m / 2 * self.v**2 + self.m * self.g * self.h)
        yield gt.when(
            self.h <= 0.0,
            gt.reinit(self.v, -self.e * self.v),
            self.bounces == gt.pre(self.bounces) + 1.0,
            gt.energy_loss((1 - self.e**2) * self.m / 2 * self.v**2),
        )


def bounce_times(count: int, e: float = 0.8) -> np.ndarray:
    speed, first = np.sqrt(2 * 9.81), np.sqrt(2 / 9.81)
    return first + np.concatenate([[0.0], np.cumsum(2 * speed / 9.81 * e ** np.arange(1, count))])


def test_a_bouncing_ball_bounces_when_it_should() -> None:
    run = gt.simulate(Ball(), 3.5)
    times = np.array([e.time for e in run.events])
    assert len(times) == 9
    assert np.max(np.abs(times - bounce_times(9))) < INSTANT
    assert run.checks["declared_loss"].value < TOLERANCE
    assert run.checks["energy_balance"].value < TOLERANCE
    assert run.trajectory["bounces"][-1] == 9.0
    # both sides of an impact are rows of their own
    at = int(np.searchsorted(run.trajectory.time, times[0]))
    assert run.trajectory["v"][at] < 0 < run.trajectory["v"][at + 1]
    assert run.trajectory["v"][at + 1] == pytest.approx(-0.8 * run.trajectory["v"][at], rel=1e-15)


def test_the_instant_at_which_bounces_accumulate_is_found_and_said() -> None:
    run = gt.simulate(Ball(), 5.0, throw=False)
    speed = np.sqrt(2 * 9.81)
    end = np.sqrt(2 / 9.81) + 2 * 0.8 * speed / (9.81 * (1 - 0.8))
    assert run.status is gt.SolveStatus.FAILED
    assert "accumulate at 4.0637" in run.message
    assert run.accumulation == pytest.approx(end, abs=INSTANT)
    times = np.array([e.time for e in run.events])
    assert np.max(np.abs(times - bounce_times(len(times)))) < INSTANT
    with pytest.raises(gt.NotSimulated):
        gt.simulate(Ball(), 5.0)


class Twisting(gt.Model):
    """Switched by the signs of place and speed: turns around zero infinitely often in finite time."""

    x = gt.variable(start=1.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == -gt.sign(self.x) - 0.5 * gt.sign(self.v)


def test_events_that_take_turns_accumulate_too() -> None:
    run = gt.simulate(Twisting(), 20.0, throw=False)
    # 2 s at 0.5 m/s2 to zero, 2/3 s at 1.5 m/s2 to rest, at a third of the distance: the same at sqrt(1/3) of the times
    end = (2 + 2 / 3) / (1 - np.sqrt(1 / 3))
    assert run.status is gt.SolveStatus.FAILED
    assert "accumulate at 6.309" in run.message
    assert run.accumulation == pytest.approx(end, abs=1e-8)


@pytest.mark.parametrize("count", [100, pytest.param(1000, marks=pytest.mark.proof)])
def test_hundreds_of_events_do_not_drift(count: int) -> None:
    period = 2 * np.sqrt(2 / 9.81)
    run = gt.simulate(Ball(e=1.0), (count + 0.2) * period, step=period)
    times = np.array([e.time for e in run.events])
    assert len(times) == count
    # the rounding of each bounce adds up at most linearly
    assert np.max(np.abs(times - (period / 2 + period * np.arange(count)))) < count * 1e-11
    assert max(abs(e.energy) for e in run.events) < TOLERANCE
    assert run.energy_error is not None
    assert run.energy_error < TOLERANCE * 2.0 * 9.81


class Belt(gt.Model):
    """A mass on a belt, held by a spring; static friction above the kinetic one."""

    m = gt.parameter(1.0, unit="kg")
    k = gt.parameter(100.0, unit="N/m")
    belt = gt.parameter(0.1, unit="m/s")
    static = gt.parameter(5.0, unit="N")
    kinetic = gt.parameter(3.0, unit="N")
    x = gt.variable(unit="m", start=0.0, fixed=True)
    v = gt.variable(unit="m/s", start=0.1, fixed=True)
    F = gt.variable(unit="N")
    slides = gt.discrete(0.0)

    def equations(self):
        yield gt.der(self.x) == self.v
        yield self.m * gt.der(self.v) == -self.k * self.x + self.F
        stuck = (self.slides > -0.5) & (self.slides < 0.5)
        yield gt.If(stuck, gt.der(self.v) == 0.0, self.F == -self.slides * self.kinetic)
        yield gt.when(self.F >= self.static, self.slides == -1.0)
        yield gt.when(self.F <= -self.static, self.slides == 1.0)
        yield gt.when(self.slides * (self.v - self.belt) <= 0.0, self.slides == 0.0)


def belt_exactly(count: int) -> list[float]:
    """Instants of slip, stick, slip, ... and the mass's place at each stick is that of a harmonic about F/k."""
    w, stretched, rest = 10.0, 0.05, 0.03
    # v falls back to the belt's speed where tan(w t / 2) = -w (stretched - rest) / v0
    slide = 2 * (np.pi - np.arctan(w * (stretched - rest) / 0.1)) / w
    end = rest + (stretched - rest) * np.cos(w * slide) + 0.1 / w * np.sin(w * slide)
    times = [stretched / 0.1]
    while len(times) < count:
        times.append(times[-1] + slide)
        times.append(times[-1] + (stretched - end) / 0.1)
    return times[:count]


def test_stick_slip_on_a_belt() -> None:
    run = gt.simulate(Belt(), 5.0)
    times = [e.time for e in run.events]
    assert len(times) == 12
    assert np.max(np.abs(np.array(times) - belt_exactly(12))) < TOLERANCE
    stuck = run.trajectory["slides"] == 0.0
    assert np.max(np.abs(run.trajectory["v"][stuck] - 0.1)) < 1e-12


class Relay(gt.Model):
    """x' = -x + u, with u = -1 above h and 1 below -h."""

    x = gt.variable(start=0.0, fixed=True)
    u = gt.discrete(1.0)
    h = gt.parameter(0.5)

    def equations(self):
        yield gt.der(self.x) == -self.x + self.u
        yield gt.when(self.x >= self.h, self.u == -1.0)
        yield gt.when(self.x <= -self.h, self.u == 1.0)


@pytest.mark.parametrize("h", [0.02, 0.5, 0.9])
def test_the_limit_cycle_of_a_relay(h: float) -> None:
    half = np.log((1 + h) / (1 - h))
    run = gt.simulate(Relay(h=h), 12.3 * half)
    times = np.array([e.time for e in run.events])
    assert len(times) == 12
    assert np.max(np.abs(np.diff(times) - half)) < 1e-8
    assert np.max(np.abs(times - (-np.log(1 - h) + half * np.arange(12)))) < 1e-8


class Disc(gt.Model):
    """A cylinder pushed at its axle ever harder: rolls, and slips when its friction cannot follow."""

    m = gt.parameter(2.0, unit="kg")
    r = gt.parameter(0.5, unit="m")
    mu = gt.parameter(0.3)
    g = gt.parameter(9.81, unit="m/s2")
    growth = gt.parameter(10.0, unit="N/s")
    v = gt.variable(unit="m/s", start=0.0, fixed=True)
    w = gt.variable(unit="rad/s", start=0.0, fixed=True)
    f = gt.variable(unit="N")
    slips = gt.discrete(0.0)

    def equations(self):
        limit = self.mu * self.m * self.g
        yield self.m * gt.der(self.v) == self.growth * self.time - self.f
        yield self.m * self.r**2 / 2 * gt.der(self.w) == self.f * self.r
        yield gt.If(self.slips < 0.5, gt.der(self.v) == self.r * gt.der(self.w), self.f == limit)
        yield gt.when(self.f >= limit, self.slips == 1.0)


def test_a_disc_that_begins_to_slip() -> None:
    run = gt.simulate(Disc(), 3.0)
    limit = 0.3 * 2.0 * 9.81
    begin = 3 * limit / 10.0  # a third of the push turns the cylinder
    (event,) = run.events
    assert event.time == pytest.approx(begin, abs=INSTANT)
    v = 10.0 * begin**2 / (3 * 2.0) + (10.0 * (9.0 - begin**2) / 2 - limit * (3.0 - begin)) / 2.0
    w = (10.0 * begin**2 / (3 * 2.0) + 2 * limit / 2.0 * (3.0 - begin)) / 0.5
    assert run.trajectory["v"][-1] == pytest.approx(v, abs=TOLERANCE)
    assert run.trajectory["w"][-1] == pytest.approx(w, abs=TOLERANCE)


class Bridge(gt.Model):
    """Four ideal diodes, a capacitor and a load behind a source with a resistance."""

    R = gt.parameter(1.0, unit="Ohm")
    C = gt.parameter(1.0, unit="F")
    load = gt.parameter(10.0, unit="Ohm")
    U = gt.parameter(10.0, unit="V")
    w = gt.parameter(1.0, unit="rad/s")
    a = gt.variable(unit="V")
    b = gt.variable(unit="V")
    n = gt.variable(unit="V")
    i = gt.variable(unit="A")
    v = gt.variable(unit="V", start=0.0, fixed=True)
    i_d = gt.variable(4, unit="A")

    def equations(self):
        yield self.a - self.b == self.U * gt.sin(self.w * self.time) - self.R * self.i
        yield self.a + self.b - 2 * self.n == self.v  # the source floats in the middle of the load
        yield self.n == 0.0
        forward = [self.a - self.n - self.v, self.b - self.n - self.v, self.n - self.a, self.n - self.b]
        yield self.i == self.i_d[0] - self.i_d[2]
        yield self.C * gt.der(self.v) == self.i_d[0] + self.i_d[1] - self.v / self.load
        # the pairs a and b conduct together: what goes out of one comes back through the other
        yield self.i_d[3] == self.i_d[0]
        yield self.i_d[2] == self.i_d[1]
        for k in range(2):
            yield gt.If(forward[k] + self.R * self.i_d[k] >= 0.0, forward[k] == 0.0, self.i_d[k] == 0.0)


def test_a_diode_bridge() -> None:
    run = gt.simulate(Bridge(), 9.0)
    times = np.array([e.time for e in run.events])

    # exact: blocked, v decays over the load; conducting, R C v' = |u| - v (1 + R / load)
    def conducting(t: float, t0: float, v0: float) -> float:
        a = 1.1
        s = np.sign(np.sin(t0 + 1e-9))
        particular = lambda x: s * 10.0 * (a * np.sin(x) - np.cos(x)) / (a**2 + 1)  # noqa: E731
        return particular(t) + (v0 - particular(t0)) * np.exp(-a * (t - t0))

    t, v, expected = 0.0, 0.0, []
    while len(expected) < len(times):
        top = np.pi * (np.floor(t / np.pi) + 1)
        stop = brentq(lambda x, t=t, v=v: abs(10 * np.sin(x)) - conducting(x, t, v), t + 1e-3, top, xtol=1e-14)
        v = conducting(stop, t, v)
        first = np.pi * np.ceil(stop / np.pi)
        begin = brentq(
            lambda x, stop=stop, v=v: abs(10 * np.sin(x)) - v * np.exp(-(x - stop) / 10), first, first + 1.5, xtol=1e-14
        )
        v = v * np.exp(-(begin - stop) / 10)
        t = begin
        expected += [stop, begin]
    assert len(times) == 5
    assert np.max(np.abs(times - expected[: len(times)])) < 1e-8


class Pair(gt.Model):
    """Two counters reach zero at one instant, whatever their speeds; then both begin anew."""

    x = gt.variable(2, start=[1.0, 2.0], fixed=True)
    n = gt.discrete([0.0, 0.0])

    def equations(self):
        yield gt.der(self.x) == [-1.0, -2.0]
        yield gt.when(self.x[0] <= 0, self.n[0] == gt.pre(self.n[0]) + 1)
        yield gt.when(self.x[1] <= 0, self.n[1] == gt.pre(self.n[1]) + 1)
        yield gt.when((self.n[0] >= 1) & (self.n[1] >= 1), gt.reinit(self.x, [1.0, 2.0]), self.n == [0.0, 0.0])


def test_two_events_at_one_instant_are_one() -> None:
    run = gt.simulate(Pair(), 3.5)
    assert [round(e.time, 12) for e in run.events] == [1.0, 2.0, 3.0]
    assert all(len(e.causes) == 3 for e in run.events)
    assert run.trajectory["x"][-1] == pytest.approx([0.5, 1.0], abs=1e-12)


class Carts(gt.Model):
    """Two carts that hit each other between two walls: each impact keeps momentum, and energy where e = 1."""

    m1 = gt.parameter(1.0, unit="kg")
    m2 = gt.parameter(3.0, unit="kg")
    e = gt.parameter(1.0)
    x1 = gt.variable(unit="m", start=0.2, fixed=True)
    x2 = gt.variable(unit="m", start=0.7, fixed=True)
    v1 = gt.variable(unit="m/s", start=0.9, fixed=True)
    v2 = gt.variable(unit="m/s", start=-0.3, fixed=True)

    def equations(self):
        yield gt.der(self.x1) == self.v1
        yield gt.der(self.x2) == self.v2
        yield gt.der(self.v1) == 0.0
        yield gt.der(self.v2) == 0.0
        yield gt.energy(stored=self.m1 / 2 * self.v1**2 + self.m2 / 2 * self.v2**2)
        together = (self.m1 * self.v1 + self.m2 * self.v2) / (self.m1 + self.m2)
        apart = self.e * (self.v1 - self.v2) / (self.m1 + self.m2)
        lost = (1 - self.e**2) * self.m1 * self.m2 / (2 * (self.m1 + self.m2)) * (self.v1 - self.v2) ** 2
        yield gt.when(
            self.x1 >= self.x2,
            gt.reinit(self.v1, together - self.m2 * apart),
            gt.reinit(self.v2, together + self.m1 * apart),
            gt.energy_loss(lost),
        )
        yield gt.when(self.x1 <= 0.0, gt.reinit(self.v1, -self.v1))
        yield gt.when(self.x2 >= 1.0, gt.reinit(self.v2, -self.v2))


@pytest.mark.parametrize("e", [1.0, 0.7])
def test_impacts_keep_momentum_and_lose_what_is_declared(e: float) -> None:
    run = gt.simulate(Carts(e=e), 20.0)
    assert len(run.events) > 10
    assert run.checks["declared_loss"].value < TOLERANCE
    hits = [x for x in run.events if len(x.restarted) == 2]
    for x in hits:
        (a, b), (c, d) = x.restarted["v1"], x.restarted["v2"]
        assert abs(1.0 * (b - a) + 3.0 * (d - c)) < TOLERANCE
        assert d - b == pytest.approx(e * (a - c), rel=1e-9)
    # against bouncing by hand from wall to wall and cart to cart
    x1, x2, v1, v2, t, times = 0.2, 0.7, 0.9, -0.3, 0.0, []
    while True:
        until = {
            "hit": (x2 - x1) / (v1 - v2) if v1 > v2 else np.inf,
            "left": -x1 / v1 if v1 < 0 else np.inf,
            "right": (1 - x2) / v2 if v2 > 0 else np.inf,
        }
        what = min(until, key=lambda k: until[k])
        t += until[what]
        if t > 20.0:
            break
        x1, x2 = x1 + v1 * until[what], x2 + v2 * until[what]
        if what == "hit":
            both, apart = (v1 + 3 * v2) / 4, e * (v1 - v2) / 4
            v1, v2 = both - 3 * apart, both + apart
        elif what == "left":
            v1, x1 = -v1, 0.0
        else:
            v2, x2 = -v2, 1.0
        times.append(t)
    assert len(times) == len(run.events)
    assert np.max(np.abs(np.array([x.time for x in run.events]) - times)) < 1e-8


class Wall(gt.Model):
    """A pendulum in Cartesian coordinates that hits a wall at x = 0: a constrained velocity starts anew."""

    L = gt.parameter(1.0, unit="m", positive=True)
    g = gt.parameter(9.81, unit="m/s2")
    x = gt.variable(unit="m", start=0.6, fixed=True)
    y = gt.variable(unit="m", start=-0.8)
    pull = gt.variable(unit="1/s2")

    def equations(self):
        yield self.x**2 + self.y**2 == self.L**2
        yield gt.der(self.x, 2) == -self.pull * self.x
        yield gt.der(self.y, 2) == -self.pull * self.y - self.g
        yield gt.when(self.x <= 0, gt.reinit(gt.der(self.x), -0.9 * gt.der(self.x)))


def test_a_pendulum_hits_a_wall() -> None:
    from scipy.special import ellipk

    run = gt.simulate(Wall(), 4.0, start={"der(x)": 0.0})
    times = np.array([e.time for e in run.events])
    # a quarter of a period of amplitude a, then half a period each of amplitudes whose speed falls by 0.9
    height = 2 * 9.81 * (1 - 0.8)
    expected, speed2 = [], height
    for n in range(len(times)):
        k2 = speed2 / (4 * 9.81)  # sin^2(a / 2)
        quarter = ellipk(k2) / np.sqrt(9.81)
        expected.append((expected[-1] if expected else 0.0) + (1 if n == 0 else 2) * quarter)
        speed2 *= 0.81
    assert len(times) == 4
    assert np.max(np.abs(times - expected)) < 1e-8


class Inclined(gt.Model):
    """A pendulum in Cartesian coordinates that an impulse in a given direction throws back."""

    L = gt.parameter(1.0, unit="m", positive=True)
    m = gt.parameter(2.0, unit="kg")
    g = gt.parameter(9.81, unit="m/s2")
    x = gt.variable(unit="m", start=0.6, fixed=True)
    y = gt.variable(unit="m", start=-0.8)
    pull = gt.variable(unit="N/m")
    contact = gt.variable(unit="N")

    def equations(self):
        yield self.x**2 + self.y**2 == self.L**2
        yield self.m * gt.der(self.x, 2) == -self.pull * self.x + 0.8 * self.contact
        yield self.m * gt.der(self.y, 2) == -self.pull * self.y - self.m * self.g + 0.6 * self.contact
        yield self.contact == 0.0
        kinetic = self.m / 2 * (gt.der(self.x) ** 2 + gt.der(self.y) ** 2)
        yield gt.energy(stored=kinetic + self.m * self.g * self.y)
        yield gt.when(
            self.x <= 0.1,
            gt.reinit(gt.der(self.x), -0.9 * gt.der(self.x), impulse=self.contact),
            gt.energy_loss((1 - 0.9**2) * kinetic),
        )


def test_an_impulse_changes_what_the_constraints_let_it_change() -> None:
    run = gt.simulate(Inclined(), 1.0, start={"der(x)": 0.0})
    event = run.events[0]
    # along the circle: m (1 + 0.9) times the speed there is the impulse's share in that direction
    x, y = 0.1, -np.sqrt(0.99)
    speed = np.sqrt(2 * 9.81 * (-y - 0.8))
    along = abs(0.8 * -y + 0.6 * x)
    assert event.impulses["contact"] == pytest.approx(2.0 * 1.9 * speed / along, rel=1e-9)
    assert run.checks["declared_loss"].value < TOLERANCE
    at = int(np.searchsorted(run.trajectory.time, event.time))
    row = {n: run.trajectory[n][at + 1] for n in ("x", "y", "der(x)", "der(y)")}
    assert abs(row["x"] * row["der(x)"] + row["y"] * row["der(y)"]) < 1e-12


class StoppedL1(gt.Model):
    """An L1 without forces whose first cart runs into a stop."""

    robot = gt.part(gt.robots.gantry_tau("l1_tape"))
    contact = gt.variable(unit="N")

    def equations(self):
        yield self.robot.tau == gt.vector([self.contact, 0.0 * self.contact, 0.0 * self.contact])
        yield self.contact == 0.0
        v = gt.der(self.robot.q[0])
        yield gt.when(self.robot.q[0] >= STOP, gt.reinit(v, -0.5 * v, impulse=self.contact))


STOP = -0.97  # m, of the cart that begins at -0.987 m


def test_a_cart_of_a_closed_chain_runs_into_a_stop() -> None:
    start = {"robot.T": [0.5, -0.9, 0.3], "der(robot.T)": [0.8, 0.1, 0.05]}
    l1 = gt.robots.gantry_tau("l1_tape")
    q = l1.causal(known="T", targets="q")(start["robot.T"])[0]
    assert q[0] < STOP
    run = gt.simulate(StoppedL1(), 0.2, start=start, outputs="der(robot.T)")
    event = run.events[0]
    at = int(np.searchsorted(run.trajectory.time, event.time))
    pose, before, after = (
        run.trajectory[n][row] for n, row in (("robot.T", at), ("der(robot.T)", at), ("der(robot.T)", at + 1))
    )
    # forces act on the speeds as on the accelerations: what the model's own dynamics make of a force on that cart
    forward = l1.causal(known="tau", targets="der(T,2)", prefer="T")
    with_force, without = (forward(pose, before, [f, 0.0, 0.0])[0] for f in (1.0, 0.0))
    expected = before + event.impulses["contact"] * (with_force - without)
    assert after == pytest.approx(expected, abs=1e-9)
    velocity = l1.causal(known="T", targets="der(q)")
    old, new = (velocity(pose, v)[0][0] for v in (before, after))
    assert new == pytest.approx(-0.5 * old, rel=1e-9)
