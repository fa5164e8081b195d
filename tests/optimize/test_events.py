"""Phases made from events whose order is given: closed forms, other roads, and what is refused."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import minimize, minimize_scalar

import gtmodel as gt

G, LOSS = 9.81, 0.8
# of objectives and instants where the mesh holds the solution exactly: the solver's tolerance
EXACT = 1e-7


class Throw(gt.Optimization):
    h = gt.variable(unit="m", start=1.0, fixed=True)
    d = gt.variable(unit="m", start=0.0, fixed=True)
    v = gt.variable(unit="m/s", start=0.0)
    e = gt.parameter(LOSS)
    bounces = gt.discrete(0.0)
    speed = gt.free(1.0, unit="m/s")
    final_time = gt.free(1.0, min=0.1, unit="s")

    def equations(self):
        yield gt.der(self.h) == self.v
        yield gt.der(self.v) == -G
        yield gt.der(self.d) == self.speed
        yield gt.when(self.h <= 0.0, gt.reinit(self.v, -self.e * self.v), self.bounces == gt.pre(self.bounces) + 1.0)

    def objective(self):
        return self.v.at(self.start_time) ** 2 + self.speed**2

    def constraints(self):
        yield self.d.at(self.final_time) == 3.0
        yield self.h.at(self.final_time) == 0.2


def cost_of_throw(v: float, bounces: int) -> float:
    """Of the upward speed of a throw that is at 0.2 m after so many bounces, on its way down."""
    impact = np.sqrt(v**2 + 2 * G)
    time = (v + impact) / G + sum(2 * LOSS**k * impact / G for k in range(1, bounces))
    last = LOSS**bounces * impact
    return v**2 + (3.0 / (time + (last + np.sqrt(last**2 - 2 * G * 0.2)) / G)) ** 2


@pytest.mark.parametrize("bounces", [1, 2])
def test_a_throw_meets_its_closed_form(bounces: int) -> None:
    best = minimize_scalar(lambda v: cost_of_throw(v, bounces), bounds=(0.0, 4.0), options={"xatol": 1e-10})
    phases = gt.phases_of_events(Throw(v={"start": 1.0}), ["event 1"] * bounces)
    found = gt.solve_phases(phases, gt.Mesh(3))
    assert found.status.ok
    if bounces == 1:
        assert abs(found.objective - best.fun) < EXACT * best.fun
    # the answer is a motion with these events
    v, speed = float(found["phase 1"].trajectory["v"][0]), found["phase 1"].free["speed"]
    assert abs(found.objective - cost_of_throw(v, bounces)) < EXACT
    end = float(found[f"phase {bounces + 1}"].trajectory.time[-1])
    run = gt.simulate(Throw(), end, start={"v": v})
    instants = [float(found[f"phase {k}"].trajectory.time[-1]) for k in range(1, bounces + 1)]
    assert np.max(np.abs(np.array([e.time for e in run.events]) - instants)) < EXACT
    assert abs(speed * end - 3.0) < EXACT


@pytest.mark.parametrize(
    ("elements", "instants"),
    [
        (5, None), (20, [0.5, 0.8]),
        *(pytest.param(n, t, marks=pytest.mark.proof)
          for n, t in ((3, None), (20, None), (3, [0.5, 0.8]), (5, [0.5, 0.8]))),
    ],
)  # fmt: skip
def test_guesses_of_the_instants_may_be_poor(elements: int, instants: list[float] | None) -> None:
    found = gt.solve_phases(gt.phases_of_events(Throw(), ["event 1"] * 2, instants=instants), gt.Mesh(elements))
    assert found.status.ok
    assert found.iterations <= 30
    v = float(found["phase 1"].trajectory["v"][0])
    slope = (cost_of_throw(v + 1e-4, 2) - cost_of_throw(v - 1e-4, 2)) / 2e-4
    # stationary: on its way down at the end, or on its way up
    assert abs(slope) < 1e-4 or abs(found.objective - cost_of_throw(v, 2)) > 1e-3


class Drop(gt.Optimization):
    """Least time from rest at 1 m to 0.3 m after one bounce; the guess of the time lies on the way down."""

    h = gt.variable(unit="m", start=1.0, fixed=True)
    v = gt.variable(unit="m/s", start=0.0, fixed=True)
    final_time = gt.free(1.2, min=0.1, unit="s")

    def equations(self):
        yield gt.der(self.h) == self.v
        yield gt.der(self.v) == -G
        yield gt.when(self.h <= 0.0, gt.reinit(self.v, -LOSS * self.v))

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.h.at(self.final_time) == 0.3


def test_a_height_is_reached_on_the_way_up_where_that_is_faster() -> None:
    found = gt.solve_phases(gt.phases_of_events(Drop(), ["event 1"]), gt.Mesh(3))
    impact = np.sqrt(2 * G)
    up = (LOSS * impact - np.sqrt((LOSS * impact) ** 2 - 2 * G * 0.3)) / G
    assert found.status.ok and abs(found.objective - (impact / G + up)) < EXACT
    assert found.message == found["phase 2"].message == "solved; local optimum; 1 of 3 starts ended here"
    # a guess that is given is the only start
    given = {name: found[name].trajectory for name in ("phase 1", "phase 2")}
    again = gt.solve_phases(gt.phases_of_events(Drop(), ["event 1"]), gt.Mesh(3), guess=given)
    assert again.message == "solved" and abs(again.objective - found.objective) < EXACT


def test_starts_share_the_limit_of_iterations() -> None:
    phases = gt.phases_of_events(Drop(), ["event 1"])
    whole = gt.solve_phases(phases, gt.Mesh(3)).iterations
    for most in (1, whole - 1):
        found = gt.solve_phases(phases, gt.Mesh(3), solver=gt.SolverOptions(max_iterations=most), throw=False)
        assert found.iterations <= most


class Thermostat(gt.Optimization):
    """Between 18 and 22 degrees; its power is chosen."""

    T = gt.variable(start=20.0, fixed=True)
    on = gt.discrete(0.0)
    P = gt.free(8.0, min=1.0, max=20.0)
    final_time = 4.0

    def equations(self):
        yield gt.der(self.T) == -0.5 * (self.T - 10.0) + self.on * self.P
        yield gt.when(self.T <= 18.0, self.on == 1.0)
        yield gt.when(self.T >= 22.0, self.on == 0.0)

    def objective(self):
        return gt.integral(self.on * self.P)

    def constraints(self):
        yield self.T.at(self.final_time) >= 20.0


def test_a_thermostat_takes_least_energy() -> None:
    found = gt.solve_phases(gt.phases_of_events(Thermostat(), ["event 1", "event 2"]), gt.Mesh(8))
    assert found.status.ok
    # it cools to 18, heats to 22 as slowly as leaves time to cool to 20 at the end: dT/dt = (10 + 2 on P - T) / 2
    first, rest = 2 * np.log(10 / 8), 2 * np.log(12 / 10)
    heating = 4.0 - first - rest
    growth = np.exp(heating / 2)
    power = ((22 * growth - 18) / (growth - 1) - 10) / 2
    assert abs(found["phase 2"].free["P"] - power) < 1e-6
    assert abs(found.objective - power * heating) < 1e-5
    times = [found[f"phase {k}"].trajectory.time[-1] for k in (1, 2)]
    assert np.allclose(times, [first, first + heating], rtol=0, atol=1e-6)


class Refraction(gt.Optimization):
    """Least time from (0, 0) to (1, 2), at half the speed from y = 1 on."""

    x = gt.variable(start=0.0, fixed=True)
    y = gt.variable(start=0.0, fixed=True)
    angle = gt.input(min=-1.5, max=3.0, start=1.0)
    final_time = gt.free(3.0, min=0.5)

    def equations(self):
        speed = gt.If(self.y >= 1.0, 0.5, 1.0)
        yield gt.der(self.x) == speed * gt.cos(self.angle)
        yield gt.der(self.y) == speed * gt.sin(self.angle)

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.x.at(self.final_time) == 1.0
        yield self.y.at(self.final_time) == 2.0


def test_a_border_refracts_as_light_is() -> None:
    best = minimize_scalar(lambda s: np.hypot(s, 1) + 2 * np.hypot(1 - s, 1), bounds=(0, 1), options={"xatol": 1e-12})
    found = gt.solve_phases(gt.phases_of_events(Refraction(), ["If 1"]), gt.Mesh(3))
    assert found.status.ok
    assert abs(found.objective - best.fun) < EXACT
    slow, fast = (float(np.cos(found[f"phase {k}"].trajectory["angle"][-1])) for k in (2, 1))
    assert abs(fast / slow - 2.0) < 1e-5  # Snell


class Door(gt.Optimization):
    """Least time from rest at 0 to rest at 2; at 1 half of the speed is lost."""

    x = gt.variable(start=0.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=-1.0, max=1.0)
    final_time = gt.free(3.0, min=0.5)

    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == self.u
        yield gt.when(self.x >= 1.0, gt.reinit(self.v, 0.5 * self.v))

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.x.at(self.final_time) == 2.0
        yield self.v.at(self.final_time) == 0.0


def test_least_time_through_a_door_that_brakes() -> None:
    mesh = gt.Mesh(4, control="constant", length_ratio=(0.1, 4.0))
    found = gt.solve_phases(gt.phases_of_events(Door(), ["event 1"]), mesh)
    assert found.status.ok
    # full thrust up to the door, then to sqrt(5/4) and back to rest
    assert abs(found.objective - (np.sqrt(2) + 2 * np.sqrt(1.25) - np.sqrt(0.5))) < EXACT


def test_sign_switches_where_that_is_given() -> None:
    class Rub(gt.Optimization):
        q = gt.variable(start=0.0, fixed=True)
        v = gt.variable(start=1.0, fixed=True)
        u = gt.input(min=-2.0, max=2.0)
        final_time = gt.free(3.0, min=0.5)

        def equations(self):
            yield gt.der(self.q) == self.v
            yield gt.der(self.v) == self.u - gt.sign(self.v)

        def objective(self):
            return self.final_time

        def constraints(self):
            yield self.q.at(self.final_time) == -1.0
            yield self.v.at(self.final_time) == 0.0

    mesh = gt.Mesh(4, control="constant", length_ratio=(0.1, 4.0))
    found = gt.solve_phases(gt.phases_of_events(Rub(), ["sign() 1"]), mesh)
    assert found.status.ok
    # it stops after 1/3 s at 1/6 m; then 7/6 m back, at 1 to the switch and at -3 from there
    back = 7 / 6
    top = np.sqrt(2 * back / (1 + 1 / 3))
    assert abs(found.objective - (1 / 3 + top + top / 3)) < EXACT


class Thrust(gt.Optimization):
    """A ball with a thruster: least effort to be at rest at 0.5 m after 2 s and one bounce."""

    h = gt.variable(start=1.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    u = gt.input()
    final_time = 2.0

    def equations(self):
        yield gt.der(self.h) == self.v
        yield gt.der(self.v) == self.u - G
        yield gt.when(self.h <= 0.0, gt.reinit(self.v, -LOSS * self.v))

    def objective(self):
        return gt.integral(self.u**2)

    def constraints(self):
        yield self.h.at(self.final_time) == 0.5
        yield self.v.at(self.final_time) == 0.0


def test_one_program_written_by_hand_has_the_same_optimum() -> None:
    t, v = ca.SX.sym("t"), ca.SX.sym("v")

    def effort(T: ca.SX, x0: float, v0: ca.SX, x1: float, v1: ca.SX) -> ca.SX:
        """Least integral of u^2 between two points of a double integrator that falls."""
        dx, dv = x1 - x0 - v0 * T + G * T**2 / 2, v1 - v0 + G * T
        return 12 * dx**2 / T**3 - 12 * dx * dv / T**2 + 4 * dv**2 / T

    cost = effort(t, 1.0, 0.0, 0.0, v) + effort(2.0 - t, 0.0, -LOSS * v, 0.5, 0.0)
    quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-12}
    by_hand = ca.nlpsol("by_hand", "ipopt", {"x": ca.vertcat(t, v), "f": cost}, quiet)
    best = by_hand(x0=[0.6, -4.0], lbx=[0.1, -20.0], ubx=[1.9, 0.0])
    found = gt.solve_phases(gt.phases_of_events(Thrust(), ["event 1"]), gt.Mesh(2))
    assert found.status.ok
    assert abs(found.objective - float(best["f"])) < EXACT * float(best["f"])
    assert abs(found["phase 1"].trajectory.time[-1] - float(best["x"][0])) < 1e-6


class OneWay(gt.Optimization):
    """A threshold that is passed once; its condition stays true."""

    x = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=-1.0, max=1.0)
    n = gt.discrete(0.0)
    far = gt.discrete(0.0)
    final_time = 2.0

    def equations(self):
        yield gt.der(self.x) == self.u
        yield gt.when(self.x >= 0.5, self.n == gt.pre(self.n) + 1.0)
        yield gt.when(self.x >= 1.5, self.far == 1.0)

    def objective(self):
        return -self.x.at(self.final_time)


def test_a_condition_may_stay_true() -> None:
    found = gt.solve_phases(gt.phases_of_events(OneWay(), ["event 1", "event 2"]), gt.Mesh(4))
    assert found.status.ok
    assert abs(found.objective + 2.0) < 1e-6


def test_what_touches_a_threshold_is_said() -> None:
    found = gt.solve_phases(gt.phases_of_events(OneWay(), ["event 1"]), gt.Mesh(4), throw=False)
    assert found.status.ok  # it is reached at the end, where nothing comes after
    assert abs(found.objective + 1.5) < 1e-6

    class Stay(OneWay):
        def objective(self):
            return gt.integral((self.x - 2.0) ** 2)

    found = gt.solve_phases(gt.phases_of_events(Stay(), ["event 1"]), gt.Mesh(4), throw=False)
    assert found.status is gt.SolveStatus.CHECK_FAILED
    assert "'event 2'" in found.message


def test_an_event_that_does_not_happen_is_said() -> None:
    class Back(OneWay):
        def objective(self):
            return gt.integral((self.x - 1.0) ** 2)

        def constraints(self):
            yield self.x.at(self.final_time) == 0.4

    found = gt.solve_phases(gt.phases_of_events(Back(), ["event 1", "event 1"]), gt.Mesh(5), throw=False)
    assert found.status is gt.SolveStatus.CHECK_FAILED
    assert "'event 1'" in found.message
    assert gt.solve_phases(gt.phases_of_events(Back(), ["event 1"]), gt.Mesh(5)).status.ok


def test_an_event_that_happens_again_is_said() -> None:
    class Wave(OneWay):
        """Down and up again through 0.5 with a period of 2 pi / 1.5 s."""

        x = gt.variable(start=1.2, fixed=True)
        w = gt.parameter(1.5, unit="rad/s")
        final_time = 8.0

        def objective(self):
            return gt.integral((self.x - 0.6 - 0.6 * gt.cos(self.w * self.time)) ** 2)

    up = (2 * np.pi - np.arccos(-1 / 6)) / 1.5, (4 * np.pi - np.arccos(-1 / 6)) / 1.5
    once = gt.solve_phases(gt.phases_of_events(Wave(), ["event 1"], instants=[3.0]), gt.Mesh(20), throw=False)
    assert once.status is gt.SolveStatus.CHECK_FAILED
    assert "'event 1'" in once.message
    twice = gt.solve_phases(gt.phases_of_events(Wave(), ["event 1"] * 2, instants=[3.0, 7.0]), gt.Mesh(20))
    assert twice.status.ok
    assert twice.objective < 1e-8
    instants = [twice[f"phase {k}"].trajectory.time[-1] for k in (1, 2)]
    assert np.allclose(instants, up, rtol=0, atol=1e-3)


def test_time_makes_an_event() -> None:
    class Timed(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True)
        gain = gt.discrete(1.0)
        u = gt.input()
        final_time = 3.0

        def equations(self):
            yield gt.der(self.x) == self.gain * self.u
            yield gt.when(self.time >= 1.0, self.gain == 2.0)

        def objective(self):
            return gt.integral(self.u**2)

        def constraints(self):
            yield self.x.at(self.final_time) == 1.0

    found = gt.solve_phases(gt.phases_of_events(Timed(), ["event 1"]), gt.Mesh(2))
    assert found.status.ok
    assert abs(found.objective - 1 / (1 + 4 * 2)) < EXACT  # u is proportional to the gain
    assert abs(found["phase 1"].trajectory.time[-1] - 1.0) < EXACT


def test_a_discrete_variable_keeps_what_was_reached() -> None:
    class Latched(gt.Optimization):
        """From x = 1 on y follows the speed at that instant."""

        x = gt.variable(start=0.0, fixed=True)
        v = gt.variable(start=0.0, fixed=True)
        y = gt.variable(start=0.0, fixed=True)
        kept = gt.discrete(0.0)
        u = gt.input()
        final_time = 2.0

        def equations(self):
            yield gt.der(self.x) == self.v
            yield gt.der(self.v) == self.u
            yield gt.der(self.y) == self.kept
            yield gt.when((self.x >= 1.0) & (self.kept < 0.5), self.kept == self.v)

        def objective(self):
            return gt.integral(self.u**2)

        def constraints(self):
            yield self.y.at(self.final_time) == 1.0

    with pytest.raises(gt.ModelError, match=r"makes an event depend on optimised quantities.*test_events"):
        gt.phases_of_events(Latched(), ["event 1"])

    class Plain(Latched):
        def equations(self):
            yield gt.der(self.x) == self.v
            yield gt.der(self.v) == self.u
            yield gt.der(self.y) == self.kept
            yield gt.when(self.x >= 1.0, self.kept == self.v)

    found = gt.solve_phases(gt.phases_of_events(Plain(), ["event 1"]), gt.Mesh(3))
    assert found.status.ok

    # from rest to x = 1 with speed w in t: 12 / t^3 - 12 w / t^2 + 4 w^2 / t, and w (2 - t) = 1
    def cost(t: float) -> float:
        w = 1 / (2 - t)
        return 12 / t**3 - 12 * w / t**2 + 4 * w**2 / t

    best = minimize_scalar(cost, bounds=(0.1, 1.9), options={"xatol": 1e-10})
    assert abs(found.objective - best.fun) < EXACT * best.fun


def test_free_constants_are_one_in_all_phases() -> None:
    found = gt.solve_phases(gt.phases_of_events(Throw(), ["event 1"]), gt.Mesh(3))
    speeds = {round(found[f"phase {k}"].free["speed"], 9) for k in (1, 2)}
    assert len(speeds) == 1


def test_held_says_what_fixed_starts_do_not() -> None:
    class Free(Refraction):
        y = gt.variable(start=0.0)

        def constraints(self):
            yield from super().constraints()
            yield self.y.at(self.start_time) == 0.0

    with pytest.raises(
        gt.ModelError,
        match=r"not determined whether If 1 holds at the start; list all conditions that hold in held.*test_events",
    ):
        gt.phases_of_events(Free(), ["If 1"])
    found = gt.solve_phases(gt.phases_of_events(Free(), ["If 1"], held=[]), gt.Mesh(3))
    assert abs(found.objective - gt.solve_phases(gt.phases_of_events(Refraction(), ["If 1"]), gt.Mesh(3)).objective) < (
        EXACT
    )


def least_effort(T: float, x: tuple[float, float], v: tuple[float, float], pull: float) -> float:
    """Least integral of u^2 of x'' = u - pull between two places and speeds, in T."""
    dx, dv = x[1] - x[0] - v[0] * T + pull * T**2 / 2, v[1] - v[0] + pull * T
    return 12 * dx**2 / T**3 - 12 * dx * dv / T**2 + 4 * dv**2 / T


def test_what_follows_from_an_event_happens_at_the_same_instant() -> None:
    class Chain(gt.Optimization):
        """At the floor a discrete variable changes, which switches the pull off and throws back."""

        s = gt.variable(start=1.0, fixed=True)
        floats = gt.discrete(0.0)
        u = gt.input()
        final_time = 2.0

        def equations(self):
            yield gt.der(self.s, 2) == gt.If(self.floats > 0.5, self.u, self.u - G)
            yield gt.when(self.s <= 0.0, self.floats == 1.0)
            yield gt.when(self.floats > 0.5, gt.reinit(gt.der(self.s), -0.5 * gt.der(self.s)))

        def initial_equations(self):
            yield gt.der(self.s) == 0.0

        def objective(self):
            return gt.integral(self.u**2)

        def constraints(self):
            yield self.s.at(self.final_time) == 1.0

    def effort(z: np.ndarray) -> float:
        first = least_effort(z[0], (1.0, 0.0), (0.0, z[1]), G)
        return first + least_effort(2.0 - z[0], (0.0, 1.0), (-0.5 * z[1], z[2]), 0.0)

    best = minimize(effort, [0.5, -4.0, 1.0], tol=1e-12)
    found = gt.solve_phases(gt.phases_of_events(Chain(), ["event 1"]), gt.Mesh(4))
    assert found.status.ok
    assert abs(found.objective - best.fun) < EXACT * best.fun


class Both(gt.Optimization):
    """Two thresholds, of which the second is passed first where nothing speaks against it."""

    x = gt.variable(start=0.0, fixed=True)
    y = gt.variable(start=0.0, fixed=True)
    a = gt.discrete(0.0)
    b = gt.discrete(0.0)
    u = gt.input()
    v = gt.input()
    final_time = 2.0

    def equations(self):
        yield gt.der(self.x) == self.u
        yield gt.der(self.y) == self.v
        yield gt.when(self.x >= 1.0, self.a == 1.0)
        yield gt.when(self.y >= 1.0, self.b == 1.0)

    def objective(self):
        return gt.integral(self.u**2 + self.v**2)

    def constraints(self):
        yield self.x.at(self.final_time) == 2.0
        yield self.y.at(self.final_time) == 3.0


def test_each_order_is_its_own_problem() -> None:
    free = gt.solve_phases(gt.phases_of_events(Both(), ["event 2", "event 1"]), gt.Mesh(4))
    assert free.status.ok
    assert abs(free.objective - (2.0**2 + 3.0**2) / 2) < 1e-6
    # at one instant t: 1 / t + 1 / (2 - t) + 1 / t + 4 / (2 - t)
    together = minimize_scalar(lambda t: 2 / t + 5 / (2 - t), bounds=(0.1, 1.9), options={"xatol": 1e-12})
    at_once = gt.solve_phases(gt.phases_of_events(Both(), [("event 1", "event 2")]), gt.Mesh(4))
    assert at_once.status.ok
    assert abs(at_once.objective - together.fun) < 1e-6
    # the other way round they want to be at once: no phase is left between them
    other = gt.solve_phases(gt.phases_of_events(Both(), ["event 1", "event 2"]), gt.Mesh(4), throw=False)
    assert not other.status.ok
    assert "phase 2" in other.message


class Chooses(gt.Optimization):
    """z' = y is a until a = t reaches 1, and b from then on, which u pulls: y is another name of either."""

    a = gt.variable(start=0.0, fixed=True)
    b = gt.variable(start=3.0, fixed=True)
    z = gt.variable(start=0.0, fixed=True)
    y = gt.variable()
    u = gt.free(1.0)
    final_time = 2.0

    def equations(self):
        yield gt.der(self.a) == 1.0
        yield gt.der(self.b) == self.u - self.b
        yield self.y == gt.If(self.a > 1, self.b, self.a)
        yield gt.der(self.z) == self.y

    def objective(self):
        return self.u**2

    def constraints(self):
        yield self.z.at(self.final_time) == 2.0


