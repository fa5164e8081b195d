"""The filter in C: the same bytes as its twin in Python, which is the filter of `ErrorState`; hostile inputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.cgen.real import DOUBLE, FLOAT, Real
from gtmodel.cgen.steps.function import copied, dtype_of, record, step_faces
from gtmodel.cgen.verification.comparison import LoadedStep
from gtmodel.filtering import ControllerFilter, InitialState, ProcessModel, Readings, Sensor, System
from gtmodel.results.refusal import ArgumentError
from tests.bench.callgrind import missing
from tests.cgen.calls import shared_library

PERIOD = 0.001
# of the belief beside `ErrorState`: means in deviations, deviations relative; round-off of two orders of summation
SAME = 1e-12
HOSTILE = 4000
# of a step of 18 states and 12 numbers, which may only fall
MOST_BYTES, MOST_INSTRUCTIONS = 11_800, 60_000  # 59,600; libm counts a few more on a processor without FMA
# steps of a run; ten thousand in `make proof`
STEPS = 150
DEVIATIONS = {"p": 1e-3, "v": 0.1, "a": 1.0, "Q": 0.01, "w": 0.1, "alpha": 10.0}


class Cart(gt.Model):
    """A mass that is pushed by a known acceleration and by noise."""

    x = gt.variable(unit="m")
    v = gt.variable(unit="m/s")
    push = gt.input(unit="m/s2")
    a = gt.input(unit="m/s2")

    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == self.a + self.push


class Pendulum(gt.Model):
    """A pendulum that is pushed by a known angular acceleration and by noise."""

    stiffness = gt.parameter(9.81, unit="rad/s2")
    angle = gt.variable(unit="rad")
    rate = gt.variable(unit="rad/s")
    push = gt.input(unit="rad/s2")
    noise = gt.input(unit="rad/s2")

    def equations(self):
        yield gt.der(self.angle) == self.rate
        yield gt.der(self.rate) == self.noise + self.push - self.stiffness * gt.sin(self.angle)


def cart(**options: Any) -> ControllerFilter:
    process = ProcessModel(Cart(), noise={"a": 0.1}, inputs=["push"], states=["x", "v"])
    sensors = [Sensor("tape", "x", deviation=0.01, delay=0.008, gate=0.999), Sensor("wheel", "v", deviation=0.1)]
    return ControllerFilter(System(process, sensors), 0.004, InitialState({}, {"x": 1.0, "v": 1.0}), **options)


def pendulum() -> ControllerFilter:
    """Of three steps in a cycle."""
    process = ProcessModel(Pendulum(), noise={"noise": 0.3}, inputs=["push"], states=["angle", "rate"])
    sensors = [Sensor("encoder", "angle", deviation=1e-3, delay=0.03), Sensor("gyro", "rate", deviation=0.02)]
    return ControllerFilter(System(process, sensors), 0.03, InitialState({"angle": 0.5}, {"angle": 0.1, "rate": 0.3}))


def body(delay: float = 0.0, gate: float | None = None) -> ControllerFilter:
    """18 states; 12 numbers a reading."""
    process = ProcessModel(
        gt.filtering.TurningBody(arm=[-0.18, -0.1, 0.12]), noise={"jerk": 1e2, "angular_jerk": 1e6},
        states=["p", "v", "a", "Q", "w", "alpha"], quaternions=["Q"],
    )  # fmt: skip
    sensors = [
        Sensor("position", "p", deviation=6.4e-6, delay=delay, gate=gate),
        Sensor("attitude", "Q", deviation=2.6e-4, kind="quaternion", delay=delay, gate=gate),
        Sensor("accelerometer", "specific_force", deviation=0.0124),
        Sensor("gyro", "rate", deviation=8.8e-4),
    ]
    return ControllerFilter(System(process, sensors), PERIOD, InitialState({}, DEVIATIONS))


MADE = {"cart": cart, "pendulum": pendulum, "body": body, "late body": lambda: body(0.002, 0.999)}


def a_run(made: ControllerFilter, steps: int, seed: int, missing: float = 0.2, share: float = 1.0) -> np.ndarray:
    """Records of inputs: a state drawn from a share of the process's own noise, readings with noise, some missing."""
    rng, system, plan = np.random.default_rng(seed), made.system, made.plan
    x = made.initial.belief(system, 0.0).x
    rows = np.zeros(steps, dtype_of(made.inputs, DOUBLE))
    u0 = np.zeros(plan.inputs)
    states = [x]
    for k in range(steps):
        u1 = rng.normal(size=plan.inputs)
        step = system.transition(k * made.period, made.period, x, u0, u1)
        scale = np.sqrt(np.diag(step.Q.reshape(plan.errors, plan.errors)))
        x = system.space.plus(step.x, share * scale * rng.normal(size=plan.errors))
        states.append(x)
        for m, value in zip(made.known_members, u1, strict=True):
            rows[m.identifier][k] = value
        for sensor, (value, flag, _, _) in zip(plan.sensors, made.sensor_members, strict=True):
            late = states[max(0, k + 1 - sensor.delay)]
            z = system.read((sensor.name,), 0.0, late, np.zeros((1, plan.inputs)))[0]
            if sensor.quaternion:
                z = system.space.plus(late, np.zeros(plan.errors))[0, 9:13]
            else:
                z = z + sensor.deviation * rng.normal(size=z.shape)
            rows[value.identifier][k] = z.reshape(rows[value.identifier][k].shape)
            rows[flag.identifier][k] = rng.random() > missing
        u0 = u1
    return rows


