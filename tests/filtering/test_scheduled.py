"""Noise that changes with time: the filter of one system where it does not, and the right one where it does."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import gtmodel as gt
from tests.support.carts import JERK, START, cart_log, cart_system

F = gt.filtering


@pytest.fixture(scope="module")
def system():
    return cart_system()


def test_one_mode_is_the_filter_of_that_system(system):
    time, _, log = cart_log(seed=3)
    fast = system.with_(noise={"jerk": 100 * JERK})
    for mode, own in enumerate([system, fast]):
        expected = F.ErrorState(own).run(log, START)
        run = F.ScheduledNoise([system, fast], time, np.full(len(time), mode)).run(log, START)
        assert np.array_equal(run.x, expected.x)
        assert np.array_equal(F.smooth(run).P, F.smooth(expected).P)


def test_each_step_takes_the_system_of_its_end(system):
    time, _, log = cart_log(seed=3)
    fast = system.with_(noise={"jerk": 100 * JERK})
    modes = (np.arange(len(time)) // 7) % 2
    run = F.ScheduledNoise([system, fast], time, modes).run(log, START)
    for k in range(1, len(time)):
        own = [system, fast][modes[k]]
        Q = own.transition(0.0, time[k] - time[k - 1], run.x[k - 1], np.zeros(0), np.zeros(0)).Q
        assert np.array_equal(run.kept[k].step.Q, Q)


def test_smoothing_with_the_right_noise_is_better(system):
    """Synthetic, 40 runs: for a third of the log the jerk is thirty times as large; errors of both kinds of steps."""
    fast = system.with_(noise={"jerk": 900 * JERK})
    rng, dt, count, runs = np.random.default_rng(0), 0.02, 150, 40
    modes = ((np.arange(count) > 50) & (np.arange(count) <= 100)).astype(int)
    time = dt * np.arange(count)
    x = np.zeros((runs, count, 4))
    x[:, 0] = rng.standard_normal((runs, 4)) * [0.1, 0.5, 1.0, 0.1]
    none = np.zeros(0)
    for k in range(1, count):
        step = [system, fast][modes[k]].transition(0.0, dt, x[:, k - 1], none, none)
        x[:, k] = step.x + rng.standard_normal((runs, 4)) @ np.linalg.cholesky(step.Q).T
    tape = x[:, :, :1] + 0.01 * rng.standard_normal((runs, count, 1))
    log = {"tape": F.Readings(time, tape)}
    truth = {name: x[:, :, k] for k, name in enumerate(["x", "v", "a", "b"])}
    truth = {name: v[..., None] for name, v in truth.items()}

    def error(filter):
        smoothed = F.smooth(filter.run(log, START, truth=truth, keep=True))
        v = smoothed.error["v"].reshape(runs, count)
        return [np.sqrt(np.mean(v[:, part] ** 2)) for part in (slice(10, 40), slice(60, 90))]

    quiet, moving = error(F.ScheduledNoise([system, fast], time, modes))
    slow, rapid = error(F.ErrorState(system)), error(F.ErrorState(fast))
    assert quiet < 0.7 * rapid[0] and moving < 0.7 * slow[1]
    assert quiet < 1.1 * slow[0] and moving < 1.1 * rapid[1]


def test_likely_modes_are_those_of_all_paths():
    """Against the sum over all paths of a chain with three modes and five instants."""
    rng = np.random.default_rng(2)
    chances = rng.dirichlet([3, 1, 1], 3)
    for _ in range(20):
        likelihood = rng.uniform(0.01, 1.0, (5, 3))
        first = rng.dirichlet([1, 1, 1])
        filtered, p = [], first
        for k in range(5):
            p = (p @ chances if k else p) * likelihood[k]
            p = p / p.sum()
            filtered.append(p)
        whole = np.zeros((5, 3))
        for path in product(range(3), repeat=5):
            weight = first[path[0]] * likelihood[0, path[0]]
            for k in range(1, 5):
                weight *= chances[path[k - 1], path[k]] * likelihood[k, path[k]]
            for k, mode in enumerate(path):
                whole[k, mode] += weight
        assert np.array_equal(F.likely_modes(filtered, chances), np.argmax(whole, axis=1))


def test_what_makes_no_sense_is_said(system):
    error = gt.results.ArgumentError
    with pytest.raises(error, match="indices of systems, 0 to 0"):
        F.ScheduledNoise([system], [0.0, 1.0], [0, 1])
    with pytest.raises(error, match="a mode for each"):
        F.ScheduledNoise([system], [0.0, 1.0], [0])
    with pytest.raises(error, match="do not increase"):
        F.ScheduledNoise([system], [1.0, 0.0], [0, 0])
    other = F.System(system.process, [F.Sensor("rule", "x", deviation=1.0)])
    with pytest.raises(error, match="system 1 has other states or sensors than system 0"):
        F.ScheduledNoise([system, other], [0.0], [0])
    with pytest.raises(error, match=r"expected \(K, modes\) and \(modes, modes\)"):
        F.likely_modes([[0.5, 0.5]], np.eye(3))
