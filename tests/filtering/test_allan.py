"""Allan deviations against published ones and a plain sum; densities of synthetic noise, and how often they are met."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

import gtmodel as gt

F = gt.filtering
WHITE, WALK, FLICKER, PERIOD = 1e-3, 1.5e-3, 3e-3, 0.01
COUNT = 4000


def synthetic(seed, count=COUNT, white=WHITE, walk=0.0, flicker=0.0):
    """White noise, its walk and 1/f noise with these coefficients; the last one by its spectrum, of a piece of a log
    that is eight times as long."""
    rng = np.random.default_rng(seed)
    y = white / np.sqrt(PERIOD) * rng.standard_normal(count)
    if walk:
        y = y + np.cumsum(walk * np.sqrt(PERIOD) * rng.standard_normal(count))
    if flicker:
        f = np.fft.rfftfreq(8 * count)
        shaped = np.fft.rfft(rng.standard_normal(8 * count))
        shaped[1:] *= flicker / np.sqrt(2 * np.pi * f[1:])
        shaped[0] = 0.0
        y = y + np.fft.irfft(shaped, 8 * count)[:count]
    return y


def test_the_published_example():
    data = [892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0]  # NIST SP 1065, section 12.1
    tau, deviation = F.allan_deviation(data, 1.0, [1, 2])
    assert tau.tolist() == [1.0, 2.0]
    assert deviation.round(5).tolist() == [91.22945, 85.95287]


def test_it_is_the_mean_square_of_differences_of_neighbouring_means():
    y = synthetic(0, 300, walk=WALK)
    for m in (1, 3, 8, 100, 150):
        means = [(y[k : k + m].mean(), y[k + m : k + 2 * m].mean()) for k in range(len(y) - 2 * m + 1)]
        expected = np.sqrt(np.mean([(b - a) ** 2 / 2 for a, b in means]))
        assert abs(F.allan_deviation(y, PERIOD, [m])[1][0] / expected - 1) < 1e-10


@pytest.mark.parametrize("runs", [15, pytest.param(80, marks=pytest.mark.proof)])
@pytest.mark.parametrize(
    "noise",
    [
        {"walk": WALK},
        pytest.param({"flicker": FLICKER}, marks=pytest.mark.proof),
        {"walk": 0.5 * WALK, "flicker": FLICKER},
    ],
    ids=["walk", "1/f", "both"],
)
def test_intervals_hold_what_was_put_in_as_often_as_they_say(noise, runs):
    """Synthetic, seeds from 0: each count of hits within the 99.9 % of a binomial; from 0 where there is none."""
    truth = {"white": WHITE, "flicker": 0.0, "walk": 0.0, **noise}
    hits = dict.fromkeys(truth, 0)
    for seed in range(runs):
        fit = F.allan_fit(synthetic(seed, **noise), PERIOD)
        for name, value in truth.items():
            low, high = fit.interval(name)
            hits[name] += low <= value <= high
            assert low <= getattr(fit, name) <= high
    low, high = binom.ppf([0.0005, 0.9995], runs, 0.95)
    for name, count in hits.items():
        assert low <= count, (name, hits)
        # at the edge of what is possible an interval holds more than it says
        assert count <= high or truth[name] == 0.0 or name in ("flicker", "walk"), (name, hits)


def test_a_long_log_gives_the_densities():
    fit = F.allan_fit(synthetic(5, 200_000, walk=0.1 * WALK), PERIOD, terms=("white", "walk"))
    assert abs(fit.white / WHITE - 1) < 0.01
    assert abs(fit.walk / (0.1 * WALK) - 1) < 0.3
    assert fit.flicker == 0.0 and fit.terms == ("white", "walk")
    with pytest.raises(gt.results.ArgumentError, match=r"'flicker' was not fitted; .* 'white', 'walk'"):
        fit.interval("flicker")


def test_units_of_time_and_value_only_scale():
    y = synthetic(3, walk=WALK)
    fit, other = F.allan_fit(y, PERIOD), F.allan_fit(1e3 * y, 4 * PERIOD)
    assert abs(other.white / (1e3 * 2 * fit.white) - 1) < 1e-6
    assert abs(other.walk / (1e3 / 2 * fit.walk) - 1) < 1e-4
    low, high = np.array(other.interval("walk")) / np.array(fit.interval("walk"))
    assert abs(low / 500 - 1) < 1e-3 and abs(high / 500 - 1) < 1e-3


def test_what_the_terms_do_not_explain_is_said():
    t = PERIOD * np.arange(COUNT)
    assert F.allan_fit(synthetic(1), PERIOD).notes == ()
    notes = F.allan_fit(synthetic(1) + 2e-2 * np.sin(2 * np.pi * 3.0 * t), PERIOD).notes
    assert len(notes) == 1
    assert notes[0].startswith("white, flicker, walk do not explain")


def test_the_mean_of_a_log_is_as_uncertain_as_it_says():
    """White noise and a walk: the mean against the bias at the end, over 300 synthetic logs."""
    rng = np.random.default_rng(8)
    count, duration = 1000, 1000 * PERIOD
    bias = np.cumsum(WALK * np.sqrt(PERIOD) * rng.standard_normal((300, count)), axis=1)
    mean = (bias + WHITE / np.sqrt(PERIOD) * rng.standard_normal((300, count))).mean(axis=1)
    expected = np.sqrt(WHITE**2 / duration + WALK**2 * duration / 3)
    assert abs(np.std(mean - bias[:, -1]) / expected - 1) < 0.15
    fit = F.allan_fit(synthetic(2, 50_000, walk=WALK), PERIOD, terms=("white", "walk"))
    assert abs(fit.mean_deviation(duration) / expected - 1) < 0.2


def test_what_makes_no_sense_is_said():
    error = gt.results.ArgumentError
    with pytest.raises(error, match="at least 64 samples; found 10"):
        F.allan_fit(np.arange(10.0), 0.1)
    with pytest.raises(error, match="the values do not change"):
        F.allan_fit(np.ones(100), 0.1)
    with pytest.raises(error, match="1 not finite"):
        F.allan_fit([np.nan, *np.arange(99.0)], 0.1)
    with pytest.raises(error, match="more than 0 s"):
        F.allan_deviation(np.arange(9.0), 0.0)
    with pytest.raises(error, match="numbers of samples from 1 to 4"):
        F.allan_deviation(np.arange(9.0), 1.0, [5])
    with pytest.raises(error, match="expected terms"):
        F.allan_fit(np.arange(99.0), 1.0, terms=("pink",))