def the_log(made: ControllerFilter, rows: np.ndarray) -> dict[str, Readings]:
    """The same for `ErrorState`: missing readings are no numbers."""
    log = {}
    for (value, flag, _, _), sensor in zip(made.sensor_members, made.plan.sensors, strict=True):
        z = rows[value.identifier].reshape(len(rows), -1).copy()
        z[rows[flag.identifier] == 0] = np.nan
        # what tells of instants up to the start is not used
        stamps = made.period * np.arange(1, len(rows) + 1)
        log[sensor.name] = Readings(stamps[sensor.delay :], z[sensor.delay :])
    return log


@pytest.fixture(scope="module")
def libraries(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], tuple[ControllerFilter, LoadedStep]]:
    made = {}
    for real in (DOUBLE, FLOAT):
        functions = {name.replace(" ", "_"): make() for name, make in MADE.items()}
        name = f"set{real.name}"
        folder = cgen.generate(functions, tmp_path_factory.mktemp(name) / "c", name=name, real=real.name).folder
        library = shared_library(folder, tmp_path_factory.mktemp("library"))
        assert library[f"gt_{name}_selftest"]() == 0
        for face, key in zip(step_faces(functions, name, real), MADE, strict=True):
            made[key, real.name] = (functions[face.key], LoadedStep(library, face))
    return made


def states_of(loaded: LoadedStep) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start, empty state and outputs."""
    start, state = loaded.face.started()
    return start, state, record(loaded.face.function.outputs, loaded.face.real)


def covariance(made: ControllerFilter, state: np.ndarray) -> np.ndarray:
    """U D U' of what is remembered."""
    U = state["factor"].astype(float).reshape(made.plan.errors, made.plan.stride)[:, : made.plan.errors].T
    assert np.array_equal(U, np.triu(U, 1) + np.eye(len(U)))
    return (U * state["diagonal"].astype(float)) @ U.T


