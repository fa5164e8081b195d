"""Outliers: weights after Huber, gates, and what both leave of innovations and likelihood."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering import DiscreteProcess, ErrorState, InitialState, Readings, Sensor, StatePart, System, make
from gtmodel.results.refusal import ArgumentError

START = InitialState({}, {"x": 0.1})
TIME = 0.1 * np.arange(300)


def walk(size: int = 1, unit: float = 1.0, **options: Any) -> System:
    """A walk of some numbers, in a unit in which it is `unit` times as large."""
    parts = [StatePart("x", size=size, unit="m")]
    process = DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, size * [1e-6 * unit**2])
    return System(process, [Sensor("tape", "x", deviation=0.01 * unit, **options)])


def drawn(system: System, runs: int, share: float = 0.0) -> Any:
    """Synthetic: of these readings a share is off by noise of ten deviations."""
    made = gt.filtering.draw(system, START, TIME, seed=1, runs=runs)
    rng = np.random.default_rng(2)
    values = made.log["tape"].values.copy()
    hit = rng.random(values.shape[:2]) < share
    values[hit] += 0.1 * rng.standard_normal(values[hit].shape)
    return made.truth, {"tape": Readings(made.time, values)}


def square(run: Any) -> float:
    return float(np.mean(run.errors[50:] ** 2))


@pytest.mark.parametrize("size", [1, 3])
def test_of_right_readings_weights_cost_some_per_cent(size):
    truth, log = drawn(walk(size), 200)
    plain, robust = (
        ErrorState(s).run(log, START, truth=truth, keep=False) for s in (walk(size), walk(size, outliers="huber"))
    )
    # Huber's 5 % is for a fixed place found from many readings; less for one that moves
    assert 1.01 < square(robust) / square(plain) < 1.06
    said = gt.filtering.consistency(robust)
    assert said.consistent, said.message
    assert said.expected < 0.9 * said.numbers
    share = robust.weighed["tape"].sum() / robust.count.sum() * size
    assert share == pytest.approx(2 * 0.08931, abs=0.01)  # of the normal distribution beyond 1.345
    assert robust.notes == ()


def test_of_readings_with_outliers_the_error_falls():
    truth, log = drawn(walk(), 100, share=0.1)
    clean_truth, clean = drawn(walk(), 100)
    right = square(ErrorState(walk()).run(clean, START, truth=clean_truth, keep=False))
    plain, robust = (ErrorState(s).run(log, START, truth=truth, keep=False) for s in (walk(), walk(outliers="huber")))
    assert np.sqrt(square(plain) / right) > 2.3
    assert np.sqrt(square(robust) / right) < 1.2
    assert plain.nees is not None and robust.nees is not None
    assert plain.nees[50:].mean() > 5 > 1.3 > robust.nees[50:].mean()


def test_too_many_are_said():
    _, log = drawn(walk(), 20)
    run = ErrorState(walk(outliers="huber").with_(deviations={"tape": 0.004})).run(log, START, keep=False)
    assert len(run.notes) == 1 and "counted less as outliers" in run.notes[0]


@pytest.mark.parametrize("name", ["iekf", "ukf", "imm", "particle"])
def test_all_filters_weigh_alike(name):
    _, log = drawn(walk(outliers="huber"), 1, share=0.1)
    log = {"tape": Readings(TIME, log["tape"].values)}
    system = walk(outliers="huber", gate=0.99999)
    exact = ErrorState(system).run(log, START)
    several = [system, system.with_()] if name == "imm" else system
    run = make(name, several, **({"particles": 3000} if name == "particle" else {})).run(log, START)
    limit = 0.2 if name == "particle" else 1e-9
    assert np.max(np.abs(run.x - exact.x) / exact.deviations) < limit
    if name != "particle":
        assert run.weighed["tape"] == exact.weighed["tape"] and run.gated["tape"] == exact.gated["tape"]
    if name in ("iekf", "ukf"):
        assert np.allclose(run.log_likelihood, exact.log_likelihood, rtol=1e-9)


def test_the_weight_is_that_of_a_single_reading_by_hand():
    system = walk(outliers="huber")
    z = 0.5
    run = ErrorState(system).run({"tape": Readings([0.0], [z])}, START)
    P, R = 0.1**2, 0.01**2
    distance = z / np.sqrt(P + R)
    larger = R * distance / 1.345
    assert run["x"][0] == pytest.approx(P * z / (P + larger), rel=1e-12)
    assert run.deviation["x"][0] == pytest.approx(np.sqrt(P * larger / (P + larger)), rel=1e-12)
    assert run.nis[0, 0] == pytest.approx(1.345**2) and run.innovations["tape"][0, 0, 0] == pytest.approx(1.345)


@pytest.mark.parametrize(
    ("options", "unit"),
    [
        ({"outliers": "huber"}, 1.0),
        pytest.param({"outliers": "huber"}, 1e4, marks=pytest.mark.proof),
        ({"gate": 0.999}, 1.0),
        ({"gate": 0.999}, 1e4),  # in large numbers a closed gate was likelier than an open one
    ],
)
def test_a_factor_on_the_noise_is_found_with_weights_and_with_gates(options, unit):
    system = walk(unit=unit, **options)
    start = InitialState({}, {"x": 0.1 * unit})
    log = gt.filtering.draw(system, start, TIME, seed=3).log
    process = gt.filtering.tune(system.with_(deviations={"tape": 0.005 * unit}), log, start, ["tape.deviation"])
    assert 0.0085 * unit < process.values["tape.deviation"][0] < 0.0115 * unit


@pytest.mark.parametrize("gate", [0.999, 0.99])
def test_a_right_filter_with_a_gate_is_consistent(gate):
    # what a gate leaves out is missing from the squares: 5 % of them at 0.99
    system = walk(gate=gate)
    log = gt.filtering.draw(system, START, TIME, seed=5, runs=300).log
    said = gt.filtering.consistency(ErrorState(system).run(log, START, keep=False))
    assert said.consistent, said.message
    assert said.expected < said.numbers


def test_faults_are_sought_in_what_the_gates_leave():
    process = DiscreteProcess([StatePart("x", unit="m")], 0.1, lambda s: {"x": s.x}, [1e-6])
    sensors = [Sensor("tape", "x", deviation=0.01, gate=0.9999), Sensor("laser", "x", deviation=0.01)]
    log = dict(gt.filtering.draw(System(process, sensors), START, TIME, seed=6).log)
    values = log["tape"].values.copy()
    values[10:290:40] += 1.0  # a hundred deviations, all to one side
    log["tape"] = Readings(TIME, values)
    search = gt.filtering.find_faults(process, sensors, log, START, {"tape.offset": 0.1})
    assert search.named == () and abs(search.suspects[0].value[0]) < 4 * search.suspects[0].deviation[0]


def test_where_it_is_not_known_it_is_refused():
    system = walk(outliers="huber", period=0.1)
    with pytest.raises(ArgumentError) as caught:
        make("steady", system)
    assert caught.value.argument == "system"
    with pytest.raises(ArgumentError) as caught:
        gt.filtering.find_faults(system.process, [*system.sensors.values()], {}, START, {"tape.offset": 0.1})
    assert caught.value.argument == "sensors"


def test_a_moving_horizon_and_c_refuse_weights():
    class Walk(gt.Model):
        x = gt.variable(unit="m")
        drift = gt.input(unit="m/s")

        def equations(self) -> Any:
            yield gt.der(self.x) == self.drift

    process = gt.filtering.ProcessModel(Walk(), {"drift": 1e-4})
    system = System(process, [Sensor("x", deviation=0.01, outliers="huber")])
    with pytest.raises(ArgumentError) as caught:
        gt.filtering.MovingHorizon(system)
    assert caught.value.argument == "system"
    with pytest.raises(ArgumentError, match="'x' weighs outliers") as caught:
        gt.filtering.ControllerFilter(system, 0.01, START)
    assert caught.value.argument == "outliers"
