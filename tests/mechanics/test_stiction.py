"""Parts that switch: friction that sticks, end stops; against closed forms, and on the carts of the L1."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq

import gtmodel as gt
from gtmodel import mechanics as m

TOLERANCE = 1e-9


class Pushed(gt.Model):
    """A carriage that a motor pushes along its guideway."""

    carriage = gt.part(m.Mass, m=2.0)
    motor = gt.part(m.ForceMotor)
    slide = gt.part(m.StictionFriction, coulomb=5.0, breakaway_ratio=1.2)
    x = gt.variable(unit="m", start=0.0, fixed=True)
    v = gt.variable(unit="m/s")

    def equations(self):
        yield gt.connect(self.motor.flange, self.carriage.flange)
        yield gt.connect(self.slide.flange, self.carriage.flange)
        yield self.x == self.carriage.flange.s
        yield self.v == gt.der(self.x)


def pushed(force, final_time: float, v: float = 0.0, model: gt.Model | None = None, **more) -> gt.Simulation:
    return gt.simulate(model or Pushed(), final_time, inputs={"motor.force": force}, start={"v": v}, **more)


def states(run: gt.Simulation) -> list[tuple[float, float]]:
    """Times at which the friction changes, and its state from then on."""
    changed = [(e.time, e.discrete["slide.slides"][1]) for e in run.events if "slide.slides" in e.discrete]
    return [(round(t, 9), s) for t, s in changed]


def test_it_sticks_below_the_break_away_force_and_slides_at_the_kinetic_one() -> None:
    run = pushed(lambda t: 10.0 * t, 1.0)
    assert states(run) == [(0.6, 1.0)]
    s = run.trajectory.time - 0.6
    exact = np.where(s > 0, (10 * s**3 / 6 + (6 - 5) * s**2 / 2) / 2, 0.0)
    assert np.max(np.abs(run.trajectory["x"] - exact)) < TOLERANCE
    assert run.checks["energy_balance"].value < TOLERANCE


def test_forces_that_jump_reverse_release_and_hold_it() -> None:
    # 7.5 m/s2 for 1 s; -12.5 until it turns, -7.5 on; then free, it coasts and sticks; 5.9 N hold, 6.1 N do not
    steps = ([0.0, 1.0, 2.0, 4.0, 5.0, 6.0], [20.0, -20.0, 0.0, 5.9, 6.1, 6.1])
    run = pushed((steps, "previous"), 6.0)
    turns, stands = 1 + 7.5 / 12.5, 2 + 7.5 * 0.4 / 2.5
    assert states(run) == [(0.0, 1.0), (round(turns, 9), -1.0), (round(stands, 9), 0.0), (5.0, 1.0)]
    x = 7.5 / 2 + 7.5**2 / (2 * 12.5) - 7.5 * 0.4**2 / 2 - 3.0**2 / (2 * 2.5)
    assert run.trajectory["x"][run.trajectory.time <= 5.0][-1] == pytest.approx(x, abs=TOLERANCE)
    assert run.trajectory["x"][-1] == pytest.approx(x + 0.55 / 2, abs=TOLERANCE)


@pytest.mark.parametrize(
    ("force", "v", "state"),
    [(5.99, 0.0, 0.0), (6.01, 0.0, 1.0), (-6.01, 0.0, -1.0), (0.0, 0.3, 1.0), (20.0, -0.3, -1.0), (0.0, 1e-12, 0.0)],
)
def test_at_the_start_its_state_follows_from_the_velocity_then_from_the_force(force, v, state) -> None:
    run = pushed(force, 1e-3, v)
    assert run.trajectory["slide.slides"][-1] == state
    assert len(run.events) == (state != 0.0)
    heavier = {"carriage.m": 3.0}
    later = gt.simulate(
        Pushed(), 2.001, start_time=2.0, inputs={"motor.force": force}, start={"v": v}, parameters=heavier
    )
    assert later.trajectory["slide.slides"][-1] == state


def test_with_equal_levels_it_starts_as_smoothly_as_the_force_grows() -> None:
    # what accelerates it is zero at the instant itself, and grows
    run = pushed(lambda t: 7.0 * np.sin(2.0 * t), 2.1, model=Pushed(slide=dict(breakaway_ratio=1.0)))
    times = [t for t, _ in states(run)]
    assert [s for _, s in states(run)] == [1.0, 0.0, -1.0]
    begin = np.arcsin(5 / 7) / 2
    assert times[0] == pytest.approx(begin, abs=TOLERANCE)

    def v(t: float) -> float:
        return (3.5 * (np.cos(2 * begin) - np.cos(2 * t)) - 5 * (t - begin)) / 2

    stands = brentq(v, 1.0, 1.9, xtol=1e-15)
    assert times[1] == pytest.approx(stands, abs=TOLERANCE)
    assert times[2] == pytest.approx(np.pi / 2 + begin, abs=TOLERANCE)


class Train(Pushed):
    """Two carriages with a spring between them; the first one is pushed, the second one follows when it must."""

    second = gt.part(m.Mass, m=1.0)
    hold = gt.part(m.StictionFriction, coulomb=5.0)
    spring = gt.part(m.FlangeSpringDamper, k=200.0)
    y = gt.variable(unit="m", start=0.0, fixed=True)

    def equations(self):
        yield from super().equations()
        yield gt.connect(self.carriage.flange, self.spring.a)
        yield gt.connect(self.second.flange, self.spring.b)
        yield gt.connect(self.hold.flange, self.second.flange)
        yield self.y == self.second.flange.s


def test_two_frictions_each_break_away_at_their_own_time() -> None:
    run = gt.simulate(Train(), 2.0, inputs={"motor.force": lambda t: 10.0 * t}, start={"v": 0.0, "der(y)": 0.0})
    first, second = run.events[:2]
    assert first.discrete == {"slide.slides": (0.0, 1.0)}
    assert first.time == pytest.approx(0.6, abs=TOLERANCE)
    w = np.sqrt(200 / 2)

    def stretched(s: float) -> float:
        return 10 * s / 200 + (1 - np.cos(w * s)) / 200 - 10 / 200 / w * np.sin(w * s)

    assert second.discrete == {"hold.slides": (0.0, 1.0)}
    assert second.time == pytest.approx(0.6 + brentq(lambda s: stretched(s) - 5 / 200, 0.1, 0.45, xtol=1e-15), abs=1e-8)


class Twins(gt.Model):
    """Two carriages under the same force."""

    pushed = gt.parts(2, Pushed)


def test_two_that_break_away_at_one_instant_are_one_event() -> None:
    inputs = {f"pushed[{k}].motor.force": lambda t: 10.0 * t for k in range(2)}
    run = gt.simulate(Twins(), 1.0, inputs=inputs, start={f"pushed[{k}].v": 0.0 for k in range(2)})
    assert [round(e.time, 9) for e in run.events] == [0.6]
    assert len(run.events[0].discrete) == 2


def test_a_shaft_coasts_to_a_stop() -> None:
    bench = gt.Builder("bench")
    rotor = bench.part("rotor", m.Inertia(J=0.5))
    bearing = bench.part("bearing", m.RotationalStictionFriction(coulomb=3.0, viscous=0.25))
    bench.add(gt.connect(rotor.shaft, bearing.shaft))
    start = {"rotor.shaft.phi": 0.0, "der(rotor.shaft.phi)": -12.0}
    run = bench.simulate(3.0, start=start, outputs=["rotor.shaft.phi", "der(rotor.shaft.phi)"])
    end = 2 * np.log(1 + 0.25 * 12 / 3)
    assert [e.time for e in run.events] == pytest.approx([0.0, end], abs=TOLERANCE)
    assert abs(run.trajectory["der(rotor.shaft.phi)"][-1]) < 1e-12


def test_without_a_force_that_sticks_it_is_refused() -> None:
    with pytest.raises(gt.ModelError, match="'coulomb' is declared positive"):
        m.StictionFriction(coulomb=0.0)


# -- the carts of the L1 ---------------------------------------------------------------------------

POSE = [0.5, -0.9, 0.3]


@cache
def l1(smoothing: str = "stiction", scale: float = 0.1) -> gt.Model:
    return gt.robots.gantry_tau("l1_tape", smoothing=smoothing, velocity_scale=scale)


@cache
def held() -> np.ndarray:
    """Forces of the motors [N] that hold the L1 at rest without its frictions' help."""
    inverse = l1("tanh").causal(known="T", targets="tau")
    return inverse(POSE, np.zeros(3), np.zeros(3))[0]


