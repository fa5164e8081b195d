"""Processes with fast parts, readings off the grid, models without an answer: nothing wrong with status "solved"."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering import (
    DiscreteProcess,
    ErrorState,
    InitialState,
    Interacting,
    ProcessModel,
    Readings,
    Sensor,
    StatePart,
    SteadyState,
    System,
    make,
)
from gtmodel.filtering.transition import LinearTransition
from gtmodel.results.refusal import ArgumentError

ROUND_OFF = 1e-10  # of the deviations
CLOSE = 2e-3  # of the deviations: the fast rate times a step is up to 1


class Driven(gt.Model):
    """A pendulum driven by a torque that settles within `tau`."""

    tau = gt.parameter(1e-3, unit="s")
    pull = gt.parameter(20.0, unit="1/s2")
    angle = gt.variable(unit="rad")
    rate = gt.variable(unit="rad/s")
    torque = gt.variable(unit="rad/s2")
    noise = gt.input(unit="rad/s2")

    def equations(self) -> Any:
        yield gt.der(self.angle) == self.rate
        yield gt.der(self.rate) == -self.pull * gt.sin(self.angle) + self.torque
        yield gt.der(self.torque) * self.tau == self.noise - self.torque


class Rooted(gt.Model):
    """Measured by a root, which has no value below `edge`."""

    edge = gt.parameter(1.0, unit="m2")
    x = gt.variable(unit="m2")
    root = gt.variable(unit="m")
    noise = gt.input(unit="m2/s")

    def equations(self) -> Any:
        yield gt.der(self.x) == self.noise
        yield self.root == gt.sqrt(self.x - self.edge)


def walk(variance: float = 1e-4, **options: Any) -> System:
    process = DiscreteProcess([StatePart("x", unit="m")], 0.1, lambda s: {"x": s.x}, [variance])
    return System(process, [Sensor("tape", "x", **{"deviation": 0.01, **options})])


@pytest.mark.parametrize("times", [0.1, 10.0, 30.0, 100.0, 3000.0])
def test_noise_of_a_step_of_many_time_constants_is_that_of_the_closed_form(times):
    # velocity noise through a lag of 1 ms: Van Loan's matrix holds exp(times)
    tau, q = 1e-3, 2.0
    dt = times * tau
    A, G = np.array([[0.0, 1.0], [0.0, -1 / tau]]), np.array([[0.0], [1 / tau]])
    Q = LinearTransition(A, np.zeros((2, 0)), np.zeros(2), G, q * np.eye(1)).matrices(dt)[-1]
    one, two = -np.expm1(-dt / tau), -np.expm1(-2 * dt / tau)
    exact = q * np.array([[dt - 2 * tau * one + tau / 2 * two, one**2 / 2], [one**2 / 2, two / (2 * tau)]])
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    few = 1e3 if times < 1 else 1.0  # there the closed form is a difference of equal numbers
    assert np.max(np.abs(Q - exact) / scale) < few * ROUND_OFF
    assert np.linalg.eigvalsh(Q / scale)[0] > 0


@pytest.mark.parametrize("tau", [1e-4, 1e-3, 8e-3])
def test_a_fast_part_makes_the_steps_short(tau):
    process = ProcessModel(Driven(tau=tau), {"noise": 1e-2}, states=["angle", "rate", "torque"])
    sensors = [Sensor("encoder", "angle", deviation=1e-3)]
    coarse, fine = System(process, sensors), System(process, sensors, longest_step=tau / 20)
    x, u = np.array([[0.5, 0.0, 0.1]]), np.zeros(0)
    ours, right = (s.transition(0.0, 0.02, x, u, u) for s in (coarse, fine))
    deviation = np.sqrt(np.diag(right.Q[0]))
    assert np.max(np.abs(ours.x - right.x) / deviation) < CLOSE
    assert np.max(np.abs(ours.Q - right.Q) / np.outer(deviation, deviation)) < 10 * CLOSE


def test_a_part_too_fast_to_follow_is_refused():
    process = ProcessModel(Driven(tau=1e-9), {"noise": 1e-2}, states=["angle", "rate", "torque"])
    system = System(process, [Sensor("encoder", "angle", deviation=1e-3)])
    start = InitialState({}, {"angle": 0.1, "rate": 0.1, "torque": 0.1})
    with pytest.raises(ArgumentError, match="1e-09 s") as caught:
        ErrorState(system).run({"encoder": Readings([0.0, 0.01], [0.0, 0.0])}, start)
    assert caught.value.argument == "process"


def test_readings_between_the_steps_of_a_process_are_refused():
    # they were taken for readings of one instant, and the state stood still
    time = 0.04 * np.arange(20)
    with pytest.raises(ArgumentError, match=r"0\.04 s later, which is not a multiple") as caught:
        ErrorState(walk()).run({"tape": Readings(time, time)}, InitialState({}, {"x": 1.0}))
    assert caught.value.argument == "log"
    run = ErrorState(walk()).run({"tape": Readings(0.1 * np.arange(1000), np.ones(1000))}, InitialState({}, {"x": 1.0}))
    assert run.status.ok and run.count.sum() == 1000


@pytest.mark.parametrize("name", ["ekf", "iekf", "ukf", "particle"])
def test_a_reading_of_which_the_model_has_no_value_is_not_a_missing_one(name):
    system = System(ProcessModel(Rooted(), {"noise": 1e-4}, states=["x"]), [Sensor("root", deviation=0.01)])
    log = {"root": Readings(0.1 * np.arange(5), np.full(5, 0.5))}
    run = make(name, system).run(log, InitialState({"x": 0.9}, {"x": 0.01}))
    assert run.status.value == "not_finite" and len(run.time) == 0
    start = InitialState({"x": 0.9}, {"x": 0.01}, time=0.0)
    buffer = gt.filtering.Buffer(make(name, system), start, 1.0)
    assert buffer.push("root", 0.0, 0.5) == "not finite" and buffer.refused["root"] == 1
    missing = {"root": Readings([0.0, 0.1], [np.nan, np.inf])}
    assert make("ekf", system).run(missing, InitialState({"x": 1.2}, {"x": 0.01})).status.ok


@pytest.mark.parametrize("name", ["ekf", "ukf"])
def test_the_length_of_a_direction_does_not_count_and_none_is_missing(name):
    part = StatePart("up", "direction", 3)
    process = DiscreteProcess([part], 0.1, lambda s: {"up": s.up}, [1e-4, 1e-4])
    system = System(process, [Sensor("magnetometer", "up", kind="direction", deviation=0.05)])
    rng = np.random.default_rng(4)  # synthetic
    read = np.array([0.0, 0.0, 1.0]) + 0.05 * rng.standard_normal((12, 3))
    read /= np.linalg.norm(read, axis=1, keepdims=True)
    time, start = 0.1 * np.arange(12), InitialState({}, {"up": 0.3})

    def of(values: np.ndarray) -> Any:
        return make(name, system).run({"magnetometer": Readings(time, values)}, start)

    assert np.allclose(of(read).x, of(48.0 * read).x, rtol=0, atol=1e-12)
    lost, missing = read.copy(), read.copy()
    lost[5:], missing[5:] = 0.0, np.nan
    assert of(lost).count.sum() == of(missing).count.sum() == 10
    assert np.array_equal(of(lost).deviations, of(missing).deviations)


@pytest.mark.parametrize(
    ("argument", "given"),
    [
        ("scale", 0.0), ("scale", np.nan), ("scale", "much"), ("offset", np.nan), ("offset", "x"), ("delay", "late"),
        ("kind", "angle"), ("gate", "wide"), ("period", "1"), ("outliers", "tukey"),
    ],
)  # fmt: skip
def test_what_a_sensor_cannot_be(argument, given):
    with pytest.raises(ArgumentError) as caught:
        Sensor("tape", "x", **{"deviation": 0.01, argument: given})
    assert caught.value.argument == argument


def test_scales_and_offsets_of_another_size_are_refused():
    for argument in ("scale", "offset"):
        with pytest.raises(ArgumentError) as caught:
            walk(**{argument: [1.0, 2.0, 3.0]})
        assert caught.value.argument == f"tape.{argument}"


def test_a_constant_gain_needs_a_filter_that_settles():
    # a constant velocity without noise is known ever better: its gain goes to zero, and so does that of an oscillator
    c, s = np.cos(0.3), np.sin(0.3)
    for A, Q in (([[1.0, 1.0], [0.0, 1.0]], [1e-4, 0.0]), ([[c, s], [-s, c]], [0.0, 0.0])):
        parts = [StatePart("a"), StatePart("b")]

        def step(x: Any, A: Any = A) -> dict[str, Any]:
            return {"a": A[0][0] * x.a + A[0][1] * x.b, "b": A[1][0] * x.a + A[1][1] * x.b}

        system = System(DiscreteProcess(parts, 0.1, step, Q), [Sensor("a", deviation=0.01, period=0.1)])
        with pytest.raises(ArgumentError, match="no constant gain") as caught:
            SteadyState(system)
        assert caught.value.argument == "system"


@pytest.mark.parametrize("option", [{"delay": 0.1}, {"gate": 0.99}])
def test_interacting_models_use_the_same_readings(option):
    with pytest.raises(ArgumentError, match=f"{next(iter(option))} of 'tape'") as caught:
        Interacting([walk(), walk(**option)])
    assert caught.value.argument == "systems"


def test_known_inputs_that_end_leave_the_buffer_whole():
    class Belt(gt.Model):
        x = gt.variable(unit="m")
        speed = gt.input(unit="m/s")
        slip = gt.input(unit="m/s")

        def equations(self) -> Any:
            yield gt.der(self.x) == self.speed + self.slip

    process = ProcessModel(Belt(), {"slip": 1e-3}, inputs=["speed"])
    system = System(process, [Sensor("tape", "x", deviation=0.01)])
    inputs = gt.Trajectory([0.0, 1.0], {"speed": [1.0, 1.0]}, {"speed": "m/s"})
    start = InitialState({}, {"x": 1.0}, time=0.0)
    buffer = gt.filtering.Buffer(ErrorState(system), start, 10.0, inputs=inputs)
    buffer.push("tape", 0.5, 0.5)
    with pytest.raises(ArgumentError):
        buffer.push("tape", 2.0, 2.0)
    assert buffer.push("tape", 0.4, 0.4) == "went back" and buffer.time == 0.5


def test_stamps_of_a_clock_that_counts_from_1970_are_on_the_grid():
    time = 1.7e9 + 0.1 * np.arange(50)  # to a quarter of a microsecond
    log = {"tape": Readings(time, np.zeros(50))}
    kalman, steady = (make(n, walk(period=0.1)).run(log, InitialState({}, {"x": 0.01})) for n in ("kf", "steady"))
    assert kalman.deviation["x"][-1] == pytest.approx(steady.deviation["x"][-1], rel=1e-9)


def test_readings_that_do_not_change_are_judged():
    run = ErrorState(walk()).run({"tape": Readings(0.1 * np.arange(50), np.zeros(50))}, InitialState({}, {"x": 1.0}))
    said = gt.filtering.consistency(run)
    assert not said.consistent and "are zero" in said.message


def test_what_makes_no_sense_is_refused_by_name():
    log = {"tape": Readings([0.0], [0.0])}
    sensors = [*walk().sensors.values()]
    start: Any = InitialState({}, {"x": 1.0})
    tried: list[tuple[str, Any]] = [
        ("start", lambda: ErrorState(walk()).run(log, {"x": 1.0})),  # type: ignore[arg-type]
        ("start.time", lambda: InitialState({}, {"x": 1.0}, time=np.nan)),
        ("iterations", lambda: ErrorState(walk(), iterations=1.5)),  # type: ignore[arg-type]
        ("level", lambda: gt.filtering.chi_squared_band(10, 1, 1.5)),
        ("longest_step", lambda: System(walk().process, sensors, longest_step=0.0)),
        ("suspects", lambda: gt.filtering.find_faults(walk().process, sensors, log, start, {"tape.offset": 0.0})),
    ]
    for argument, call in tried:
        with pytest.raises(ArgumentError) as caught:
            call()
        assert caught.value.argument == argument


def test_a_quaternion_is_not_measured_as_four_numbers():
    process = DiscreteProcess([StatePart("Q", "quaternion", 4)], 0.1, lambda s: {"Q": s.Q}, [1e-4] * 3)
    with pytest.raises(ArgumentError, match="kind='quaternion'") as caught:  # a change of its sign would count as noise
        System(process, [Sensor("tracker", "Q", deviation=0.01)])
    assert caught.value.argument == "tracker.kind"


@pytest.mark.parametrize(
    "step",
    [
        lambda s, u: {"x": s.y},
        lambda s, u: {"x": s.x + u.speed},
        lambda s, u: {"x": s.x if s.x > 0 else -s.x},
    ],
)
def test_a_step_that_reads_what_is_not_there_or_decides_by_a_symbol_is_refused(step):
    process = DiscreteProcess([StatePart("x")], 0.1, step, [1e-4], inputs={"push": 1})
    with pytest.raises(ArgumentError) as caught:
        System(process, [Sensor("tape", "x", deviation=0.1)])
    assert caught.value.argument == "step"


def test_an_error_within_a_step_is_left_as_it_is():
    process = DiscreteProcess([StatePart("x")], 0.1, lambda s: {"x": s.x + [].nothing}, [1e-4])
    with pytest.raises(AttributeError, match="list"):
        System(process, [Sensor("tape", "x", deviation=0.1)])
