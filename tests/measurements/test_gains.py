"""The test of a gain keeps its level on clean data with coloured noise, and finds signs, units and other channels."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.measurements.inspection.misread_columns import LEAST, MOST, gain_off
from gtmodel.results.suspicion import RUN_LEVEL

RUNS, N = 200, 1500
LEVEL = 0.05  # at which false alarms are counted at the bound itself, where they are the most


def p_of(seed: int, gain: float, other: bool = False) -> float:
    """Of a motion of 600 rows between rests; noise on both signals as large as the motion, half of it coloured."""
    rng = np.random.default_rng(seed)
    moving = (np.arange(N) > 400) & (np.arange(N) < 1000)
    true, another = np.where(moving, np.convolve(rng.normal(size=(N + 20)), np.ones(21) / 4.6, "valid"), 0.0), None
    another = true[::-1] if other else true

    def noise() -> np.ndarray:
        return rng.normal(size=N) / 2 + np.convolve(rng.normal(size=N + 4), np.ones(5) / 4.5, "valid")

    return gain_off(gain * another + noise(), true + noise(), true, "a", "b", "look").p


def test_clean_data_raise_no_alarm_and_a_gain_at_the_bound_as_many_as_the_level_says() -> None:
    assert sum(p_of(seed, 1.0) < RUN_LEVEL for seed in range(RUNS)) == 0
    # binomial with mean 10 or less of 200: 22 has a chance below 1e-3
    assert all(sum(p_of(seed, g) < LEVEL for seed in range(RUNS)) < 22 for g in (LEAST, MOST))


@pytest.mark.parametrize("gain", [-1.0, 1 / 9.81, 9.81, 0.0])
def test_signs_units_and_noise_are_found(gain: float) -> None:
    assert sum(p_of(seed, gain) < RUN_LEVEL for seed in range(20)) == 20


def test_another_channel_is_found_and_rest_is_not_judged() -> None:
    assert sum(p_of(seed, 1.0, other=True) < RUN_LEVEL for seed in range(20)) >= 18
    still = np.zeros(N)
    assert np.isnan(gain_off(still + 1.0, still, still, "a", "b", "look").p)