@pytest.mark.parametrize("cart", range(3))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_cart_of_the_l1_moves_above_its_friction_only(cart: int, side: float) -> None:
    coulomb = np.array(l1().coulomb)
    rise = np.zeros(3)
    rise[cart] = side

    def moved(share: float) -> gt.Simulation:
        return gt.simulate(
            l1(), 0.1, inputs={"tau": held() + share * coulomb * rise}, start={"T": POSE, "der(T)": 0.0}, step=0.01
        )

    still = moved(0.999)
    assert not still.events
    assert np.max(np.abs(still.trajectory["T"] - POSE)) < TOLERANCE
    away = moved(1.001)
    (event,) = away.events
    assert event.discrete == {f"arm[{cart}].friction.slides": (0.0, side)}
    travel = away.trajectory["q"][-1] - away.trajectory["q"][0]
    assert side * travel[cart] > 1e-6
    assert np.max(np.abs(np.delete(travel, cart))) < TOLERANCE


@pytest.mark.parametrize("smoothing", ["tanh", pytest.param("piecewise_linear", marks=pytest.mark.proof)])
def test_smooth_friction_of_the_l1_converges_to_its_stiction(smoothing: str) -> None:
    def end(model: gt.Model, tolerance: float = TOLERANCE) -> np.ndarray:
        def tau(t: float) -> np.ndarray:
            return held() + np.array([300 * np.sin(6 * t), 200 * np.sin(4 * t), 250 * np.sin(5 * t)])

        run = gt.simulate(model, 1.0, inputs={"tau": tau}, start={"T": POSE, "der(T)": 0.0}, tolerance=tolerance)
        assert run.status.ok
        assert run.checks["energy_balance"].value < 1e-7
        assert all(event.discrete for event in run.events)
        return run.trajectory["T"][-1]

    exact = end(l1(), 1e-11)
    errors = [np.max(np.abs(end(l1(smoothing, scale)) - exact)) for scale in (1e-2, 1e-3, 1e-4)]
    assert errors[0] < 0.01
    # of the first order: a regularised friction creeps where it should stick
    assert np.log10(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.15)
    assert np.log10(errors[1] / errors[2]) == pytest.approx(1.0, abs=0.15)


