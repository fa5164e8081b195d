"""The delayed first-order model: the printed ones back, delay found, intervals, limits said, what is refused."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.optimize import brentq

from gtmodel.inference import binomial_band
from gtmodel.results import ArgumentError
from gtmodel.vibration import Record, bandwidth, identify_step, step_record
from tests.vibration.structures import TS

PRINTED = [(0.9647, 0.03527), (0.9656, 0.03425), (0.9728, 0.02748)]  # eq. (6.11)
EXACT = 1e-9  # relative, noise-free


def steps(a: float, b: float, delay: int = 5, noise: float = 5e-6, seed: int = 0, sizes=(1e-3, 1.5e-3, 2e-3)):
    return [
        step_record(a, b, delay, size, samples=300, before=25, sample_time=TS, noise=noise, seed=seed + n)
        for n, size in enumerate(sizes)
    ]


@pytest.mark.parametrize(("a", "b"), PRINTED)
def test_the_printed_models_come_back_exactly(a, b) -> None:
    found = identify_step(steps(a, b, noise=0.0))
    assert (found.delay, found.delay_sure) == (5, True)
    assert found.a == pytest.approx(a, rel=EXACT) and found.b == pytest.approx(b, rel=1e-7)
    # the printed bandwidths of 1.1 to 1.4 Hz, by a root of the gain of control's own system
    gain = lambda f: abs(found.system(np.exp(2j * np.pi * f * TS))) - found.gain / np.sqrt(2)  # noqa: E731
    assert found.bandwidth_Hz == pytest.approx(brentq(gain, 0.1, 20.0), rel=1e-9)
    assert 1.05 < found.bandwidth_Hz < 1.45
    _, y = control.step_response(found.system, T=TS * np.arange(60))
    np.testing.assert_allclose(y[5:], b * (1 - a ** np.arange(1, 56)) / (1 - a), rtol=1e-6)
    assert np.all(y[:5] == 0)


@pytest.mark.parametrize("delay", [0, 1, 12])
def test_the_delay_is_found(delay) -> None:
    found = identify_step(steps(0.9, 0.1, delay))
    assert (found.delay, found.delay_sure) == (delay, True)
    assert min(found.residual_by_delay, key=lambda d: found.residual_by_delay[d]) == delay
    np.testing.assert_allclose(np.abs(found.system.poles()).max(), found.a)


@pytest.mark.parametrize("times", [2, 20])
def test_copied_recordings_are_refused(times) -> None:
    given = steps(0.9647, 0.03527)
    with pytest.raises(ArgumentError, match=r"from 0 s, .* samples of 'recording 4' repeat .* those of 'recording 1'"):
        identify_step(given * times)
    joined = Record(np.vstack([r.u for r in given] * 2), np.vstack([r.y for r in given] * 2), TS)
    with pytest.raises(ArgumentError, match=r"samples of 'recording 1' repeat .* those of 'recording 1'"):
        identify_step(joined)


def test_an_offset_of_the_sensor_does_not_matter() -> None:
    plain = steps(0.9647, 0.03527)
    moved = [Record(r.u + 0.3, r.y + 0.1 * (n + 1), TS) for n, r in enumerate(plain)]
    one, other = identify_step(plain), identify_step(moved)
    assert other.a == pytest.approx(one.a, rel=1e-9) and other.b == pytest.approx(one.b, rel=1e-6)


def test_limits_are_said() -> None:
    found = identify_step(steps(0.9647, 0.03527))
    assert found.notes[0].startswith("residuals look white")
    assert "the thesis found (6.11) too slow" in found.notes[1] and "above 1.43 Hz" in found.notes[1]
    # a resonance that first order lacks
    t = TS * np.arange(300)
    ringing = [Record(r.u, r.y + 1e-4 * np.sin(2 * np.pi * 7.4 * t)[:, None], TS) for r in steps(0.9647, 0.03527)]
    assert "residuals are coloured" in identify_step(ringing).notes[0]
    # noise that hides which delay it is
    blurred = identify_step(steps(0.9647, 0.03527, noise=3e-4))
    assert not blurred.delay_sure and "cannot be distinguished from its neighbours at 1 %" in blurred.notes[-1]
    # a pole so fast that the gain never falls by 3 dB
    assert bandwidth(0.1, TS) is None and bandwidth(-0.2, TS) is None


def covered(seeds: range) -> tuple[int, int]:
    inside = 0
    for seed in seeds:
        found = identify_step(steps(0.9647, 0.03527, seed=10 * seed, sizes=(1e-3,)), delay=5)
        low, high = found.interval("bandwidth_Hz")
        inside += found.estimate.interval("a")[0] < 0.9647 < found.estimate.interval("a")[1]
        inside += low < bandwidth(0.9647, TS) < high  # type: ignore[operator]
    return inside // 2, len(seeds)  # a and the bandwidth are one number seen twice


def test_intervals_hold_as_often_as_they_say() -> None:
    inside, runs = covered(range(40))
    low, high = binomial_band(runs, 0.95)
    assert low <= inside <= high


@pytest.mark.proof
def test_intervals_hold_as_often_as_they_say_many_seeds() -> None:
    inside, runs = covered(range(1000, 1500))
    low, high = binomial_band(runs, 0.95)
    assert low <= inside <= high


def test_what_is_refused() -> None:
    def refused(sentence, records, **options):
        with pytest.raises(ArgumentError, match=sentence):
            identify_step(records, **options)

    one = steps(0.9, 0.1)[0]
    refused("there is no recording", [])
    refused("a delay of 270 samples is longer than the data: 275 samples follow the step", one, delay=270)
    refused("a delay of 25 samples is longer than the data: 5 samples follow the step", one.rows(0, 30))
    refused("the delay is -1 samples; expected 0 or more", one, delay=-1)
    refused("the input of recording 1 does not move; expected a step after some rest", one.rows(0, 20))
    refused(
        "recording 2 has 1 inputs and 2 outputs; expected one each", [one, Record(one.u, np.hstack([one.y] * 2), TS)]
    )
    refused("the recordings have the sample times 4, 5 ms", [one, Record(one.u, one.y, 0.005)])


def test_a_delay_at_the_end_of_those_tried_is_not_sure() -> None:
    record = step_record(0.9647, 0.0353, 30, 1e-3, samples=400, before=25, sample_time=TS, noise=5e-6, seed=1)
    short, enough = identify_step(record), identify_step(record, longest=40)
    assert not short.delay_sure and any("25 samples; the true delay may be longer" in w for w in short.notes)
    assert enough.delay == 30 and enough.delay_sure


def test_a_response_that_does_not_settle_is_said() -> None:
    record = step_record(0.999, 0.001, 5, 1e-3, samples=400, before=25, sample_time=TS, noise=5e-6, seed=1)
    assert any("of the step before rest" in w for w in identify_step(record).notes)
    assert not any("of the step before rest" in w for w in identify_step(steps(0.9647, 0.0353)).notes)


@pytest.mark.parametrize("slow", [0.1, 1e-3, 1e-6, 1e-9])
def test_the_bandwidth_of_a_slow_pole(slow) -> None:
    """Towards the continuous pole, whose bandwidth is -log(a) / T."""
    assert bandwidth(1 - slow, TS) == pytest.approx(slow / (2 * np.pi * TS), rel=slow + 1e-7)
