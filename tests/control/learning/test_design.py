"""Q from a set of models: its bound by another road, and designs that are refused because they would diverge."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.control import learning
from gtmodel.results.refusal import ArgumentError

TS, N = 0.004, 825
F = learning.frequencies(TS, 2001)


def models(frequency: float, damping: float) -> list[learning.AxisPlant]:
    return [
        learning.flexible_axis(frequency * a, damping * b)
        for a in np.linspace(0.94, 1.06, 5)
        for b in np.geomspace(0.6, 1.6, 5)
    ]


@pytest.mark.parametrize(("frequency", "damping", "shift"), [(7.4, 0.2, 12), (11.5, 0.05, 10)])
def test_the_bound_of_the_realised_filter_holds_over_the_set(frequency: float, damping: float, shift: int) -> None:
    estimate, plants = learning.measured(N), models(frequency, damping)
    made = learning.robust_filter(learning.rests_of(estimate, plants, 0.9, shift, F), F, 30.0)
    assert made.bound.value < 0.95
    # by another road: transforms of taps and of pulse responses, at other frequencies, of every model
    size = 16384
    both = np.zeros(size)
    both[: len(made.taps)] = made.taps
    both[-len(made.taps) + 1 :] += made.taps[:0:-1]
    Q = np.fft.rfft(both).real
    z = np.exp(2j * np.pi * np.fft.rfftfreq(size))
    largest = max(
        float(np.max(np.abs(Q * (1 - 0.9 * z**shift * np.fft.rfft(learning.pulse_response(p.signals["tool"], size))))))
        for p in plants
    )
    assert largest == pytest.approx(made.bound.value, abs=5e-3)
    assert largest < 1
    # it learns: nearly all below the mode, nothing far above the low pass
    assert np.abs(Q[: int(4.0 * TS * size)] - 1).max() < 0.1
    assert np.abs(Q[int(70.0 * TS * size) :]).max() < 0.02


@pytest.mark.parametrize("corner", [(0.94, 0.6), (1.06, 0.6), (1.0, 1.0), (0.94, 1.6), (1.06, 1.6)])
def test_nothing_diverges_over_the_set(corner: tuple[float, float]) -> None:
    plants = models(11.5, 0.05)
    made = learning.robust_filter(learning.rests_of(learning.measured(N), plants, 0.9, 10, F), F, 30.0)
    law = learning.LearningLaw(
        learning.weighted(learning.input_window(N)) @ learning.symmetric(made.taps, N), learning.shifted(N, 0.9, 10)
    )
    T = learning.flexible_axis(11.5 * corner[0], 0.05 * corner[1]).maps(N)["tool"]
    assert learning.largest_gain(law.map(T)) < 1  # so the run of any length contracts
    r = learning.SquarePath().samples(TS)[:, 1]
    run = learning.learn(law, r - T(r), T, runs=30)
    size = np.linalg.norm(run.errors[:, 100:725], axis=1)
    assert size[-1] < 0.1 * size[0] and size[20:].max() < 0.1 * size[0]


def test_a_low_pass_above_the_mode_is_refused_and_would_diverge() -> None:
    law = learning.simple_law(N, 0.9, 5, 30.0)
    T = learning.flexible_axis(11.5, 0.05).maps(N)["tool"]
    with pytest.raises(ArgumentError) as error:
        learning.rate(law, T)
    assert error.value.argument == "law" and "diverges" in error.value.message
    r = learning.SquarePath().samples(TS)[:, 1]
    run = learning.learn(law, r - T(r), T, runs=30)  # what is refused does diverge
    size = np.linalg.norm(run.errors, axis=1)
    assert size[-1] > 10 * size[0]


def test_a_filter_too_short_for_the_mode_is_refused() -> None:
    rests = learning.rests_of(learning.measured(N), models(11.5, 0.02), 0.9, 0, F)
    with pytest.raises(ArgumentError) as error:
        learning.robust_filter(3 * rests, F, 30.0, length=2, contraction=0.999)
    assert error.value.argument == "length"


def test_without_the_ramps_sigma_exceeds_1_and_the_words_say_why() -> None:
    plants = [learning.flexible_axis(11.5, 0.05)]
    made = learning.robust_filter(learning.rests_of(learning.measured(N), plants, 0.9, 10, F), F, 30.0)
    bare = learning.LearningLaw(learning.symmetric(made.taps, N), learning.shifted(N, 0.9, 10))
    T = plants[0].maps(N)["tool"]
    said = learning.rate(bare, T)
    assert said.sigma > 1 > said.rho and said.converges and not said.monotone
    assert "Q_w" in said.words and "last sample" in said.words
    ramped = learning.LearningLaw(learning.weighted(learning.input_window(N)) @ bare.Q, bare.L)
    with_ramps = learning.rate(ramped, T)
    assert with_ramps.monotone
    # sigma of the run, and the bound over frequency, agree within a hundredth
    assert with_ramps.sigma == pytest.approx(made.bound.value, abs=0.01)


def test_refusals() -> None:
    f = learning.frequencies(TS, 11)
    for argument, cutoff, contraction in (("contraction", 30.0, 1.2), ("cutoff", 200.0, 0.9)):
        with pytest.raises(ArgumentError) as error:
            learning.robust_filter(np.ones(11), f, cutoff, contraction=contraction)
        assert error.value.argument == argument
    with pytest.raises(ArgumentError) as error:
        learning.robust_filter(np.full(11, np.nan), f, 30.0)
    assert error.value.argument == "rests"
    with pytest.raises(ArgumentError) as error:
        learning.SquarePath(side_time=0.008).samples(TS)
    assert error.value.argument == "side_time"
