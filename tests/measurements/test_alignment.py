"""Clocks and delays: against known truths, with exact binomial bands, and against a regression by hand."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.measurements import LogError, Search, SyntheticDelay, align, delay_study, made_pair
from gtmodel.measurements.alignment import common_curve
from gtmodel.results import ArgumentError, SolveStatus

# of 200: an exact 95 % interval lies outside with probability 1e-3; of 8: 70 % would be seen as often as of 20 with 16
BAND_200, LEAST_OF_8 = (179, 198), 7
HARD = {"delay": 0.1234, "drift": 5e-5, "jitter": 0.3, "missing": 0.02, "noise": 0.02, "duration": 8.0}


def covered(seeds: range) -> tuple[int, int]:
    """How many 95 % intervals of offset and drift hold the truth."""
    offset = drift = 0
    for seed in seeds:
        made = SyntheticDelay(seed=seed, **HARD)
        fit = align(*made_pair(made), within=(-0.5, 0.5))
        true = -made.delay + made.drift * (fit.warp.at - 0.5 * made.duration)
        low, high = fit.interval("offset")
        offset += low <= true <= high
        low, high = fit.interval("drift")
        drift += low <= made.drift <= high
    return offset, drift


def test_intervals_hold_the_truth():
    """Jitter 30 %, 2 % missing, 50 ppm."""
    offset, drift = covered(range(8))
    assert offset >= LEAST_OF_8 and drift >= LEAST_OF_8


@pytest.mark.proof
def test_intervals_hold_the_truth_as_often_as_they_say():
    offset, drift = covered(range(200))
    assert BAND_200[0] <= offset <= BAND_200[1] and BAND_200[0] <= drift <= BAND_200[1]


def coloured(seed: int) -> tuple[gt.Trajectory, gt.Trajectory, SyntheticDelay]:
    """The late recording has a slow error of its own, three times its noise."""
    made = SyntheticDelay(seed=seed, duration=6.0, noise=1e-3)
    first, late = made_pair(made)
    rng, slow = np.random.default_rng(1000 + seed), np.zeros(len(late))
    for k in range(1, len(slow)):
        slow[k] = 0.95 * slow[k - 1] + 3e-3 * np.sqrt(1 - 0.95**2) * rng.normal()
    return first, gt.Trajectory(late.time, {"q": late["q"] + slow}, {"q": "rad"}), made


def quick_pair(seed: int, duration: float = 40.0, noise: float = 0.01) -> tuple[gt.Trajectory, gt.Trajectory, float]:
    """Some hundred swings at rates of their own, and what the second recording wants added in its middle [s]."""
    rng = np.random.default_rng([40, seed])
    frequency, amplitude, phase = rng.uniform(0.1, 2.5, 9), rng.normal(size=9), rng.uniform(0, 2 * np.pi, 9)
    offset, drift, seen = -7.3, -8e-5, []
    for rate in (50.0, 43.0):
        t = (np.arange(int(duration * rate)) + rng.uniform(-0.3, 0.3, int(duration * rate))) / rate
        seen.append(
            (t, np.sin(2 * np.pi * np.outer(t, frequency) + phase) @ amplitude + noise * rng.normal(size=t.size))
        )
    (t, first), (at, second) = seen
    clock = (at - offset) / (1 + drift)
    late = gt.Trajectory(clock, {"q": 1.7 * second + 0.3}, {"q": "rad"})
    return gt.Trajectory(t, {"q": first}, {"q": "rad"}), late, offset + drift * 0.5 * (clock[0] + clock[-1])


def test_a_motion_that_sixteen_knots_do_not_show_is_aligned():
    """The fit began with a curve of 16 knots, ran away to 0.6 s and 12 % of drift and stayed there, or was refused."""
    hits = 0
    for seed in range(6):
        first, late, true = quick_pair(seed)
        fit = align(first, late)
        assert fit.offset == pytest.approx(true, abs=1e-3) and fit.drift == pytest.approx(-8e-5, abs=2e-5)
        hits += fit.interval("offset")[0] <= true <= fit.interval("offset")[1]
    assert hits >= 5


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(n, marks=pytest.mark.proof) for n in range(2, 6))])
def test_signals_of_two_motions_are_refused(seed: int):
    """Half of them were "explained to 99.997 %", with an interval: by a curve that followed the other one alone."""
    rng, seen = np.random.default_rng([5, seed + 3]), []
    for rate in (50.0, 43.0):
        frequency, amplitude, phase = rng.uniform(0.1, 1.0, 5), rng.normal(size=5), rng.uniform(0, 6, 5)
        t = np.arange(int(12 * rate)) / rate
        motion = np.sin(2 * np.pi * np.outer(t, frequency) + phase) @ amplitude
        seen.append(gt.Trajectory(t, {"q": motion + 0.01 * rng.normal(size=t.size)}, {"q": "rad"}))
    with pytest.raises(LogError, match=r"same motion|repeats itself"):
        align(*seen)


def test_a_noisy_reference_is_no_other_motion():
    first, late, true = quick_pair(1, 12.0)
    rough = gt.Trajectory(
        first.time, {"q": first["q"] + 3.0 * np.random.default_rng(0).normal(size=len(first))}, {"q": "rad"}
    )
    fit = align(rough, late, drift=False)
    low, high = fit.interval("offset")
    assert low < true < high and high - low < 0.1 and fit.explained > 0.99


def test_coloured_residuals_are_seen_and_widen_the_interval():
    first, late, made = coloured(0)
    fit = align(first, late, drift=False, within=(-0.05, 0.05))
    assert fit.coloured and not fit.tests["other signal"].passed and any("Newey" in text for text in fit.notes)
    low, high = fit.interval("offset")
    plain = align(*made_pair(made), drift=False, within=(-0.05, 0.05)).interval("offset")
    assert high - low > 3 * (plain[1] - plain[0])


def test_intervals_of_coloured_residuals_hold_too():
    hits = 0
    for seed in range(10):
        first, late, made = coloured(seed)
        low, high = align(first, late, drift=False, within=(-0.05, 0.05)).interval("offset")
        hits += low <= -made.delay <= high
    assert hits >= 8  # Newey and West's are somewhat narrow on six seconds


def test_white_residuals_pass_as_often_as_they_should():
    """Of 24 tests at 1 % more than one fails with probability 0.02."""
    failed = 0
    for seed in range(12):
        fit = align(*made_pair(SyntheticDelay(seed=seed, duration=5.0, noise=5e-3)), drift=False, within=(-0.05, 0.05))
        failed += sum(not test.passed for test in fit.tests.values())
    assert failed <= 1


def test_a_sum_that_no_step_lowers_ends_the_descent(monkeypatch: pytest.MonkeyPatch):
    """937 times the curve was fitted: the steps were shortened from 1e-5 to nothing in each of 30 iterations."""
    evaluated, counted = common_curve._evaluated, []
    monkeypatch.setattr(common_curve, "_evaluated", lambda *a: [counted.append(1), evaluated(*a)][1])
    made = SyntheticDelay(seed=1, duration=5.0, noise=5e-3)
    low, high = align(*made_pair(made), drift=False, within=(-0.05, 0.05)).interval("offset")
    assert low < -made.delay < high and len(counted) < 150


def test_the_noise_of_each_recording_comes_back():
    first, late = made_pair(SyntheticDelay(noise=1e-3, duration=10.0))
    rng = np.random.default_rng(5)
    late = gt.Trajectory(late.time, {"q": 2.0 * late["q"] + 1.0 + 4e-3 * rng.normal(size=len(late))}, {"q": "rad"})
    fit = align(first, late, drift=False, within=(-0.05, 0.05))
    # the late one has twice 1e-3 and 4e-3; a level of 2,500 rows is known to 1.5 %
    assert fit.noise[0] == pytest.approx([1e-3, np.hypot(2e-3, 4e-3)], rel=0.06)
    assert fit.warp.scale[0] == pytest.approx(2.0, abs=1e-3) and fit.warp.shift[0] == pytest.approx(1.0, abs=1e-3)


def test_a_regression_by_hand_gives_the_same_delay():
    """first(t) - late(t) = delay rate(t) + ..., with central differences, where the delay is under a sample."""
    first, late = made_pair(SyntheticDelay(delay=0.002, noise=1e-4))
    x, y = np.asarray(first["q"]), np.asarray(late["q"])
    rate = np.gradient(x, first.time)
    A = np.column_stack([rate, np.ones_like(x), x])[2:-2]
    by_hand = np.linalg.lstsq(A, (x - y)[2:-2], rcond=None)[0][0]
    s = delay_study({"pair": (first, late)})
    assert s.delay[0] == pytest.approx(by_hand, abs=6e-6) == pytest.approx(0.002, abs=2e-5)


def test_clocks_that_began_apart_are_found_without_a_range():
    first, late = made_pair(SyntheticDelay(delay=0.01, duration=12.0))
    elsewhere = gt.Trajectory(late.time[700:2500] + 3600.0, {"q": late["q"][700:2500]}, {"q": "rad"})
    fit = align(first, elsewhere)
    assert fit.offset == pytest.approx(-3600.01, abs=1e-3)
    brought = fit.bring(elsewhere)
    assert np.interp(brought.time, first.time, first["q"]) == pytest.approx(brought["q"], abs=0.02)


def test_vectors_share_one_offset():
    a = made_pair(SyntheticDelay(seed=1, delay=0.004))
    b = made_pair(SyntheticDelay(seed=2, delay=0.004))
    both = [
        gt.Trajectory(x.time, {"w": np.column_stack([x["q"], y["q"], 0 * x["q"]])}) for x, y in zip(a, b, strict=True)
    ]
    fit = align(both[0], both[1], drift=False, within=(-0.05, 0.05))
    one = align(*a, drift=False, within=(-0.05, 0.05))
    assert fit.offset == pytest.approx(-0.004, abs=4 * fit.estimate.std[0])
    assert fit.estimate.std[0] < one.estimate.std[0]
    assert len(fit.tests) == 4  # the component that stands still says nothing


@pytest.mark.parametrize("case", ["still", "periodic", "unrelated", "apart", "few", "units", "none"])
def test_what_shows_no_offset_is_refused(case):
    t = np.linspace(0, 10, 1001)
    rng = np.random.default_rng(3)
    x = gt.Trajectory(t, {"q": np.sin(2 * np.pi * t) + 1e-3 * rng.normal(size=t.size)}, {"q": "rad"})
    y, within, kind = x, None, LogError
    if case == "still":
        y = gt.Trajectory(t, {"q": 0 * t + 1.0}, {"q": "rad"})
    elif case == "unrelated":
        y = gt.Trajectory(t, {"q": rng.normal(size=t.size)}, {"q": "rad"})
        within = (-0.1, 0.1)
    elif case == "apart":
        within = (100.0, 101.0)
    elif case == "few":
        y = gt.Trajectory(t[:10], {"q": x["q"][:10]}, {"q": "rad"})
    elif case == "units":
        y, kind = gt.Trajectory(t, {"q": x["q"]}, {"q": "m"}), ArgumentError
    elif case == "none":
        y, kind = gt.Trajectory(t, {"p": x["q"]}, {"p": "rad"}), ArgumentError
    with pytest.raises(kind) as error:
        align(x, y, within=within)
    assert len(str(error.value)) < 300


def test_the_study_of_a_synthetic_recording_is_judged_by_its_truth():
    s = delay_study(SyntheticDelay(delay=-0.002, duration=5.0), Search(longest=0.02))
    assert s.status is SolveStatus.SOLVED and s.checks["true_delay"].passed and "synthetic" in (s.synthetic or "")
    low, high = s.interval("synthetic")
    assert s.delay_interval[0] == [low, high] and low < s.delay[0] < high
    table = s.files["delays.csv"]
    assert isinstance(table, str) and table.startswith("# synthetic: ")


def test_a_stopped_study_claims_nothing():
    s = delay_study(SyntheticDelay(), stop=lambda: True)
    assert s.status is SolveStatus.INTERRUPTED and not s.pairs
