"""Known inputs that are sampled faster than the sensors read: all of their rows count."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering import ErrorState, InitialState, ProcessModel, Readings, Sensor, System, make

TIME = 0.01 * np.arange(101)
START = InitialState({}, {"x": 0.1, "heading": 0.1}, time=0.0)


class Unicycle(gt.Model):
    """Driven by wheels at 100 Hz, seen now and then."""

    x = gt.variable(unit="m")
    heading = gt.variable(unit="rad")
    speed = gt.input(unit="m/s")
    turn = gt.input(unit="rad/s")
    slip = gt.input(unit="m/s")
    skid = gt.input(unit="rad/s")

    def equations(self) -> Any:
        yield gt.der(self.x) == self.speed * gt.cos(self.heading) + self.slip
        yield gt.der(self.heading) == self.turn + self.skid


class Belt(gt.Model):
    x = gt.variable(unit="m")
    heading = gt.variable(unit="rad")
    speed = gt.input(unit="m/s")
    turn = gt.input(unit="rad/s")
    slip = gt.input(unit="m/s")
    skid = gt.input(unit="rad/s")

    def equations(self) -> Any:
        yield gt.der(self.x) == self.speed + self.slip
        yield gt.der(self.heading) == self.turn + self.skid


def system_of(model: gt.Model) -> System:
    noise, states = {"slip": 1e-4, "skid": 1e-4}, ["x", "heading"]
    process = ProcessModel(model, noise, inputs=["speed", "turn"], states=states)
    sensors = [Sensor("gps", "x", deviation=0.05, period=0.2), Sensor("compass", "heading", deviation=0.05, period=0.2)]
    return System(process, sensors)


def wheels() -> gt.Trajectory:
    values = {"speed": 2 * np.sin(5 * np.pi * TIME) ** 2, "turn": 3 * np.cos(10 * np.pi * TIME)}
    return gt.Trajectory(TIME, values, {"speed": "m/s", "turn": "rad/s"})


def seen(every: int) -> dict[str, Readings]:
    """A reading at each `every`th row of the inputs; between those that count, missing ones."""
    values = np.full(101, np.nan)
    values[::20] = np.linspace(0.0, 1.0, 6)
    return {name: Readings(TIME[::every], values[::every]) for name in ("gps", "compass")}


@pytest.mark.parametrize("name", ["ekf", "iekf", "ukf", "imm", "steady", "kf"])
def test_rows_between_readings_count(name):
    system = system_of(Belt() if name in ("kf", "steady") else Unicycle())
    made = [system, system.with_()] if name == "imm" else system
    few = make(name, made).run(seen(20), START, inputs=wheels())
    dense = make("kf" if name == "steady" else name, made)
    if name == "steady":  # that of the inputs themselves: 1 m in the mean of the squared sine
        assert few["x"][-1] == pytest.approx(1.0, abs=0.05)
        return
    every = dense.run(seen(1), START, inputs=wheels())
    # the same steps in the same order, but for the mixing of modes, which equal models do not show
    assert np.max(np.abs(few.x - every.x[::20]) / few.deviations) < 1e-9
    assert np.allclose(few.deviations, every.deviations[::20], rtol=1e-9)
    if name != "imm":
        one, two = gt.filtering.smooth(few), gt.filtering.smooth(every)
        assert np.max(np.abs(one.x - two.x[::20]) / two.deviations[::20]) < 1e-6


def test_the_buffer_drawn_runs_and_the_moving_horizon_follow_them():
    system, inputs = system_of(Belt()), wheels()
    log = seen(20)
    run = ErrorState(system).run(log, START, inputs=inputs)
    buffer = gt.filtering.Buffer(ErrorState(system), START, 10.0, inputs=inputs)
    for k in range(6):
        for name in ("gps", "compass"):
            buffer.push(name, log[name].time[k], log[name].values[k])
    assert np.array_equal(buffer.filtered().x, run.x)
    still = InitialState({}, {"x": 0.0, "heading": 0.0}, time=0.0)
    quiet = system.with_(noise={"slip": 0.0, "skid": 0.0})
    truth = gt.filtering.draw(quiet, still, [0.0, 1.0], seed=1, inputs=inputs).truth
    assert truth["x"][0, -1] == pytest.approx(1.0, abs=1e-3)
    estimate = gt.filtering.MovingHorizon(system, points=3).solve(log, START, inputs=inputs)
    smoothed = gt.filtering.smooth(run)
    assert np.max(np.abs(estimate["x"] - smoothed["x"]) / smoothed.deviation["x"]) < 1e-5
