"""Resonances from decays: the poles of an independent realisation, intervals, overlaps, and what is refused."""

from __future__ import annotations

import control
import numpy as np
import pytest

from gtmodel.inference import binomial_band
from gtmodel.results import ArgumentError
from gtmodel.vibration import Record, hammer_record, identify_impulse
from gtmodel.vibration.impulse import realisations
from tests.vibration.structures import TS, matched, random_system

TRUE = dict(frequency_Hz=[7.4, 11.45], damping=[0.03, 0.025], amplitude=[[5e-4, 1e-4], [1e-4, 4e-4]])
EXACT = 1e-8  # relative, noise-free
NAMES = ("f[0]", "zeta[0]", "f[1]", "zeta[1]")


def hit(samples: int = 600, noise: float = 1e-5, seed: int = 3, **changes) -> Record:
    return hammer_record(**{**TRUE, **changes}, samples=samples, sample_time=TS, noise=noise, seed=seed)


def test_realisation_equals_control() -> None:
    A, B, C, _ = random_system(4, 4, 1, 2)
    Y = np.stack([C @ np.linalg.matrix_power(A, k) @ B for k in range(80)])[:, :, 0]
    ours = next(realisations(Y, [4], rows=20))
    np.testing.assert_allclose(ours[1] @ ours[2], Y[0], atol=1e-10)
    markov = np.concatenate([np.zeros((2, 1, 1)), Y.T[:, None, :]], axis=2)
    theirs, _ = control.eigensys_realization(markov, r=4, m=20, n=40, dt=TS)
    assert matched(ours[3], np.linalg.eigvals(theirs.A)) < EXACT
    assert matched(ours[3], np.linalg.eigvals(A)) < EXACT


def test_a_clean_decay_is_exact() -> None:
    found = identify_impulse(hit(noise=0.0), modes=2)
    for k, r in enumerate(found.resonances):
        assert r.frequency_Hz == pytest.approx(TRUE["frequency_Hz"][k], rel=EXACT)
        assert r.damping == pytest.approx(TRUE["damping"][k], rel=1e-6)
        np.testing.assert_allclose(r.amplitude, TRUE["amplitude"][k], rtol=1e-6)
    # the system's impulse response is the decay, one sample later
    _, y = control.impulse_response(found.system, T=TS * np.arange(100))
    scale = TS  # control's discrete impulse has the height 1 / dt
    np.testing.assert_allclose(scale * y[:, 0, 1:], found.fitted[:99].T - found.rest[:, None], atol=1e-9)


def test_noise_gives_two_resonances_with_their_distance() -> None:
    found = identify_impulse(hit())
    assert len(found.resonances) == 2 and min(found.criterion, key=lambda k: found.criterion[k]) == 2
    # 4.05 Hz over 7.4 * 0.03 + 11.45 * 0.025 Hz
    assert found.distance[0] == pytest.approx(4.05 / (7.4 * 0.03 + 11.45 * 0.025), rel=0.05)
    for n, (r, true) in enumerate(zip(found.resonances, TRUE["frequency_Hz"], strict=True)):
        low, high = found.interval(f"f[{n}]")
        assert low < r.frequency_Hz < high and high - low < 0.02 * true
        assert r.damped_Hz < r.frequency_Hz
    assert np.all(np.abs(found.residual / 1e-5 - 1) < 0.1) and found.synthetic == "seed 3, noise 1e-05 m"


def test_a_rest_position_does_not_matter() -> None:
    record = hit()
    moved = Record(record.u, record.y + np.array([1e-3, -2e-3]), TS)
    one, other = identify_impulse(record, modes=2), identify_impulse(moved, modes=2)
    for a, b in zip(one.resonances, other.resonances, strict=True):
        assert a.frequency_Hz == pytest.approx(b.frequency_Hz, rel=1e-6)
    np.testing.assert_allclose(other.rest - one.rest, [1e-3, -2e-3], rtol=1e-6)


def test_overlapping_peaks_are_said() -> None:
    near = hit(noise=1e-7, frequency_Hz=[10.0, 10.3], damping=[0.03, 0.03])
    found = identify_impulse(near, modes=2)
    assert found.distance[0] == pytest.approx(0.3 / 0.609, rel=0.05)
    assert any("Hz overlap (0.49 half-power widths apart)" in w for w in found.notes)


