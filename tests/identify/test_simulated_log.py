"""Synthetic logs: the tracking of (6.11) step by step, rest at both ends, quantisation, noise, marks."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify import LogSimulator, Sensors, Tracking, multisine
from gtmodel.identify.rows import velocity_and_acceleration
from gtmodel.results import ArgumentError
from tests.identify.plants import SAMPLE_TIME, plant, session, simulator

L1 = gt.robots.actuator_closed_loop()


def test_tracking_is_the_recursion_of_the_thesis():
    rng = np.random.default_rng(1)
    reference = np.cumsum(rng.normal(size=(60, 3)), axis=0) * 1e-3 + [0.1, -0.2, 0.3]
    found = Tracking(**L1).follow(reference)
    moved = reference - reference[0]
    for i in range(3):
        y = np.zeros(60)
        for k in range(1, 60):
            y[k] = L1["a"][i] * y[k - 1] + (L1["b"][i] * moved[k - 5, i] if k >= 5 else 0.0)
        assert found[:, i] == pytest.approx(y + reference[0, i], abs=1e-15)


def test_a_step_arrives_after_five_samples_with_a_bandwidth_of_1_1_hz():
    step = np.ones((500, 3))
    step[0] = 0.0
    found = Tracking(**L1).follow(step)
    assert np.all(found[:6] == 0) and np.all(found[6] > 0)
    # time constants of 4 ms / -log(a): 1 / (2 pi tau), the text says approximately 1.1 Hz
    tau = -L1["sample_time"] / np.log(L1["a"])
    assert 1 / (2 * np.pi * tau) == pytest.approx([1.43, 1.39, 1.10], abs=0.01)
    assert found[-1] == pytest.approx(np.array(L1["b"]) / (1 - np.array(L1["a"])), rel=1e-3)


def test_the_motion_is_at_rest_at_both_ends_and_its_derivatives_are_its_own():
    time = SAMPLE_TIME * np.arange(2000)
    rows = multisine(time, np.zeros(3), np.full(3, 0.4), np.array([0.3, 1.7]), seed=3)
    assert np.max(np.abs(rows), axis=0) == pytest.approx([0.4] * 3)
    rate, acceleration = velocity_and_acceleration(rows, SAMPLE_TIME)
    for ends in (rows, rate, acceleration):
        assert np.max(np.abs(ends[[0, -1]])) < 2e-3 * np.max(np.abs(ends))
    truth = simulator(12.0).truth
    rate, acceleration = velocity_and_acceleration(truth["q"], SAMPLE_TIME)
    inside = slice(20, -20)  # the start of a delayed first-order system has a corner in the acceleration
    assert np.max(np.abs(rate - truth["der(q)"])[inside]) < 1e-6 * np.max(np.abs(rate))
    assert np.max(np.abs(acceleration - truth["der(q,2)"])[inside]) < 1e-4 * np.max(np.abs(acceleration))


def test_five_points_are_of_fourth_order():
    errors = []
    for h in (0.02, 0.01):
        t = h * np.arange(200)
        rate, acceleration = velocity_and_acceleration(np.sin(3 * t), h)
        errors.append([np.max(np.abs(rate - 3 * np.cos(3 * t))[2:-2]),
                       np.max(np.abs(acceleration + 9 * np.sin(3 * t))[2:-2])])  # fmt: skip
    assert np.log2(np.divide(*errors)) == pytest.approx([4.0, 4.0], abs=0.1)


def test_efforts_are_those_of_the_inverse_dynamics():
    t = simulator(12.0).truth
    tau, _ = plant().causal("q", "tau")(t["q"], t["der(q)"], t["der(q,2)"])
    assert np.array_equal(t["tau"], tau)


def test_quantised_noisy_marked_and_the_same_again():
    sensors = Sensors(position_step=1e-5, effort_noise=(10.0, 20.0, 30.0), effort_step=0.5)
    log = session(sensors, 5, 12.0).trajectory
    again = session(sensors, 5, 12.0).trajectory
    assert np.array_equal(log["tau"], again["tau"]) and np.array_equal(log["q"], again["q"])
    assert not np.array_equal(log["tau"], session(sensors, 6, 12.0).trajectory["tau"])
    assert np.max(np.abs(log["q"] - simulator(12.0).truth["q"])) <= 0.5e-5 + 1e-12
    assert log["tau"] / 0.5 == pytest.approx(np.round(log["tau"] / 0.5), abs=1e-9)
    spread = np.std(log["tau"] - simulator(12.0).truth["tau"], axis=0)
    assert spread == pytest.approx([10.0, 20.0, 30.0], rel=0.06)  # 3000 samples: 1.3 % standard error
    assert log.synthetic is not None
    assert "seed 5" in log.synthetic and "effort noise 10, 20, 30 (white)" in log.synthetic


def test_colour_keeps_the_size_and_correlates_neighbours():
    sensors = Sensors(effort_noise=10.0, effort_colour=0.9)
    noise = session(sensors, 1).trajectory["tau"] - simulator().truth["tau"]
    assert np.std(noise) == pytest.approx(10.0, rel=0.05)
    assert np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1] == pytest.approx(0.9, abs=0.02)


def test_it_can_be_sent_to_another_process():
    sensors = Sensors(effort_noise=1.0)
    copy = pickle.loads(pickle.dumps(simulator(12.0)))
    assert np.array_equal(copy.draw(3, sensors)["tau"], simulator(12.0).draw(3, sensors)["tau"])


def test_wrong_wishes():
    reference = np.zeros((100, 3))
    with pytest.raises(ValueError, match="the tracking was identified"):
        LogSimulator(plant(), reference, 0.002, tracking=Tracking(**L1))
    reference[:, 1] = np.linspace(0, 40, 100)
    with pytest.raises(gt.ModelError, match=r"s of the motion .*; take a smaller range"):
        LogSimulator(plant(), reference, 0.004)
    with pytest.raises(ValueError, match="colour must lie in"):
        Sensors(effort_colour=1.0)
    with pytest.raises(ValueError, match="take a shorter ramp"):
        multisine(np.arange(10) * 0.1, np.zeros(1), np.ones(1), np.ones(1), 0, ramp=1.0)
    with pytest.raises(ValueError, match="one a"):
        Tracking(b=(1.0,), a=(0.5, 0.5), delay=1)


@pytest.mark.parametrize("frequencies", [[], [0.5, 0.0], [np.nan], [[0.5]]])
def test_a_multisine_needs_frequencies(frequencies) -> None:
    with pytest.raises(ArgumentError, match="frequencies: "):
        multisine(np.arange(0.0, 8.0, 0.004), np.zeros(1), np.ones(1), np.array(frequencies), seed=1)
