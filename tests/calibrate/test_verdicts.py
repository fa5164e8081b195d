"""Verdicts on synthetic calibrations of all robots that shipped problems calibrate: a perfect model is proven, one that
lacks an effect is not.

All parameters are determined in rank, and 12 equations or more are spare in the fit; as many poses are held out. The
error that the model lacks is a wave of one to three periods over the range of each coordinate, in every measured
signal, of three times the noise of this signal: rms, before the fit. A fit takes up some of it, so that this is the
harder of the two ways to count; what it takes up of slower waves, of half a period, is most of them, as offsets and
scales do the same: then it is no error that the model lacks. The bound was chosen on seeds 0 to 29; the proof has
others. Seeds 2000 to 2059 found that a fit of few poses may be too far off for one step of Gauss-Newton, so that the
proof has others again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.calibrate import CalibrationStudy, Cost, Measurements, against_noise, calibrate, pattern, prepare, study
from gtmodel.inference import OverNoise, binomial_band, chi_squared_over_noise
from tests.calibrate.drawn import KINDS, drawing, drawn, judged, poses_of
from tests.calibrate.shipped import PROBLEMS
from tests.calibrate.synthetic import measured, true_robot

SOUND = 0.95
FEW, MANY = 2, 60  # of each of seven kinds: 420 perfect ones and 420 that lack an effect
FRESH = range(3000, 3000 + MANY)  # fixed before they were run


def stated(factor: float, by: float = 1.0) -> CalibrationStudy:
    """Of 80 poses of an L1, of which each has `factor` times the noise that is stated; this is stated `by` so much
    larger."""
    poses = poses_of("three_link", drawn("three_link", 3, 80))
    m = poses.measurements
    noise = {n: by / factor * np.asarray(s) for n, s in m.noise.items()}
    return study(
        drawing("three_link", 3), replace(poses, measurements=replace(m, noise=noise)), KINDS["three_link"].fit
    )


def of_noise(s: CalibrationStudy) -> str:
    (sentence,) = [v for v in s.verdict or () if v.startswith("residuals are ")]
    return sentence


@pytest.mark.parametrize("kind", [pytest.param(k, marks=[pytest.mark.proof] * (k in ("f1", "hexapod"))) for k in KINDS])
def test_a_perfect_model_is_proven_and_one_that_lacks_an_effect_is_not(kind: str) -> None:
    sound, wrong = ([judged(kind, seed, effect) for seed in range(FEW)] for effect in (0.0, 3.0))
    for s in sound:
        assert s.identifiability_after is not None and s.identifiability_after["redundant"] == 0
    assert all(s.prediction_proven for s in sound)
    assert not any(s.prediction_proven for s in wrong)


@pytest.mark.proof
@pytest.mark.parametrize("kind", KINDS)
def test_of_fresh_seeds(kind: str) -> None:
    """At least 57 of 60, and at most 3 of 60, of each kind."""
    sound = sum(bool(judged(kind, seed).prediction_proven) for seed in FRESH)
    wrong = sum(bool(judged(kind, seed, 3.0).prediction_proven) for seed in FRESH)
    print(f"{kind}: {sound} of {MANY} perfect models are proven, {wrong} of {MANY} that lack an effect")
    assert sound >= SOUND * MANY and wrong <= (1 - SOUND) * MANY


@pytest.mark.parametrize("draws", [30, pytest.param(60, marks=pytest.mark.proof)])
def test_errors_beside_their_noise_are_chi_squared_whatever_the_cost(draws: int) -> None:
    """60 poses fitted and 20 held out: 240 errors less 21 unknowns. By the 99.9 % band of the draws."""
    ratios: dict[Cost, list[OverNoise]] = {"length": [], "orthogonal": [], "forward": []}
    ready = None
    for seed in range(draws):
        m = measured("three_link", 80, {"q": 13e-6, "T": 50e-6}, seed)
        a, b = m.part(np.arange(60)), m.part(np.arange(60, 80))
        ready = ready or prepare(true_robot("three_link"), a)
        p = ready.on(a)
        for cost, judged_ in ratios.items():
            one = against_noise(calibrate(p, cost=cost), [p.on(b)])
            assert one is not None
            judged_.append(one)
    low, high = binomial_band(draws, 0.2)
    for judged_ in ratios.values():
        assert {j.degrees_of_freedom for j in judged_} == {219}
        assert low <= sum(j.p < 0.2 for j in judged_) <= high
    # the same errors, whichever way the fit counted them
    by_length, by_distance, _ = (np.array([j.ratio for j in each]) for each in ratios.values())
    np.testing.assert_allclose(by_length, by_distance, rtol=1e-3)


def test_all_poses_in_one_fit_leave_the_same() -> None:
    """By an independent way: the sum of squares of one orthogonal fit of them all."""
    m = measured("three_link", 30, {"q": 13e-6, "T": 50e-6}, 5)
    a, b = m.part(np.arange(20)), m.part(np.arange(20, 30))
    c = calibrate(true_robot("three_link"), a)
    judged_ = against_noise(c, [c.problem.on(b)])
    every = calibrate(true_robot("three_link"), m, cost="orthogonal").estimate
    assert judged_ is not None and every is not None
    assert judged_.ratio == pytest.approx(every.noise, rel=1e-4) and judged_.degrees_of_freedom == 69


def test_noise_that_was_stated_too_small_is_said_with_the_noise_that_would_do() -> None:
    right, little, much = stated(1.0), stated(1.3), stated(2.0)
    assert right.prediction_proven and of_noise(right).startswith("residuals are as large as the stated noise")
    assert little.prediction_proven and "the 1.5 times that matter" in of_noise(little)
    assert not much.prediction_proven and not much.checks["residuals_over_noise"].passed
    assert "residuals show no pattern over the actuator positions" in of_noise(much)
    assert "the stated noise is too small, or the model lacks an effect of another shape" in of_noise(much)
    assert "A noise of q 0.013 mm, T 0.051 mm would explain their size" in of_noise(much)
    assert stated(2.0, by=2.0).prediction_proven  # what the sentence says, done
    assert "it was stated too large" in of_noise(stated(0.5)) and stated(0.5).prediction_proven


def test_few_poses_do_not_say_whether_an_effect_is_lacking_or_noise_was_stated_too_small() -> None:
    s = judged("delta", 4, 3.0)
    assert not s.prediction_proven and "too few poses to decide" in of_noise(s)


def test_an_effect_that_the_model_lacks_shows_its_pattern() -> None:
    values = drawn("six_link", 4, 80, 3.0)
    s = study(drawing("six_link", 4), poses_of("six_link", values), KINDS["six_link"].fit)
    assert not s.prediction_proven and "residuals depend on the actuator positions" in of_noise(s)
    assert of_noise(s).partition(". A noise")[0].endswith("the model lacks an effect")


@pytest.mark.parametrize("known", [True, False])
def test_noise_shows_no_pattern(known: bool) -> None:
    """120 draws of noise, by the 99.9 % band of a fifth; where it is not stated the test is but nearly right."""
    runs, seldom, ready, seen = 120, 0.2, None, []
    for seed in range(runs):
        m = measured("three_link", 80, {"q": 13e-6, "T": 50e-6}, seed, known)
        a, b = m.part(np.arange(50)), m.part(np.arange(50, 80))
        ready = ready or prepare(true_robot("three_link"), a)
        p = ready.on(a)
        one = pattern(calibrate(p, confidence=False), [p.on(b)])
        assert one is not None
        seen.append(one)
    low, high = binomial_band(runs, seldom)
    assert low <= sum(v.p < seldom for v in seen) <= high
    assert sum(not v.passed for v in seen) <= binomial_band(runs, 0.01)[1]


def test_without_a_stated_noise_the_verdict_says_what_it_cannot_see() -> None:
    poses = poses_of("three_link", drawn("three_link", 3, 80))
    unknown = Measurements(poses.measurements.values, {}, poses=poses.measurements.poses)
    s = study(drawing("three_link", 3), replace(poses, measurements=unknown), KINDS["three_link"].fit)
    assert s.prediction_proven and "residuals_over_noise" not in s.checks
    assert "deviation of q and T is not stated" in str(s.verdict) and "can pass for noise" in str(s.verdict)
    half = Measurements(poses.measurements.values, {"T": 5e-5}, poses=poses.measurements.poses)
    said = str(study(drawing("three_link", 3), replace(poses, measurements=half), KINDS["three_link"].fit).verdict)
    assert "deviation of q is not stated" in said


def test_the_bound_is_what_matters_or_what_chance_does() -> None:
    many, few = (chi_squared_over_noise(n * 1.45**2, n) for n in (500, 12))
    assert many.bound == 1.5 and many.passed and not many.as_stated
    assert few.bound == pytest.approx(np.sqrt(32.909 / 12), rel=1e-4) and few.passed  # chi-squared tables, 12 and 0.001
    assert not chi_squared_over_noise(500 * 1.55**2, 500).passed
    nothing = chi_squared_over_noise(0.0, 0)
    assert nothing.bound == np.inf and not nothing.passed and "do not show the noise" in nothing.message


@pytest.mark.parametrize("seed", [pytest.param(4, marks=pytest.mark.proof), 12])
def test_a_fit_that_slides_to_where_no_pose_closes_is_held_near_its_start(seed: int) -> None:
    """Two draws of the F1 whose 13 poses determine 19 combinations no better than they were known: one of 13 held-out
    poses and all 13 did not close, as two links had come to coincide."""
    s = judged("f1", seed)
    assert s.prediction_proven and "63 unknowns are held near their start" in str(s.verdict)
    assert (
        s.held_out is not None
        and s.held_out["mean"] < 1e-3
        and "held_out_poses_lost" not in {n for n, c in s.checks.items() if not c.passed}
    )


@pytest.mark.parametrize(("effect", "proven"), [(0.0, True), (3.0, False)])
def test_a_fit_that_few_poses_left_far_off_is_judged_where_all_poses_are_explained_best(
    effect: float, proven: bool
) -> None:
    """A draw of the F1 whose 13 fitted poses put it 21 mm off at the worst of the others: one step of Gauss-Newton left
    5 times the noise."""
    s = judged("f1", 2012, effect)
    over = s.checks["residuals_over_noise"]
    assert s.prediction_proven is proven and over.passed is proven
    assert 0.8 < over.value < 1.2 if proven else over.value > 2.5


def test_poses_that_hardly_determine_a_parameter_do_not_contradict_what_was_known_of_it() -> None:
    """Without its prior the fit of D1's model 3 goes 0.29 m along what it determines to 0.04 m only, where intervals of
    linearised least squares do not hold: the prior is that of the drawing, off by 0.6 mm in truth."""
    s = gt.load(PROBLEMS / "calibrate_d1_model_3.toml", "sensitivity_step=0")()
    assert s.prediction_proven and not any("contradicts" in sentence for sentence in (*s.verdict, *s.notes))
    # its guideways are not straight, by less than the noise that was stated for the carts
    assert "residuals are 1.19 times" in of_noise(s) and "residuals depend on the actuator positions" in of_noise(s)
