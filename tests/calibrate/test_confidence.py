"""Intervals that hold the truth as often as they say, on synthetic noise whose seeds were fixed beforehand."""

from functools import partial

import numpy as np
import pytest

from gtmodel.calibrate import Measurements, calibrate
from gtmodel.calibrate.report.intervals import Confidence
from gtmodel.inference import coverage, monte_carlo, noise_size
from tests.calibrate.runs import CHOICES, NOISE, POSES, noise, one, ready, truth
from tests.calibrate.synthetic import measured, poses, true_robot

SEED = 20261121
MODELS = ("three_link", "six_link", "f1_unit")


@pytest.mark.parametrize(("known", "cost"), [(True, "length"), (False, "squared"), (True, "orthogonal")])
def test_a_draw_of_intervals_of_the_modified_model(known, cost):
    runs = monte_carlo(partial(one, kind="three_link", cost=cost, known=known), 40, SEED, processes=0)
    covered = coverage(runs.results, truth("three_link"))
    assert not covered.outside and not covered.biased
    assert 0.90 <= covered.pooled <= 0.99  # 40 runs of three arms, each some two independent intervals: 3.3 deviations


@pytest.mark.proof
@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("known", [True, False])
def test_five_hundred_seeds(kind, known):
    runs = monte_carlo(partial(one, kind=kind, known=known), 500, SEED)
    covered = coverage(runs.results, truth(kind))
    assert covered.band == (458, 489)
    assert covered.passed, str(covered)


@pytest.mark.proof
def test_plate_joints_that_hardly_turn_have_no_true_intervals():
    """D1 with B free, 500 seeds: 63 % pooled, 57 to 477 hits; the kind tells none (WEAK)."""
    covered = coverage(monte_carlo(partial(one, kind="six_link_free"), 500, SEED).results, truth("six_link_free"))
    assert covered.pooled < 0.75 and covered.hits.min() < 100
    low, _ = covered.band
    first = [h for n, h in zip(covered.names, covered.hits, strict=True) if n[1:3] == "[0"]
    assert min(first) >= low  # arm 1, whose joint is told to a centimetre


def test_the_kind_tells_no_interval_there():
    m = measured("six_link", 100, noise("six_link_free"), 1)
    free = Confidence(calibrate(ready("six_link_free").on(m)))
    assert not free.holds and "times its expected error" in free.reasons[0]
    assert Confidence(calibrate(ready("six_link").on(m))).holds


def test_the_stated_noise_is_judged_by_the_residuals():
    m = measured("three_link", 60, noise("three_link"), 4)
    stated = calibrate(true_robot("three_link"), m, cost="orthogonal").estimate
    alone = calibrate(true_robot("three_link"), Measurements(m.values)).estimate
    assert stated is not None and alone is not None
    assert noise_size(stated).passed and stated.degrees_of_freedom == 60 * 3 - 21
    assert alone.noise == pytest.approx(np.hypot(NOISE["T"], 0.9 * NOISE["q"]), rel=0.15) and not alone.known_noise
    np.testing.assert_allclose(alone.std, calibrate(true_robot("three_link"), m).estimate.std, rtol=0.35)
    half = Measurements(m.values, {n: s / 2 for n, s in m.noise.items()})
    judged = calibrate(true_robot("three_link"), half, cost="orthogonal").estimate
    assert judged is not None and judged.noise == pytest.approx(2 * stated.noise, rel=1e-6)
    assert "times the stated noise: the model lacks" in noise_size(judged).message and not noise_size(judged).passed


@pytest.mark.parametrize("kind", MODELS)
def test_residuals_are_as_large_as_the_stated_noise_whatever_the_cost_weighs(kind):
    sizes = [
        calibrate(ready(kind).on(measured(kind, POSES[kind], noise(kind), seed))).estimate.noise for seed in range(4)
    ]
    assert abs(np.mean(sizes) - 1) < 0.08  # links of a pose share its noise: few of the residuals are their own


def test_the_predicted_covariance_is_that_of_the_fit_before_anything_is_measured():
    p = ready("three_link")
    before = p.identifiability(sigma=NOISE["T"])
    after = calibrate(p.on(measured("three_link", 60, {"T": NOISE["T"]}, 1, known=False)))
    assert after.estimate is not None
    np.testing.assert_allclose(after.estimate.std / after.estimate.noise, before.std / NOISE["T"], rtol=0.1)


def test_outliers_are_borne_by_a_robust_loss():
    m = measured("three_link", 60, {"T": NOISE["T"]}, 7, known=False)
    T = np.array(m.values["T"])
    T[[5, 17, 40]] += [[0.01, 0, 0], [0, -0.02, 0], [0, 0, 0.015]]
    spoilt = Measurements({"q": m.values["q"], "T": T})
    plain, robust = (
        calibrate(true_robot("three_link"), spoilt, loss=name, width=1e-4) for name in ("linear", "cauchy")
    )
    true = truth("three_link")
    error = [max(abs(c.values[n] - v) for n, v in true.items()) for c in (plain, robust)]
    assert error[1] < 0.1 * error[0] and error[1] < 5e-4
    assert set(np.argsort(robust.pose_errors)[-3:]) == {5, 17, 40}
    assert robust.estimate is not None
    assert np.all(np.abs([robust.values[n] - true[n] for n in robust.estimate.names]) < 5 * robust.estimate.std)


def test_wide_start_errors_converge():
    """Basin: normal errors of 50 mm in A and L and 0.05 in v, as after a tape measure; all of ten starts come back."""
    p = ready("three_link").on(Measurements(poses("three_link", 60)))
    rng, true = np.random.default_rng(SEED), truth("three_link")
    for _ in range(10):
        c = calibrate(p, start={n: v + 0.05 * rng.standard_normal() for n, v in true.items()})
        assert c.status.ok and np.abs(c.start).max() > 0.05
        assert max(abs(c.values[n] - v) for n, v in true.items()) < 1e-9


def test_without_confidence_the_solution_is_the_same_to_the_bit():
    p = ready("three_link")
    alone, whole = calibrate(p, confidence=False), calibrate(p)
    assert alone.estimate is None and alone.identifiability is None and alone.status.ok
    assert np.array_equal(alone.x, whole.x)


def test_choices_of_the_runs_leave_nothing_undetermined():
    assert [ready(kind).identifiability().redundant for kind in CHOICES] == [0, 0, 0, 0]