def covered(seeds: range) -> tuple[int, int]:
    inside = 0
    truth = dict(zip(NAMES, (7.4, 0.03, 11.45, 0.025), strict=True))
    for seed in seeds:
        estimate = identify_impulse(hit(samples=400, seed=seed), modes=2).estimate
        inside += sum(estimate.interval(n)[0] < truth[n] < estimate.interval(n)[1] for n in NAMES)
    return inside, len(NAMES) * len(seeds)


def test_intervals_hold_as_often_as_they_say() -> None:
    inside, runs = covered(range(20))
    low, high = binomial_band(runs, 0.95)
    assert low <= inside <= high


@pytest.mark.proof
def test_intervals_hold_as_often_as_they_say_many_seeds() -> None:
    inside, runs = covered(range(1000, 1300))
    low, high = binomial_band(runs, 0.95)
    assert low <= inside <= high


SIZES = np.array([1e-4, 1e-6, 1e-6, 3e-6, 1e-6, 2e-6])


def unequal(seed: int) -> Record:
    """One noisy output and five quiet ones; the noisy one moves most."""
    shapes = [[2e-3, 1e-4, 2e-4, 1e-4, 3e-4, 1e-4], [1e-3, 3e-4, 1e-4, 2e-4, 1e-4, 2e-4]]
    clean = hit(samples=400, noise=0.0, amplitude=shapes)
    noise = np.random.default_rng(seed).standard_normal(clean.y.shape)
    return Record(clean.u, clean.y + SIZES * noise, TS)


def covered_unequal(seeds: range) -> tuple[int, int]:
    inside = 0
    truth = dict(zip(NAMES, (7.4, 0.03, 11.45, 0.025), strict=True))
    for seed in seeds:
        estimate = identify_impulse(unequal(seed), modes=2).estimate
        inside += sum(estimate.interval(n)[0] < truth[n] < estimate.interval(n)[1] for n in NAMES)
    return inside, len(NAMES) * len(seeds)


def test_outputs_with_noise_of_unequal_size() -> None:
    inside, runs = covered_unequal(range(12))
    low, high = binomial_band(runs, 0.95)
    assert low <= inside <= high
    # the quiet outputs alone tell no less: a noisy one spoils nothing
    every, quiet = (
        identify_impulse(r, modes=2).estimate for r in (unequal(1), Record(unequal(1).u, unequal(1).y[:, 1:], TS))
    )
    assert np.all(every.std <= 1.05 * quiet.std)


@pytest.mark.proof
def test_outputs_with_noise_of_unequal_size_many_seeds() -> None:
    inside, runs = covered_unequal(range(1000, 1250))
    low, high = binomial_band(runs, 0.95)
    assert low <= inside <= high


def test_a_dead_output_changes_nothing() -> None:
    record = hit()
    dead = Record(record.u, np.column_stack([record.y, np.zeros(len(record))]), TS)
    one, other = identify_impulse(record), identify_impulse(dead)
    assert len(one.resonances) == len(other.resonances) == 2
    assert np.all(np.abs(one.estimate.values - other.estimate.values) < 0.02 * one.estimate.std)
    np.testing.assert_allclose(one.estimate.std, other.estimate.std, rtol=0.02)


def test_what_is_refused() -> None:
    record = hit()
    with pytest.raises(ArgumentError, match="the input at sample 0 is not zero"):
        identify_impulse(Record(np.ones(600), record.y, TS))
    with pytest.raises(ArgumentError, match="4 samples are too few for the order 4; expected at least 12"):
        identify_impulse(record.rows(0, 4), modes=2)
    with pytest.raises(ArgumentError, match="0 resonances requested; expected at least 1"):
        identify_impulse(record, modes=0)
    still = Record(np.zeros(300), np.exp(-np.arange(300) / 50.0), TS)
    with pytest.raises(ArgumentError, match="in the 300 samples decays and vibrates at least once"):
        identify_impulse(still, modes=1)
    with pytest.raises(ArgumentError, match="2 frequencies, 1 dampings and 2 rows of amplitudes"):
        hit(damping=[0.1])


def test_noise_alone_has_no_resonance() -> None:
    for seed in range(5):
        noise = 1e-5 * np.random.default_rng(seed).standard_normal((1000, 2))
        with pytest.raises(ArgumentError, match=r"rest and noise explain|nothing in the"):
            identify_impulse(Record(np.zeros(1000), noise, TS))


def test_near_nyquist_an_alias_is_said() -> None:
    record = hammer_record([140.0], [0.01], [[1e-3]], samples=1000, sample_time=TS, noise=1e-5, seed=2)
    assert any("from one at 140 Hz" in w for w in identify_impulse(record).notes)
