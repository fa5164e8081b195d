"""Fits with a random walk of the bias, against a Kalman filter by hand."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.results import ArgumentError

N = 120


def made(seed: int, density: float, noise: float = 0.1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, regressor x and readings y = 2 x + bias + noise, with a walk that begins at 1: synthetic, by seed."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.5, 1.5, N))
    walk = 1.0 + density * np.cumsum(rng.normal(size=N) * np.sqrt(np.diff(time, prepend=0.0)))
    x = rng.normal(size=N)
    return time, x, 2.0 * x + walk + noise * rng.normal(size=N)


def fitted(time: np.ndarray, x: np.ndarray, y: np.ndarray, sigma: float | None = None) -> gt.inference.RandomWalkFit:
    J = np.column_stack([np.ones(N), x])[:, None, :]
    return gt.inference.random_walk_fit(J, y[:, None], time, ["bias", "slope"], sigma=sigma)


@pytest.mark.parametrize("seed", range(3))
def test_bias_and_slope_are_those_of_a_kalman_filter(seed: int) -> None:
    time, x, y = made(seed, 0.05)
    fit = fitted(time, x, y)
    state, P = np.zeros(2), np.diag([1e6, 1e6])
    for k in range(N):
        if k:
            P[0, 0] += fit.density[0] ** 2 * (time[k] - time[k - 1])
        H = np.array([1.0, x[k]])
        gain = P @ H / (H @ P @ H + fit.noise**2)
        state = state + gain * (y[k] - H @ state)
        P = P - np.outer(gain, H @ P)
    J = np.column_stack([np.ones(N), x])[:, None, :]
    A, b = fit.white(J)[:, 0], fit.white(y[:, None])[:, 0]
    assert np.linalg.lstsq(A, b, rcond=None)[0] == pytest.approx(state, rel=1e-6)
    assert fit.bound(J) == pytest.approx(np.sqrt(np.diag(P)), rel=1e-5)
    assert fit.estimate.values == pytest.approx(state, abs=0.5 * float(fit.estimate.std.min()))


def test_the_size_of_the_walk_is_found_and_without_one_the_fit_is_an_ordinary_one() -> None:
    sizes = [fitted(*made(k, 0.1)).density[0] for k in range(20)]
    assert np.median(sizes) == pytest.approx(0.1, rel=0.25)
    time, x, y = made(7, 0.0)
    fit = fitted(time, x, y)
    ordinary = gt.inference.linear_fit(np.column_stack([np.ones(N), x]), y, ["bias", "slope"])
    assert fit.estimate.value("slope") == pytest.approx(ordinary.value("slope"), abs=0.3 * ordinary.std[1])
    wide, narrow = (np.ptp(e.interval("slope")) for e in (fit.estimate, ordinary))
    assert wide == pytest.approx(narrow, rel=0.15)


def test_the_unit_of_the_readings_and_of_the_time_do_not_matter() -> None:
    time, x, y = made(3, 0.05)
    small, large = fitted(time, x, y), fitted(60 * time, x, 1e3 * y)
    J = np.array([1e3, 1e3])
    assert large.estimate.values == pytest.approx(J * small.estimate.values, rel=1e-9)
    assert large.estimate.std == pytest.approx(J * small.estimate.std, rel=1e-9)
    assert large.density == pytest.approx(1e3 * small.density / np.sqrt(60), rel=1e-9)


def test_a_stated_noise_is_used_and_too_few_readings_are_an_error() -> None:
    time, x, y = made(3, 0.05)
    assert fitted(time, x, y, sigma=0.1).noise == 0.1
    with pytest.raises(ArgumentError) as caught:
        gt.inference.random_walk_fit(np.ones((2, 1, 1)), np.ones((2, 1)), np.arange(2.0), ["bias"])
    assert caught.value.argument == "values"