def test_a_cart_of_the_l1_breaks_away_once() -> None:
    """Its speed, exactly zero until then, rises with a last bit of either sign: each such bit was an event."""
    rng = np.random.default_rng(7)
    for _ in range(5):
        levels, pace = np.array([300, 200, 250]) * rng.uniform(0.8, 1.3, 3), [6, 4, 5] * rng.uniform(0.8, 1.2, 3)
        inputs = {"tau": lambda t, level=levels, pace=pace: held() + level * np.sin(pace * t)}
        run = gt.simulate(l1(), 0.1, inputs=inputs, start={"T": POSE, "der(T)": 0.0}, tolerance=TOLERANCE)
        assert run.status.ok
        changed = [name for event in run.events for name in event.discrete or {"nothing": None}]
        assert len(changed) == len(set(changed))
        assert "nothing" not in changed


# -- end stops -------------------------------------------------------------------------------------


class Box(gt.Model):
    """A carriage between two ends, pushed by a motor."""

    carriage = gt.part(m.Mass, m=2.0)
    motor = gt.part(m.ForceMotor)
    ends = gt.part(m.EndStop, low=0.0, high=0.5, restitution=0.6, rest_speed=0.01)
    x = gt.variable(unit="m", start=0.0, fixed=True)

    def equations(self):
        yield gt.connect(self.motor.flange, self.carriage.flange)
        yield gt.connect(self.ends.flange, self.carriage.flange)
        yield self.x == self.carriage.flange.s


def test_between_two_ends_each_impact_loses_what_newton_says() -> None:
    run = gt.simulate(Box(), 4.0, inputs={"motor.force": 0.0}, start={"der(x)": 1.0})
    speeds = 0.6 ** np.arange(10)
    times = np.cumsum(0.5 / speeds)
    times = times[times < 4.0]
    assert [e.time for e in run.events] == pytest.approx(times, abs=1e-10)
    assert [-e.energy for e in run.events] == pytest.approx((1 - 0.36) * speeds[: len(times)] ** 2, rel=1e-9)
    impulses = [abs(e.impulses["ends.force"]) for e in run.events]
    assert impulses == pytest.approx(2.0 * 1.6 * speeds[: len(times)], rel=1e-9)


