"""A filter on a log with noise and start that nobody knows: three models of a user, rest, likelihood, C.

All logs are synthetic; their seeds stand beside them.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.cgen.real import DOUBLE
from gtmodel.cgen.steps.function import copied, dtype_of, record, step_faces
from gtmodel.cgen.verification.comparison import LoadedStep
from gtmodel.filtering import ControllerFilter, ErrorState, InitialState, Readings, RestingLog
from gtmodel.results import ArgumentError
from tests.cgen.calls import shared_library
from tests.support import belt_drive

F = gt.filtering
FAR = 3.3  # standard deviations of an estimate: one in a thousand is further off
WRONG = 3.0  # times a true deviation
SAME = 1e-9  # of means in deviations: two orders of summation over a whole log


class CoordinatedTurn(gt.Model):
    """A vehicle in the plane, whose thrust and yaw acceleration are unknown."""

    x, y = gt.variable(unit="m"), gt.variable(unit="m")
    speed, heading, turn = gt.variable(unit="m/s"), gt.variable(unit="rad"), gt.variable(unit="rad/s")
    thrust, yaw = gt.input(unit="m/s2"), gt.input(unit="rad/s2")

    def equations(self):
        yield gt.der(self.x) == self.speed * gt.cos(self.heading)
        yield gt.der(self.y) == self.speed * gt.sin(self.heading)
        yield gt.der(self.speed) == self.thrust
        yield gt.der(self.heading) == self.turn
        yield gt.der(self.turn) == self.yaw


class Pendulum(gt.Model):
    """A pendulum with an encoder, and an accelerometer along its rod."""

    length, gravity = gt.parameter(0.8, unit="m"), gt.parameter(9.81, unit="m/s2")
    damping = gt.parameter(0.15, unit="1/s")
    angle, rate = gt.variable(unit="rad"), gt.variable(unit="rad/s")
    radial = gt.variable(unit="m/s2")
    push = gt.input(unit="rad/s2")

    def equations(self):
        yield gt.der(self.angle) == self.rate
        weight = self.gravity / self.length * gt.sin(self.angle)
        yield gt.der(self.rate) == self.push - self.damping * self.rate - weight
        yield self.radial == self.length * self.rate**2 + self.gravity * gt.cos(self.angle)


class Own(NamedTuple):
    """A model of a user: the system with its true noise, start, known inputs, period, and seed of the log."""

    system: F.System
    start: InitialState
    inputs: gt.Trajectory | None
    period: float
    seed: int


STEPS = 400


def turn() -> Own:
    process = F.ProcessModel(
        CoordinatedTurn(), {"thrust": 0.5, "yaw": 0.05}, states=["x", "y", "speed", "heading", "turn"]
    )
    system = F.System(process, [F.Sensor("x", deviation=0.1), F.Sensor("y", deviation=0.1)], longest_step=0.05)
    deviation = {"x": 0.5, "y": 0.5, "speed": 0.5, "heading": 0.2, "turn": 0.2}
    return Own(system, InitialState({"speed": 3.0}, deviation), None, 0.1, 1)


def pendulum() -> Own:
    process = F.ProcessModel(Pendulum(), {"push": 0.5}, states=["angle", "rate"])
    sensors = [F.Sensor("encoder", "angle", deviation=0.01), F.Sensor("accelerometer", "radial", deviation=0.2)]
    start = InitialState({"angle": 0.8}, {"angle": 0.05, "rate": 0.1})
    return Own(F.System(process, sensors), start, None, 0.02, 2)


def belt() -> Own:
    deviation = {"motor": 0.01, "load": 0.01, "motor_rate": 0.1, "load_rate": 0.1}
    return Own(belt_drive.system(), InitialState({}, deviation), belt_drive.torque(), belt_drive.PERIOD, 3)


MADE = {"turn": turn, "pendulum": pendulum, "belt": belt}


@cache
def logged(name: str) -> tuple[Own, dict[str, Readings]]:
    own = MADE[name]()
    times = own.period * np.arange(STEPS)
    return own, F.draw(own.system, own.start, times, seed=own.seed, inputs=own.inputs).log


@cache
def estimated(name: str) -> tuple[Own, dict[str, Readings], F.FilterStudy, F.System]:
    """A model, its log, the study that estimates all of its noise, and the system with the estimates."""
    own, log = logged(name)
    noise = own.system.process.noise
    names = [*(f"{n}.deviation" for n in own.system.sensors), *(f"{n}.density" for n in noise)]
    # nothing is known: all noise is declared as 1, in its unit
    blank = own.system.with_(dict.fromkeys(noise, 1.0), dict.fromkeys(own.system.sensors, 1.0))
    start = F.FilterStart(own.start.mean, own.start.deviation)
    study = F.filter_study(blank, start, log, inputs=own.inputs, estimate=names)
    found = own.system.with_(
        {n: study.noise[f"{n}.density"][0] for n in noise},
        {n: study.noise[f"{n}.deviation"] for n in own.system.sensors},
    )
    return own, log, study, found


def true_noise(system: F.System) -> dict[str, float]:
    deviations = {f"{n}.deviation": float(d[0]) for n, d in system.deviations.items()}
    return deviations | {f"{n}.density": float(q) for n, q in system.process.noise.items()}


# each estimate takes 10 s: that of one model each time
ONE = pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.proof] * (n != "pendulum")) for n in MADE])


@ONE
def test_noise_of_three_models_is_estimated_and_their_nis_is_in_its_band(name: str) -> None:
    own, log, study, _ = estimated(name)
    assert study.status.ok and not study.notes and set(study.noise_source.values()) == {"likelihood"}
    low, high = study.nis_band
    assert low < study.nis < high and "agree with the filter" in study.verdict
    for key, truth in true_noise(own.system).items():
        (value,), (begin,), (end,) = study.noise[key], study.noise_low[key], study.noise_high[key]
        spread = np.log(end / begin) / 2 / 1.96
        assert abs(np.log(value / truth)) < FAR * spread and spread < 0.5, key
    # the same data with a sensor declared three times as good as it is
    sensor = next(iter(log))
    wrong = own.system.with_(deviations={sensor: own.system.deviations[sensor] / WRONG})
    alarm = F.filter_study(wrong, F.FilterStart(own.start.mean, own.start.deviation), log, inputs=own.inputs)
    assert alarm.nis > alarm.nis_band[1] and sensor in alarm.verdict


@ONE
def test_c_equals_python_over_the_log(name: str, tmp_path: Path) -> None:
    own, log, study, found = estimated(name)
    made = ControllerFilter(found, own.period, InitialState(study.start, study.start_deviation))
    folder = cgen.generate({name: made}, tmp_path / "c", name="own").folder
    (face,) = step_faces({name: made}, "own", DOUBLE)
    library = LoadedStep(shared_library(folder, tmp_path), face)
    rows = np.zeros(STEPS, dtype_of(made.inputs, DOUBLE))
    for value, flag, _, _ in made.sensor_members:
        rows[value.identifier], rows[flag.identifier] = log[value.name].values[:, 0], 1
    for known in made.known_members:
        rows[known.identifier] = own.inputs[known.name][:STEPS]
    twin = made.twin(DOUBLE)
    start, mine = library.face.started()
    out = record(made.outputs, DOUBLE)
    theirs, other = copied(mine), copied(out)
    assert twin.init(mine, start) == library.init(theirs, start) == Status.OK
    nis, means = [], []
    for row in rows.reshape(-1, 1):
        codes = twin.step(mine, row.reshape(()), out), library.step(theirs, row.reshape(()), other)
        assert codes == (Status.OK, Status.OK)
        assert mine.tobytes() == theirs.tobytes() and out.tobytes() == other.tobytes()
        nis.append(float(other["nis"]))
        means.append(np.concatenate([np.ravel(other[m.identifier]) for m in made.mean_members]))
    low, high = study.nis_band
    assert low < np.mean(nis) < high
    # the filter of the study, from a start one period before the first reading, as in C
    begin = InitialState(study.start, study.start_deviation, time=-own.period)
    inputs = own.inputs
    if inputs is not None:  # C holds the start's input, zero, before the first step
        time = np.concatenate([[-own.period], inputs.time])
        inputs = gt.Trajectory(time, {n: np.concatenate([[0.0], inputs[n]]) for n in inputs.names})
    run = ErrorState(found).run(log, begin, inputs=inputs)
    assert np.max(np.abs(np.array(means) - run.x[:, 0]) / run.deviations[:, 0]) < SAME
    assert nis == pytest.approx(run.nis[:, 0], rel=1e-6, abs=1e-9)


def cart(**noise: float) -> F.ProcessModel:
    class Cart(gt.Model):
        x, v = gt.variable(unit="m"), gt.variable(unit="m/s")
        a, b = gt.input(unit="m/s2"), gt.input(unit="m/s2")

        def equations(self):
            yield gt.der(self.x) == self.v
            yield gt.der(self.v) == self.a + self.b

    return F.ProcessModel(Cart(), noise, states=["x", "v"])


def cart_log(deviation: float, seed: int, **noise: float) -> tuple[F.System, F.FilterStart, dict[str, Readings]]:
    system = F.System(cart(**noise), [F.Sensor("tape", "x", deviation=deviation)])
    start = F.FilterStart({}, {"x": 1.0, "v": 1.0})
    return system, start, F.draw(system, InitialState({}, start.deviation), 0.05 * np.arange(200), seed=seed).log


def test_noises_that_cannot_be_told_apart_are_named_together() -> None:
    system, start, log = cart_log(0.01, 1, a=0.5, b=0.5)
    study = F.filter_study(system, start, log, estimate=["tape.deviation", "a.density", "b.density"])
    assert set(study.noise_undetermined) == {"a.density", "b.density"}
    assert any("a.density and b.density cannot be told apart" in note for note in study.notes)
    assert study.noise_high["a.density"] == [np.inf] and np.isfinite(study.noise_high["tape.deviation"][0])
    # their sum is determined: the variances of independent noises add
    assert sum(study.noise[f"{n}.density"][0] for n in "ab") == pytest.approx(1.0, rel=0.5)
    assert study.nis_band[0] < study.nis < study.nis_band[1]


def test_a_flat_likelihood_is_said_with_the_bound_that_the_log_shows() -> None:
    system, start, log = cart_log(0.1, 1, a=1e-9, b=1e-9)
    study = F.filter_study(system.with_({"a": 1.0}), start, log, estimate=["a.density"])
    assert list(study.noise_undetermined) == ["a.density"]
    assert any("flat in a.density" in note and "at most" in note for note in study.notes)
    assert study.noise_low["a.density"] == [0.0] and 1e-9 < study.noise_high["a.density"][0] < 0.01


def at_rest(deviation: float = 0.02, count: int = 400, seed: int = 5, mean: float = 0.3) -> RestingLog:
    noise = deviation * np.random.default_rng(seed).standard_normal(count)
    return RestingLog({"tape": Readings(0.01 * np.arange(count), mean + noise)})


def test_deviation_and_start_come_from_the_rest() -> None:
    system, _, log = cart_log(0.02, 4, a=0.5, b=1e-9)
    rest = at_rest()
    values = rest.readings["tape"].values[:, 0]
    study = F.filter_study(
        system.with_(deviations={"tape": 1.0}), F.FilterStart(from_rest=True), log, estimate=["tape.deviation"],
        rest=rest,
    )  # fmt: skip
    assert study.noise["tape.deviation"] == pytest.approx([np.std(values, ddof=1)], rel=1e-12)
    assert study.noise_source == {"tape.deviation": "rest"}
    assert study.noise_low["tape.deviation"][0] < 0.02 < study.noise_high["tape.deviation"][0]
    assert study.start["x"] == pytest.approx([values.mean()]) and study.start["v"] == pytest.approx([0.0], abs=1e-12)
    # the mean's variance, and the noise of the process over one period of the log: q h^3 / 3 and q h
    h, q, blocks = 0.05, 0.5 + 1e-9, np.array_split(values - values.mean(), 16)
    mean = max(np.std(values, ddof=1) / 20, np.std([b.mean() for b in blocks], ddof=1) / 4)
    assert study.start_deviation["x"] == pytest.approx([np.sqrt(mean**2 + q * h**3 / 3)], rel=1e-9)
    assert study.start_deviation["v"] == pytest.approx([np.sqrt(q * h)], rel=1e-9)


def moving() -> RestingLog:
    rest = at_rest().readings["tape"]
    return RestingLog({"tape": Readings(rest.time, rest.values + 0.03 * rest.time[:, None])})


@pytest.mark.parametrize(
    ("rest", "words"),
    [
        (moving(), "not at rest"),
        (at_rest(deviation=0.0), "do not change"),
        (at_rest(count=10), "at least 20"),
        (RestingLog({}), "holds no reading"),
        (RestingLog({"laser": at_rest().readings["tape"]}), "no sensor 'laser'"),
        ((50.0, 60.0), "no readings from 50"),
        ((3.0, 2.0), "begin before the end"),
        (None, "needs a log at rest"),
    ],
)
def test_a_rest_that_is_none_is_rejected(rest: Any, words: str) -> None:
    system, _, log = cart_log(0.02, 4, a=0.5, b=1e-9)
    with pytest.raises(ArgumentError, match=words):
        F.filter_study(system, F.FilterStart(from_rest=True), log, estimate=["tape.deviation"], rest=rest)


def test_clean_rests_are_accepted() -> None:
    """The test of rest: no false alarm in 200 logs with white noise, and a note on coloured noise."""
    system, _, _ = cart_log(0.02, 4, a=0.5, b=1e-9)
    from gtmodel.filtering.resting import sensor_at_rest

    tested = [sensor_at_rest(system, at_rest(seed=seed), "tape") for seed in range(200)]
    assert sum(bool(sensor.notes) for sensor in tested) <= 2  # of the test of colour, one in a thousand
    # the 95 % interval holds the truth in 190 of 200, plus or minus 3.3 binomial deviations
    assert 180 <= sum(bool(sensor.low[0] < 0.02 < sensor.high[0]) for sensor in tested) <= 199
    noise = np.random.default_rng(8).standard_normal(402)
    coloured = Readings(0.01 * np.arange(400), 0.02 * (noise[2:] + noise[1:-1] + noise[:-2]))
    found = sensor_at_rest(system, RestingLog({"tape": coloured}), "tape")
    assert "coloured" in found.notes[0] and found.high[0] / found.low[0] > 1.15


def test_a_rest_does_not_show_a_heading_and_says_so() -> None:
    own = turn()
    rng = np.random.default_rng(6)
    rest = RestingLog(
        {n: Readings(0.1 * np.arange(100), v + 0.1 * rng.standard_normal(100)) for n, v in (("x", 1.0), ("y", 2.0))}
    )
    log = logged("turn")[1]
    with pytest.raises(ArgumentError, match="do not determine 'heading'") as caught:
        F.filter_study(own.system, F.FilterStart(from_rest=True), log, rest=rest)
    assert caught.value.argument == "start.deviation"
    study = F.filter_study(
        own.system, F.FilterStart({"heading": 0.4}, {"heading": 0.1}, from_rest=True), log, rest=rest
    )
    assert study.start["heading"] == pytest.approx([0.4]) and study.start["speed"] == pytest.approx([0.0], abs=1e-9)
    assert study.start["x"] == pytest.approx([1.0], abs=0.05) and study.start["turn"] == pytest.approx([0], abs=1e-9)


def test_a_pendulum_held_at_an_angle_starts_there_and_an_offset_is_said() -> None:
    own = pendulum()
    rng = np.random.default_rng(7)
    time = 0.02 * np.arange(200)

    def rest(offset: float) -> RestingLog:
        angle = Readings(time, 0.8 + 0.01 * rng.standard_normal(200))
        force = Readings(time, 9.81 * np.cos(0.8) + offset + 0.2 * rng.standard_normal(200))
        return RestingLog({"encoder": angle, "accelerometer": force})

    log = logged("pendulum")[1]
    start = F.FilterStart(from_rest=True)
    held = F.filter_study(own.system, start, log, rest=rest(0.0))
    assert held.start["angle"] == pytest.approx([0.8], abs=4e-3) and held.start["rate"] == pytest.approx([0], abs=1e-9)
    assert not any("disagree" in note for note in held.notes)
    off = F.filter_study(own.system, start, log, rest=rest(0.5))
    assert any("disagree" in note and "accelerometer" in note for note in off.notes)


def test_the_shipped_log_is_that_of_its_program() -> None:
    shipped = np.loadtxt(belt_drive.FILE, delimiter=",", skiprows=2)
    assert shipped == pytest.approx(np.column_stack([*belt_drive.columns().values()]), rel=1e-6, abs=1e-9)