def in_numbers_of(made: ControllerFilter, rows: np.ndarray, real: Real) -> np.ndarray:
    return rows.astype(dtype_of(made.inputs, real))


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("name", list(MADE))
def test_c_and_its_twin_hold_the_same_bytes(name: str, real: str, libraries: dict) -> None:
    made, loaded = libraries[name, real]
    steps = (300 if made.plan.errors < 10 else STEPS) if real == "double" else 100 if made.plan.errors < 10 else 40
    rows = in_numbers_of(made, a_run(made, steps, seed=3), loaded.face.real)
    twin = made.twin(loaded.face.real)
    start, mine, out = states_of(loaded)
    theirs, other = copied(mine), copied(out)
    assert twin.init(mine, start) == loaded.init(theirs, start) == Status.OK
    good = 0
    for row in rows.reshape(-1, 1):
        codes = twin.step(mine, row.reshape(()), out), loaded.step(theirs, row.reshape(()), other)
        assert codes[0] == codes[1]
        assert mine.tobytes() == theirs.tobytes() and out.tobytes() == other.tobytes()
        good += codes[0] == Status.OK
    assert good > 0.9 * steps


@pytest.mark.proof
@pytest.mark.parametrize("name", ["body", "late body"])
def test_ten_thousand_steps_hold_the_same_bytes(name: str, libraries: dict) -> None:
    made, loaded = libraries[name, "double"]
    twin = made.twin(DOUBLE)
    start, mine, out = states_of(loaded)
    theirs, other = copied(mine), copied(out)
    assert twin.init(mine, start) == loaded.init(theirs, start) == Status.OK
    for row in a_run(made, 10_000, seed=4).reshape(-1, 1):
        assert twin.step(mine, row.reshape(()), out) == loaded.step(theirs, row.reshape(()), other) == Status.OK
        assert mine.tobytes() == theirs.tobytes() and out.tobytes() == other.tobytes()


@pytest.mark.parametrize("name", list(MADE))
def test_it_is_the_filter_of_error_state(name: str, libraries: dict) -> None:
    made, loaded = libraries[name, "double"]
    steps, depth, system = 120, made.plan.depth, made.system
    # a little noise: numbers that grow have a round-off of their own, beside deviations that stay
    rows = a_run(made, steps, seed=5, share=1e-3)
    start, state, out = states_of(loaded)
    assert loaded.init(state, start) == Status.OK
    means, covariances, nis, ahead = [], [], [], []
    for row in rows.reshape(-1, 1):
        assert loaded.step(state, row.reshape(()), out) == Status.OK
        means.append(state["mean"].copy())
        covariances.append(covariance(made, state))
        nis.append(float(out["nis"]))
        ahead.append([out[m.identifier].copy() for m in made.mean_members])
    t = made.period * np.arange(0, steps + 1)
    names = [m.identifier for m in made.known_members]
    known = {"push": np.concatenate([[0.0], rows[names[0]]])} if names else {}
    inputs = gt.Trajectory(t, known) if known else None
    first = InitialState(made.initial.mean, made.initial.deviation, time=0.0)
    run = gt.filtering.ErrorState(system).run(the_log(made, rows), first, inputs=inputs, keep=True)
    assert run.kept is not None
    at = {round(k.after.time / made.period): (k, float(v)) for k, v in zip(run.kept, run.nis[:, 0], strict=True)}
    for c in range(depth, steps):
        kept, value = at[c + 1 - depth]
        deviation = np.sqrt(np.diag(kept.after.P[0]))
        far = system.space.minus(means[c], kept.after.x[0]) / deviation
        wide = np.sqrt(np.diag(covariances[c])) / deviation - 1
        assert np.max(np.abs(far)) < SAME and np.max(np.abs(wide)) < SAME, c
        assert nis[c] == pytest.approx(value, rel=1e-9, abs=1e-9)
    # with delays, what is known of the present is the filter on what has come
    last, (final, _) = np.concatenate([np.ravel(v) for v in ahead[-1]]), at[steps]
    far = system.space.minus(last, final.after.x[0]) / np.sqrt(np.diag(final.after.P[0]))
    assert np.max(np.abs(far)) < SAME


