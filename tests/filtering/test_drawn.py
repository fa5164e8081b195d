"""Synthetic runs are of the very start that a filter has; searches that are stopped say so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering import DiscreteProcess, ErrorState, InitialState, Readings, Sensor, StatePart, System, draw
from gtmodel.results.refusal import ArgumentError
from tests.support.carts import START, cart_log, cart_system

RUNS = 400


def plane(**options: Any) -> System:
    process = DiscreteProcess([StatePart("x", size=2, unit="m")], 0.1, lambda s: {"x": s.x}, [0.01, 0.01])
    return System(process, [Sensor("tape", "x", deviation=0.1, **options)])


@pytest.mark.parametrize(
    "start",
    [
        InitialState({}, {"x": [[1.0, 0.99], [0.99, 1.0]]}),  # its correlation was left out
        InitialState({}, {"x": 0.01}, time=-1.0),  # the noise of the first second was left out
    ],
)
def test_drawn_runs_begin_as_the_filter_does(start):
    drawn = draw(plane(), start, 0.1 * np.arange(3), seed=1, runs=RUNS)
    run = ErrorState(plane()).run(drawn.log, start, truth=drawn.truth)
    assert run.nees is not None
    band = gt.filtering.chi_squared_band(RUNS, 2)
    assert run.nees[0].mean() in band and run.nis[0].mean() in band


def test_a_start_after_the_first_instant_cannot_be_drawn():
    with pytest.raises(ArgumentError) as caught:
        draw(plane(), InitialState({}, {"x": 1.0}, time=0.05), [0.0, 0.1], seed=1)
    assert caught.value.argument == "time"


def test_times_that_run_past_a_reading_are_refused():
    start = InitialState({}, {"x": 1.0})
    with pytest.raises(ArgumentError, match=r"\'tape\' reads every 0\.3 s") as caught:
        draw(plane(period=0.3), start, [0.0, 0.1, 0.2, 0.4, 0.5, 0.6], seed=1)
    assert caught.value.argument == "time"
    gap = [0.0, 0.1, 0.2, 0.3, 0.9, 1.0]  # nothing of the time between is there at all
    assert len(draw(plane(period=0.1), start, gap, seed=1).log["tape"]) == 6


def test_a_search_that_is_stopped_gives_what_it_has():
    _, _, log = cart_log(3)
    system = cart_system()
    tuned = gt.filtering.tune(system, log, START, ["tape.deviation"], progress=lambda done: True)
    assert tuned.factors == {"tape.deviation": 1.0} and tuned.improvement == 0.0
    assert tuned.intervals["tape.deviation"] == (0.0, np.inf)
    calls: list[float] = []

    def later(done: float) -> bool:
        calls.append(done)
        return len(calls) > 8

    assert gt.filtering.tune(system, log, START, ["tape.deviation"], progress=later).improvement >= 0.0
    sensors = [*system.sensors.values()]
    suspects = {"unit.offset": 1.0, "tape.deviation": 1.0, "unit.deviation": 1.0}
    search = gt.filtering.find_faults(system.process, sensors, log, START, suspects, progress=lambda done: True)
    assert "stopped before tape.deviation, unit.deviation" in search.message


def test_a_delay_is_sought_in_the_signal_of_its_sensor():
    _, _, log = cart_log(3)
    system, tape = cart_system(), log["tape"]
    values = np.nan_to_num(tape.values[:, 0])
    signals = gt.Trajectory(tape.time, {"other": 1e3 * np.ones(len(tape)), "tape": values})
    sensors, suspects = [*system.sensors.values()], {"tape.delay": 0.1}
    one, two = (
        gt.filtering.find_faults(system.process, sensors, {**log, "tape": given}, START, suspects)
        for given in (signals, Readings(tape.time, values))
    )
    assert np.array_equal(one.suspects[0].value, two.suspects[0].value)
