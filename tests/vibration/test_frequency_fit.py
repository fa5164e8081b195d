"""Second-order fits: exact without noise, honest with it, several modes, what a close second mode does."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from gtmodel.inference import binomial_band, monte_carlo
from gtmodel.vibration import (
    FrequencyResponse,
    fit_modes,
    frequency_response,
    receptance,
    synthetic_hits,
    synthetic_receptance as made,
)
from gtmodel.vibration.dynamic_stiffness.modal_fit import linear_start, log_derivatives

M, C, K = 174.8, 4047.9, 2.79e6  # Cvitanic 2021, Table 16, test 2, x
TRUE = {"m": M, "c": C, "k": K, "fn": float(np.sqrt(K / M)) / (2 * np.pi), "zeta": C / (2 * np.sqrt(K * M))}
LINES = np.arange(2.0, 120.0, 0.25)
EXACT = 1e-9  # data rounded to 1e-16 of a receptance whose slopes by m and k all but cancel at resonance


def two(apart_Hz: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A second mode of 400 kg above the first."""
    k = 400 * (2 * np.pi * (TRUE["fn"] + apart_Hz)) ** 2
    return np.array([M, 400.0]), np.array([C, 4000.0]), np.array([K, k])


def exact(m, c, k) -> FrequencyResponse:
    return FrequencyResponse(LINES, receptance(2j * np.pi * LINES, *map(np.atleast_1d, (m, c, k))))


@pytest.mark.parametrize("modes", [1, 2])
def test_without_noise_the_linear_start_is_exact_already(modes) -> None:
    theta = two(8.0) if modes == 2 else tuple(map(np.atleast_1d, (M, C, K)))
    lines = exact(*theta).between(14.0, 40.0)
    found = np.exp(linear_start(lines.s, lines.receptance, modes, np.ones(len(lines.frequency)))).reshape(modes, 3)
    np.testing.assert_allclose(found[np.argsort(found[:, 0])], np.stack(theta, axis=1), rtol=1e-6)


@pytest.mark.parametrize("modes", [1, 2, 3])
def test_without_noise_all_modes_are_recovered(modes) -> None:
    m = np.array([M, 300.0, 90.0])[:modes]
    k = m * (2 * np.pi * np.array([TRUE["fn"], 26.0, 33.0])[:modes]) ** 2
    c = 2 * np.array([0.09, 0.05, 0.04])[:modes] * np.sqrt(k * m)
    found = fit_modes(exact(m, c, k), modes, band=(12.0, 45.0))
    order = np.argsort(found.fn)
    np.testing.assert_allclose(np.stack([found.m, found.c, found.k])[:, order], np.stack([m, c, k]), rtol=EXACT)


def test_slopes_are_those_of_finite_differences() -> None:
    s = 2j * np.pi * np.linspace(5, 40, 20) + 3.0
    theta = np.log(np.stack(two(4.0), axis=1)).ravel()
    H = lambda t: receptance(s, *np.exp(t.reshape(-1, 3).T))  # noqa: E731
    h = 1e-6
    numeric = np.stack([(H(theta + h * e) - H(theta - h * e)) / (2 * h) for e in np.eye(6)], axis=1)
    jacobian = log_derivatives(s, *np.exp(theta.reshape(-1, 3).T))
    np.testing.assert_allclose(jacobian, numeric, atol=1e-8 * np.abs(jacobian).max())


def test_five_percent_of_noise_gives_half_to_two_percent() -> None:
    fit = fit_modes(made(LINES, M, C, K, noise=0.05, seed=1), noise=0.05)
    assert len(fit.m) == 1 and fit.notes == () and fit.adequacy is not None and fit.adequacy.passed
    for name in ("m", "k"):
        assert 0.005 < fit.log_std(name) < 0.02
    assert fit.log_std("fn") < 0.003  # mass and stiffness err together
    for name, true in TRUE.items():
        low, high = fit.interval(f"{name}[0]", level=0.999)
        assert 0 < low < true < high


def _hits(rng: np.random.Generator, k: int) -> list[bool]:
    del k
    fit = fit_modes(made(LINES, M, C, K, noise=0.05, seed=rng), noise=0.05)
    return [fit.interval(f"{n}[0]")[0] < true < fit.interval(f"{n}[0]")[1] for n, true in TRUE.items()] + [
        len(fit.m) == 1
    ]