def test_a_state_goes_on_into_a_phase_where_an_output_has_its_name() -> None:
    answer = gt.solve_phases(gt.phases_of_events(Chooses(), ["If 1"]), gt.Mesh(6))
    # z(2) = 1/2 + u + (3 - u) (exp(-1) - exp(-2))
    moved = np.exp(-1) - np.exp(-2)
    u = (1.5 - 3 * moved) / (1 - moved)
    assert answer["phase 2"].trajectory["b"][0] == pytest.approx(u + (3 - u) * np.exp(-1), abs=EXACT)
    assert answer["phase 1"].trajectory["y"][-1] == pytest.approx(1.0, abs=EXACT)
    assert answer.objective == pytest.approx(u**2, abs=EXACT)


def test_what_is_given_to_another_quantity_jumps_where_nothing_differentiates_it() -> None:
    class Doubled(Chooses):
        def equations(self):
            yield gt.der(self.a) == 1.0
            yield gt.der(self.b) == self.u - self.b
            yield self.y == gt.If(self.a > 1, 2 * self.b, self.a)
            yield gt.der(self.z) == self.y

    answer = gt.solve_phases(gt.phases_of_events(Doubled(), ["If 1"]), gt.Mesh(6))
    moved = np.exp(-1) - np.exp(-2)
    assert answer.objective == pytest.approx(((0.75 - 3 * moved) / (1 - moved)) ** 2, abs=EXACT)

    class Differentiated(Chooses):
        rate = gt.variable()

        def equations(self):
            yield from super().equations()
            yield self.rate == gt.der(self.y)

    answer = gt.solve_phases(gt.phases_of_events(Differentiated(), ["If 1"]), gt.Mesh(6), throw=False)
    assert answer.status is gt.SolveStatus.CHECK_FAILED and "'y' jumps from 1 to" in answer.message
