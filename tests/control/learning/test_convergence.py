"""Rates of Dressler 2012, (7.28), the frequency bound, the fixed point, and the contraction of the input."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from gtmodel.control import learning
from tests.control.learning import by_hand

PRINTED = (0.904, 0.907, 0.930)  # (7.28) prints 0.90, 0.91, 0.93
WITHIN = 0.0005
FIXED = 1e-9  # of the input's size
ROUNDING = 1e-12


def case_1(size: int, actuator: int, ramp: int = 100) -> tuple[learning.LearningLaw, learning.Lifted]:
    b, a = learning.ACTUATORS[actuator]
    law = learning.simple_law(size, gain=0.9, shift=5, cutoff=10.0, ramp=ramp)
    return law, learning.lifted(learning.delayed_lag(b, a, 5), size)


def bound(actuator: int) -> learning.Peak:
    b, a = learning.ACTUATORS[actuator]
    f = learning.frequencies(0.004)
    z = np.exp(2j * np.pi * f * 0.004)
    gain = np.abs(scipy.signal.freqz(*scipy.signal.butter(2, 10.0, fs=250), worN=f, fs=250)[1]) ** 2
    return learning.frequency_bound(gain, 1 - 0.9 * b / (1 - a / z), f)


@pytest.mark.parametrize("actuator", range(3))
def test_rates_of_7_28(actuator: int) -> None:
    law, T = case_1(825, actuator)
    sigma = learning.largest_gain(law.map(T))
    assert sigma == pytest.approx(PRINTED[actuator], abs=WITHIN)
    # the same from matrices by hand
    b, a = learning.ACTUATORS[actuator]
    T_, L, Q = by_hand.actuator(b, a, 825), by_hand.shift(0.9, 5, 825), by_hand.low_pass(10.0, 825)
    by_numpy = np.linalg.svd(by_hand.tukey(825)[:, None] * (Q @ (np.eye(825) - L @ T_)), compute_uv=False)[0]
    assert sigma == pytest.approx(by_numpy, abs=1e-12)
    assert learning.largest_gain(law.map(T), dense=False) == pytest.approx(by_numpy, abs=1e-9)
    assert learning.spectral_radius(law.map(T)) < sigma


@pytest.mark.parametrize("actuator", [0, *(pytest.param(k, marks=pytest.mark.proof) for k in (1, 2))])
def test_the_rate_rises_with_the_length_of_the_run_to_the_frequency_bound(actuator: int) -> None:
    sizes = [300, 450, 600, 825, 1500, 3000]
    rates = [learning.largest_gain(law.map(T)) for law, T in (case_1(n, actuator) for n in sizes)]
    assert np.all(np.diff(rates) > 0)
    peak = bound(actuator)
    assert rates[-1] < peak.value < rates[-1] + 1e-4
    assert 3.0 < peak.frequency < 5.0  # "at 4 Hz"


def test_the_window_has_the_closed_form_of_tukey() -> None:
    assert np.abs(learning.input_window(825) - by_hand.tukey(825)).max() < ROUNDING


@pytest.mark.parametrize("size", [825, 1200])
def test_the_iteration_ends_at_the_fixed_point_and_contracts_by_sigma(size: int) -> None:
    law, T = case_1(size, 0)
    step = law.map(T)
    sigma = learning.largest_gain(step)
    first = np.cumsum(np.random.default_rng(2).normal(size=size)) / 30  # an error without noise
    limit = law.fixed_point(T, first)
    u, before = np.zeros(size), np.inf
    for k in range(400):
        u_next = law.update(u, first - T(u))
        off, step_off = np.linalg.norm(u - limit), np.linalg.norm(u_next - limit)
        if off > 1e-6 * np.linalg.norm(limit):
            assert step_off <= sigma * off * (1 + 1e-9), f"run {k}"
        u, before = u_next, off
    assert np.abs(u - limit).max() < FIXED * np.abs(limit).max()
    assert before < 1e-6
    # the limit from numpy's matrices alone
    A = step.dense()
    by_numpy = np.linalg.solve(np.eye(size) - A, law.Q.dense() @ law.L.dense() @ first)
    assert np.abs(limit - by_numpy).max() < FIXED * np.abs(limit).max()


def test_the_error_is_not_bounded_by_sigma_but_the_input_is() -> None:
    # (7.16) speaks of the input: the error falls to a minimum and rises a little
    law, T = learning.simple_law(825, 0.9, 5, 10.0), learning.lifted(learning.delayed_lag(0.18127, 0.81873, 5), 825)
    t = np.clip((np.arange(825) - 100) / 62.5, 0, 1)
    r = 0.01 * t**3 * (10 - 15 * t + 6 * t**2)
    u, errors = np.zeros(825), []
    for _ in range(12):
        e = r - T(r + u)
        errors.append(np.linalg.norm(e[100:725]))
        u = law.update(u, e)
    assert np.argmin(errors) < 11
    assert errors[-1] > 1.01 * min(errors)