def test_under_a_force_it_comes_to_rest_at_an_end_and_leaves_when_it_is_pulled_away() -> None:
    # -4 N against the low end until 3 s; 4 N from there on
    force = (([0.0, 3.0, 5.0], [-4.0, 4.0, 4.0]), "previous")
    run = gt.simulate(Box(), 3.5, inputs={"motor.force": force}, start={"x": 0.1, "der(x)": 0.0})
    speed, t = np.sqrt(2 * 2 * 0.1), np.sqrt(2 * 0.1 / 2)
    times = [t]
    while speed >= 0.01:
        speed *= 0.6
        t += 2 * speed / 2
        times.append(t)
    assert [e.time for e in run.events] == pytest.approx([*times, 3.0], abs=1e-9)
    assert run.events[-2].discrete == {"ends.rests": (0.0, -1.0)}
    assert run.events[-1].discrete == {"ends.rests": (-1.0, 0.0)}
    rests = (run.trajectory.time > times[-1] + 1e-6) & (run.trajectory.time < 3.0)
    assert np.max(np.abs(run.trajectory["x"][rests])) < 1e-12
    assert np.allclose(run.trajectory["ends.force"][rests], -4.0)
    assert run.trajectory["x"][-1] == pytest.approx(0.25, abs=TOLERANCE)


def test_pressed_again_at_once_it_has_not_left() -> None:
    # the force touches zero while it rests there
    inputs = {"motor.force": lambda t: 4.0 * np.cos(t) - 4.0}
    run = gt.simulate(Box(), 6.0, inputs=inputs, start={"x": 0.0, "der(x)": 0.0}, max_step=0.1)
    assert np.min(run.trajectory["x"]) > -1e-6
    assert np.max(run.trajectory["x"]) < 1e-6


def test_all_that_is_coupled_takes_part_in_an_impact() -> None:
    run = gt.simulate(Box(carriage=dict(m=3.0)), 1.0, inputs={"motor.force": 0.0}, start={"der(x)": 1.0})
    (event,) = run.events
    assert event.energy == pytest.approx(-0.5 * 3.0 * (1 - 0.36), rel=1e-9)
    assert abs(event.impulses["ends.force"]) == pytest.approx(3.0 * 1.6, rel=1e-9)


def test_at_the_break_away_force_itself_it_sticks() -> None:
    """Levels are equal: what slides there would not move, and be pushed backwards when the force falls again."""
    bench = Pushed(slide={"breakaway_ratio": 1.0})
    for rows in ([0.0, 5.0, 5.0, 0.0, 0.0], [0.0, -5.0, -5.0, -1.0, 0.0]):
        for kind in ("linear", "previous"):
            run = pushed(((np.arange(5.0), np.array(rows)), kind), 4.0, model=bench)
            assert not run.events
            assert np.ptp(run.trajectory["x"]) == 0.0


def test_what_came_to_rest_at_an_end_without_a_force_is_pulled_away() -> None:
    bench = gt.Builder("bench")
    carriage = bench.part("carriage", m.Mass(m=2.0))
    motor = bench.part("motor", m.ForceMotor())
    ends = bench.part("ends", m.EndStop(low=0.0, high=1.0, rest_speed=0.1))
    bench.add(gt.connect(carriage.flange, ends.flange), gt.connect(carriage.flange, motor.flange))
    push = (np.array([0.0, 7.0, 9.0]), np.array([0.0, 4.0, 4.0])), "previous"
    start = {"carriage.flange.s": 0.5, "der(carriage.flange.s)": -0.09}
    run = bench.simulate(7.9, inputs={"motor.force": push}, start=start, outputs="carriage.flange.s")
    assert [e.time for e in run.events] == pytest.approx([0.5 / 0.09, 7.0], abs=1e-9)
    assert run.trajectory["carriage.flange.s"][-1] == pytest.approx(2.0 * 0.9**2 / 2, abs=1e-9)
