"""Readings in any order against the filter on the same readings in order: the same bits."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from tests.filtering.test_smoother import turning_case
from tests.support.carts import START, cart_log, cart_system

F = gt.filtering
BEGIN = F.InitialState(START.mean, START.deviation, time=0.0)


def arrivals(log, jitter, seed):
    """Readings of a log as (sensor, stamp, value), in the order of stamps that are each late by up to `jitter` [s]."""
    rng = np.random.default_rng(seed)
    each = [(name, float(t), v) for name, r in log.items() for t, v in zip(r.time, r.values, strict=True)]
    return [each[k] for k in np.argsort([t + rng.uniform(0.0, jitter) for _, t, _ in each], kind="stable")]


def differing(a, b):
    """What of two runs is not the same to the bit."""
    whole = ("time", "x", "deviations", "nis", "count", "log_likelihood", "covariances")
    names = [name for name in whole if not np.array_equal(getattr(a, name), getattr(b, name))]
    for name in a.innovations:
        if not np.array_equal(a.innovations[name], b.innovations[name], equal_nan=True):
            names.append(f"innovations of {name}")
        if not np.array_equal(a.gated[name], b.gated[name]):
            names.append(f"gated of {name}")
    return names


@pytest.fixture(scope="module")
def system():
    return cart_system(gate=0.99)


@pytest.mark.parametrize("seed", range(8))
def test_any_order_within_the_horizon_gives_the_bits_of_sorted_data(system, seed):
    # two sensors of different rates, uneven stamps, missing numbers, a gate
    time, _, log = cart_log(seed=seed, count=60)
    whole = float(time[-1])
    jitter = [0.0, 0.05, 0.3, 1.0][seed % 4]
    horizon = whole if seed >= 4 else jitter + 0.2
    buffer = F.Buffer(F.ErrorState(system), BEGIN, horizon)
    said = [buffer.push(*reading) for reading in arrivals(log, jitter, seed)]
    assert differing(buffer.filtered(), F.ErrorState(system).run(log, BEGIN)) == []
    assert set(said) <= {"applied", "went back"}
    assert said.count("went back") == sum(buffer.late.values())
    assert sum(buffer.refused.values()) == 0
    assert bool(sum(buffer.late.values())) or jitter == 0.0


def test_readings_of_one_instant_may_come_in_any_order(system):
    t = 0.1 * np.arange(12)
    rng = np.random.default_rng(1)
    log = {"tape": F.Readings(t + 4e-10, rng.standard_normal(12) / 100), "unit": F.Readings(t, rng.standard_normal(12))}
    expected = F.ErrorState(system).run(log, BEGIN)
    assert len(expected.time) == 12
    each = arrivals(log, 0.0, 0)
    for _ in range(5):
        buffer = F.Buffer(F.ErrorState(system), BEGIN, 5.0)
        for k in rng.permutation(len(each)):
            buffer.push(*each[k])
        assert differing(buffer.filtered(), expected) == []


def test_two_readings_of_one_sensor_with_one_stamp_are_both_used(system):
    t = np.array([0.0, 0.1, 0.1, 0.1, 0.2])
    log = {"tape": F.Readings(t, [0.0, 0.01, 0.02, 0.03, 0.01]), "unit": F.Readings(t[2:], [0.1, 0.2, 0.3])}
    buffer = F.Buffer(F.ErrorState(system), BEGIN, 5.0)
    order = [("tape", 4), ("unit", 0), ("tape", 0), ("tape", 1), ("unit", 1), ("tape", 2), ("unit", 2), ("tape", 3)]
    for name, k in order:
        buffer.push(name, log[name].time[k], log[name].values[k])
    assert differing(buffer.filtered(), F.ErrorState(system).run(log, BEGIN)) == []


def test_a_trajectory_shows_the_state_after_the_last_reading_of_an_instant(system):
    t = np.array([0.0, 0.1, 0.1, 0.1, 0.2])
    run = F.ErrorState(system).run({"tape": F.Readings(t, [0.0, 0.01, 0.02, 0.03, 0.01])}, BEGIN)
    shown = run.trajectory()
    assert shown.time.tolist() == [0.0, 0.1, 0.2]
    np.testing.assert_array_equal(shown["x"], run["x"][[0, 3, 4]].reshape(-1))
    np.testing.assert_array_equal(shown["x.deviation"], run.deviation["x"][[0, 3, 4]].reshape(-1))


def test_a_turning_body_with_quaternions_is_the_same_too():
    run, log, start, _ = turning_case(0.02)
    begin = F.InitialState(start.mean, start.deviation, time=0.0)
    buffer = F.Buffer(F.ErrorState(run.system), begin, 1.0)
    for reading in arrivals(log, 0.1, 4):
        buffer.push(*reading)
    assert differing(buffer.filtered(), F.ErrorState(run.system).run(log, begin)) == []


def test_memory_is_bounded_by_the_horizon(system):
    buffer = F.Buffer(F.ErrorState(system), BEGIN, 0.5, record=False)
    for k in range(500):
        buffer.push("unit", 0.01 * k, 0.0)
    assert len(buffer._passed) < 60 and len(buffer._arrived) < 60
    with pytest.raises(gt.results.ArgumentError, match="record=True"):
        buffer.filtered()


def test_what_is_too_old_is_refused_and_counted(system):
    buffer = F.Buffer(F.ErrorState(system), BEGIN, 0.25)
    assert buffer.push("tape", -0.1, 0.0) == "too old"  # before the start
    for t in (0.0, 0.1, 0.5):
        assert buffer.push("tape", t, 0.0) == "applied"
    before = buffer.belief
    assert buffer.push("unit", 0.2499, 0.0) == "too old"
    assert buffer.push("unit", np.nan, 0.0) == "not finite"
    assert buffer.refused == {"tape": 1, "unit": 2}
    assert buffer.belief is before
    assert buffer.push("unit", 0.25, 0.0) == "went back"
    log = {"tape": F.Readings([0.0, 0.1, 0.5], [0.0] * 3), "unit": F.Readings([0.25], [0.0])}
    assert differing(buffer.filtered(), F.ErrorState(system).run(log, BEGIN)) == []


def test_a_known_delay_is_one_of_augmented_states(system):
    """The chain of past copies of the state, whose oldest one is measured without delay, is the other way."""
    period, lag, count, rng = 0.1, 3, 30, np.random.default_rng(6)
    P = F.StatePart
    Q = [[3e-5, 4e-4], [4e-4, 1e-2]]
    step = lambda s: {"x": s.x + period * s.v, "v": s.v}  # noqa: E731
    late, now = rng.standard_normal(count), rng.standard_normal(count)
    late[:lag] = np.nan  # tells of times before the start
    late[9], now[::2] = np.nan, np.nan
    t = period * np.arange(count)
    process = F.DiscreteProcess([P("x"), P("v")], period, step, Q)
    sensors = [F.Sensor("late", "x", deviation=0.1, delay=lag * period), F.Sensor("now", "x", deviation=0.5)]
    own = F.System(process, sensors)
    begin = F.InitialState({}, {"x": 1.0, "v": 2.0}, time=0.0)
    buffer = F.Buffer(F.ErrorState(own), begin, 1.0)

    def shifted(s):
        return {**step(s), "x1": s.x, "x2": s.x1, "x3": s.x2}

    whole = np.zeros((5, 5))
    whole[:2, :2] = Q
    chain = F.DiscreteProcess([P(n) for n in ("x", "v", "x1", "x2", "x3")], period, shifted, whole)
    augmented = F.System(chain, [F.Sensor("late", "x3", deviation=0.1), F.Sensor("now", "x", deviation=0.5)])
    deviations = {"x": 1.0, "v": 2.0, "x1": 1.0, "x2": 1.0, "x3": 1.0}
    log = {"late": F.Readings(t, late), "now": F.Readings(t, now)}
    expected = F.ErrorState(augmented).run(log, F.InitialState({}, deviations, time=0.0))
    for k in range(count):
        if k >= lag:
            buffer.push("late", t[k], late[k])
        buffer.push("now", t[k], now[k])
        b = buffer.belief
        assert np.abs(b.x[0] - expected.x[k, 0, :2]).max() < 1e-12
        assert np.abs(b.P[0] - expected.covariances[k][:2, :2]).max() < 1e-12
    assert buffer.late["late"] == count - lag


def test_known_inputs_may_come_from_a_function_of_time():
    class Pushed(gt.Model):
        x = gt.variable(unit="m")
        v = gt.variable(unit="m/s")
        u = gt.input(unit="m/s2")
        a = gt.input(unit="m/s2")

        def equations(self):
            yield gt.der(self.x) == self.v
            yield gt.der(self.v) == self.u + self.a

    process = F.ProcessModel(Pushed(), noise={"a": 0.1}, inputs=["u"], states=["x", "v"])
    system = F.System(process, [F.Sensor("tape", "x", deviation=0.01)])
    t = 0.1 * np.arange(20)
    inputs = gt.Trajectory(t, {"u": np.sin(3 * t)}, {"u": "m/s2"})
    begin = F.InitialState({}, {"x": 1.0, "v": 1.0}, time=0.0)
    log = {"tape": F.Readings(t, np.cos(t))}
    expected = F.ErrorState(system).run(log, begin, inputs=inputs)
    for given in (inputs, lambda time, name: inputs(time, name)):
        buffer = F.Buffer(F.ErrorState(system), begin, 5.0, inputs=given)
        for reading in arrivals(log, 0.35, 2):
            buffer.push(*reading)
        assert differing(buffer.filtered(), expected) == []
    with pytest.raises(gt.results.ArgumentError, match="known inputs"):
        F.Buffer(F.ErrorState(system), begin, 5.0)


def test_a_prediction_changes_nothing(system):
    buffer = F.Buffer(F.ErrorState(system), BEGIN, 1.0)
    buffer.push("tape", 0.1, 0.01)
    before = buffer.belief
    ahead = buffer.predicted(0.3)
    assert ahead.time == 0.3 and np.all(np.diagonal(ahead.P[0]) >= np.diagonal(before.P[0]) - 1e-15)
    assert buffer.belief is before
    with pytest.raises(gt.results.ArgumentError, match=r"0\.1 s, the newest belief"):
        buffer.predicted(0.0)


def test_what_makes_no_sense_is_said(system):
    with pytest.raises(gt.results.ArgumentError, match="give the time at which the filter starts"):
        F.Buffer(F.ErrorState(system), START, 1.0)
    buffer = F.Buffer(F.ErrorState(system), BEGIN, 1.0)
    with pytest.raises(gt.results.ArgumentError, match=r"there is no sensor 'rule'; .* 'tape', 'unit'"):
        buffer.push("rule", 0.0, 0.0)
    with pytest.raises(gt.results.ArgumentError, match="expected 1 numbers from 'tape'"):
        buffer.push("tape", 0.0, [0.0, 1.0])