@pytest.mark.parametrize("runs", [25, pytest.param(1000, marks=pytest.mark.proof)])
def test_intervals_hold_the_truth(runs: int) -> None:
    found = np.array(monte_carlo(_hits, runs, 16, processes=0 if runs < 100 else None).results).sum(axis=0)
    low, high = binomial_band(runs)
    assert all(low <= hits <= high for hits in found[:5]), found
    assert found[5] >= runs - max(1, runs // 100)  # one mode is not taken for two


def _from_hits(rng: np.random.Generator, k: int, decay: float) -> list[bool]:
    del k
    F, x = synthetic_hits(M, C, K, sample_rate=1024.0, duration=2.0, hits=5, noise=0.2, seed=rng)
    fit = fit_modes(frequency_response(F, x, 1024.0, decay=decay), 1)
    assert fit.adequacy is not None
    return [fit.interval(f"{n}[0]")[0] < true < fit.interval(f"{n}[0]")[1] for n, true in TRUE.items()] + [
        fit.adequacy.passed
    ]


@pytest.mark.proof
@pytest.mark.parametrize("decay", [0.0, 4.0])
def test_intervals_from_hits_hold_the_truth(decay) -> None:
    runs = 300
    found = np.array(monte_carlo(functools.partial(_from_hits, decay=decay), runs, 5).results).sum(axis=0)
    low, high = binomial_band(runs)
    # a window correlates the lines; the intervals are then wider than they need be, never narrower
    assert all(low <= hits <= (runs if decay else high) for hits in found[:5]), found
    assert found[5] >= 0.96 * runs


def test_hits_tell_their_own_noise() -> None:
    F, x = synthetic_hits(M, C, K, sample_rate=1024.0, duration=2.0, hits=5, noise=0.2, seed=7)
    fit = fit_modes(frequency_response(F, x, 1024.0))
    assert fit.adequacy is not None and fit.adequacy.passed and len(fit.m) == 1
    assert 0.002 < fit.log_std("m") < 0.02 and fit.m[0] == pytest.approx(M, rel=0.03)


@pytest.mark.parametrize("apart", [0.8, 6.0])
def test_a_second_mode_is_found_and_its_distance_told(apart) -> None:
    fit = fit_modes(made(LINES, *two(apart), noise=0.02, seed=3), noise=0.02)
    assert len(fit.m) == 2 and fit.next_mode == pytest.approx(apart, abs=0.2)
    np.testing.assert_allclose(np.sort(fit.k), np.sort(two(apart)[2]), rtol=0.25)
    if apart < 1:
        one = fit_modes(made(LINES, *two(apart), noise=0.02, seed=3), 1, noise=0.02)
        assert one.adequacy is not None and not one.adequacy.passed  # two modes look like one, but not quite
        (note,) = fit.notes
        assert "a second mode is 0.8" in note and "closer than 1 Hz; a fit of one mode has m -" in note
        assert abs(one.m[0] / M - 1) > 0.2 or abs(one.k[0] / K - 1) > 0.2
    else:
        assert fit.notes == ()


def test_level_noise_is_told_by_the_residuals_and_weights_do_not_matter_without_noise() -> None:
    clean = exact(M, C, K)
    rng = np.random.default_rng(4)
    noise = 2e-9
    z = noise * (rng.standard_normal(len(LINES)) + 1j * rng.standard_normal(len(LINES)))
    fit = fit_modes(FrequencyResponse(LINES, clean.receptance + z))
    assert len(fit.m) == 1 and fit.adequacy is None and not fit.estimate.known_noise
    scaled = fit.estimate.noise * np.abs(fit.response.receptance).max()
    assert scaled == pytest.approx(noise, rel=0.25)
    assert fit.interval("k[0]", level=0.999)[0] < K < fit.interval("k[0]", level=0.999)[1]


def test_what_cannot_be_fitted_is_a_sentence() -> None:
    with pytest.raises(ValueError, match="largest at the edge of 30 to 90 Hz"):
        fit_modes(exact(M, C, K), search=(30.0, 90.0))
    with pytest.raises(ValueError, match=r"mode found at 20.11 Hz is outside the fitted lines, 30 to 60 Hz"):
        fit_modes(exact(M, C, K), 1, band=(30.0, 60.0))
    with pytest.raises(ValueError, match="found 0 modes"):
        fit_modes(exact(M, C, K), 0)
    with pytest.raises(ValueError, match="relative noise of 0; expected"):
        fit_modes(exact(M, C, K), noise=0.0)
    with pytest.raises(ValueError, match="'f'; expected m, c, k"):
        fit_modes(exact(M, C, K), 1).interval("f")