def hostile(made: ControllerFilter, rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rows with numbers that no sensor should send."""
    bad = rows.copy()
    for value, flag, _, _ in made.sensor_members:
        numbers = bad[value.identifier].reshape(len(bad), -1)
        kind = rng.integers(8, size=len(bad))
        column = rng.integers(numbers.shape[1], size=len(bad))
        at = np.arange(len(bad))
        for k, what in enumerate((np.nan, np.inf, -np.inf, 5e-324, 0.0)):
            numbers[at[kind == k], column[kind == k]] = what
        numbers[kind == 5] *= 10.0 ** rng.uniform(-320, 300, (int(np.sum(kind == 5)), 1))
        bad[flag.identifier] = rng.random(len(bad)) > 0.5
    return bad


def tried(made: ControllerFilter, loaded: LoadedStep, count: int, seed: int) -> dict[Status, int]:
    """How hostile steps end; each from a state of a good run, which goes on from what C leaves."""
    rng = np.random.default_rng(seed)
    rows = a_run(made, 50, seed)
    with np.errstate(over="ignore"):
        bad = in_numbers_of(made, hostile(made, rows[rng.integers(len(rows), size=count)], rng), loaded.face.real)
    start, state, out = states_of(loaded)
    loaded.init(state, start)
    ended = dict.fromkeys(Status, 0)
    for k, row in enumerate(bad.reshape(-1, 1)):
        if k % 50 == 0:
            assert loaded.init(state, start) == Status.OK
        before = state.tobytes(), out.tobytes()
        with np.errstate(all="ignore"):
            status = loaded.step(state, row.reshape(()), out)
        ended[status] += 1
        if status != Status.OK:
            assert (state.tobytes(), out.tobytes()) == before
            continue
        assert all(np.all(np.isfinite(out[name])) for name in out.dtype.names or ())
        assert np.all(state["diagonal"] > 0)
        P = covariance(made, state)
        scale = 1 / np.sqrt(np.diag(P))
        np.linalg.cholesky(P * scale[:, None] * scale)  # raises where it is not positive
    return ended


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("name", ["cart", "body", "late body"])
def test_hostile_inputs_leave_no_guess(name: str, real: str, libraries: dict) -> None:
    made, loaded = libraries[name, real]
    ended = tried(made, loaded, HOSTILE, seed=6)
    assert ended[Status.OK] > HOSTILE / 50 and ended[Status.NOT_FINITE] > HOSTILE / 10
    assert ended[Status.OUT_OF_RANGE] > 0


@pytest.mark.skipif(missing() is not None, reason=str(missing()))
def test_what_a_step_costs(tmp_path: Path) -> None:
    """Counted on x86-64 by gcc 12: below 12,000 bytes and 60,000 instructions."""
    made = {"pose": body()}
    cgen.generate(made, tmp_path / "c", name="cost")
    cost = cgen.costs(tmp_path / "c", made)
    assert cost.text_bytes["gt_cost_pose"] <= MOST_BYTES
    assert cost.instructions["gt_cost_pose"] <= MOST_INSTRUCTIONS


@pytest.mark.proof
@pytest.mark.parametrize("real", ["double", "float"])
def test_a_hundred_thousand_hostile_inputs(real: str, libraries: dict) -> None:
    made, loaded = libraries["body", real]
    assert tried(made, loaded, 100_000, seed=7)[Status.OK] > 1000


@pytest.mark.parametrize("steps", [10_000, pytest.param(1_000_000, marks=pytest.mark.proof)])
def test_the_covariance_stays_positive(steps: int, libraries: dict) -> None:
    made, loaded = libraries["body", "double"]
    rows = a_run(made, 200, seed=8)
    start, state, out = states_of(loaded)
    assert loaded.init(state, start) == Status.OK
    at = [rows[k : k + 1].reshape(()) for k in range(len(rows))]
    for k in range(steps):
        # to and fro over the same readings: they stay near each other
        place = k % (2 * len(at))
        assert loaded.step(state, at[min(place, 2 * len(at) - 1 - place)], out) == Status.OK
    P = covariance(made, state)
    scale = 1 / np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P * scale[:, None] * scale)[0] > 1e-9


def test_a_sensor_that_is_silent_or_beyond_its_gate_for_too_long_is_said(tmp_path: Path) -> None:
    made = cart(stale={"wheel": 3}, closed={"tape": 4})
    folder = cgen.generate({"cart": made}, tmp_path / "c", name="watched").folder
    loaded = LoadedStep(shared_library(folder, tmp_path), step_faces({"cart": made}, "watched", DOUBLE)[0])
    start, state, out = states_of(loaded)
    silent = record(made.inputs, DOUBLE, {"tape.valid": 1})
    loaded.init(state, start)
    codes = [loaded.step(state, silent, out) for _ in range(5)]
    assert codes == [Status.OK] * 3 + [Status.STALE_INPUT] * 2
    assert int(out["wheel_age"]) == 3
    far = record(made.inputs, DOUBLE, {"tape": 100.0, "tape.valid": 1, "wheel.valid": 1})
    assert loaded.init(state, start) == Status.OK
    codes = [loaded.step(state, far, out) for _ in range(8)]
    # the first readings tell of instants before the start, two cycles
    assert codes == [Status.OK] * 6 + [Status.OUT_OF_RANGE] * 2
    assert int(out["tape_gated"]) == 1 and int(out["count"]) == 1


def test_a_start_that_is_none_is_refused(libraries: dict) -> None:
    made, loaded = libraries["body", "double"]
    start, state, _ = states_of(loaded)
    twin = made.twin(DOUBLE)
    for name, value, status in (
        ("p_m", np.nan, Status.NOT_FINITE), ("Q", 1.0, Status.OUT_OF_RANGE),
        ("v_deviation_m_s", 0.0, Status.OUT_OF_RANGE), ("v_deviation_m_s", 1e200, Status.OUT_OF_RANGE),
    ):  # fmt: skip
        wrong, before = start.copy(), state.tobytes()
        wrong[name] = value
        assert loaded.init(state, wrong) == twin.init(state, wrong) == status
        assert state.tobytes() == before


def test_two_of_them_do_not_meet(libraries: dict) -> None:
    made, loaded = libraries["body", "double"]
    rows = a_run(made, 20, seed=9)
    start, one, out = states_of(loaded)
    loaded.init(one, start)
    two = copied(one)
    for row in rows.reshape(-1, 1):
        loaded.step(one, row.reshape(()), out)
        loaded.step(two, rows[:1].reshape(()), out)
    alone = copied(one)
    loaded.init(alone, start)
    for row in rows.reshape(-1, 1):
        loaded.step(alone, row.reshape(()), out)
    assert alone.tobytes() == one.tobytes()


def test_what_c_does_not_know_is_refused() -> None:
    process = ProcessModel(Cart(), noise={"a": 0.1}, inputs=["push"], states=["x", "v"])
    start = InitialState({}, {"x": 1.0, "v": 1.0})
    late = System(process, [Sensor("tape", "x", deviation=0.01, delay=0.005)])
    with pytest.raises(ArgumentError, match="is not a multiple"):
        ControllerFilter(late, 0.004, start)
    system = System(process, [Sensor("tape", "x", deviation=0.01)])
    with pytest.raises(ArgumentError, match="no sensor 'wheel'"):
        ControllerFilter(system, 0.004, start, stale={"wheel": 3})
    with pytest.raises(ArgumentError, match="more than 0 s"):
        ControllerFilter(system, 0.0, start)
    with pytest.raises(ArgumentError, match="above zero"):
        ControllerFilter(system, 0.004, InitialState({}, {"x": 1.0, "v": 0.0}))
