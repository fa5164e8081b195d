"""The experiment of Cvitanic 2021, chapter 4: what the printed design and a consistent one give, against baselines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering.fusion.options import printed_errors
from gtmodel.filtering.fusion.scene import scene_of, slope_velocity
from gtmodel.filtering.fusion.study import _crossing
from gtmodel.results.refusal import ArgumentError
from gtmodel.results.work import Interrupted

F = gt.filtering
TWO_FILTERS = F.FusionFilter(
    jerk_density=(0.1, 0.1, 0.1), angular_jerk_density=1e2, fast_jerk_density=40.0, fast_angular_jerk_density=1e7,
    smooth=True,
)  # fmt: skip


@pytest.fixture(scope="module")
def consistent() -> F.FusionStudy:
    return F.fusion_study(filter=F.FusionFilter(smooth=True), seed=1)


@pytest.fixture(scope="module")
def printed() -> F.FusionStudy:
    return F.fusion_study(F.TrackedPath(duration=2.0), filter=F.FusionFilter(printed=True), seed=1)


def test_the_slope_of_four_has_its_closed_form_noise():
    """sigma sqrt(12 / (n (n^2 - 1))) / dt: 2.86 mm/s, times 0.798 the mean of its absolute value."""
    still = F.TrackedPath(kind="line", duration=5.0)
    scene = scene_of(still, F.FusionSensors(), seed=3)
    error = (slope_velocity(scene.log["tracker"]) - scene.motion.v)[3:]
    expected = 6.4e-6 * np.sqrt(12 / (4 * 15)) / 1e-3
    assert error.std() == pytest.approx(expected, rel=0.02)  # of 15,000 numbers, correlated over four


def test_the_printed_covariance_means_nothing_but_filters(printed):
    assert 0.93 < printed.below_slope[2] < 0.96
    assert printed.nis / 3 < 0.05  # of the pair of position and acceleration of one axis, whose mean is to be 2
    assert printed.fused["position"] == pytest.approx(printed.alone["position"], rel=1e-3)  # no position gained
    assert "too small" in printed.verdict
    assert printed.preferred_jerk_density == 0.1
    assert any("0.1 m2/s5" in note for note in printed.notes)


def test_the_consistent_design_is_better_and_may_be_believed(consistent, printed):
    assert consistent.below_slope[2] > 0.97
    low, high = consistent.nis_band
    assert low < consistent.nis < high and consistent.nis_numbers == 6
    assert consistent.velocity_fused[0] < printed.velocity_fused[0]
    assert max(consistent.velocity_smoothed) < 0.3e-3
    assert consistent.preferred_jerk_density is None


def test_both_baselines_are_printed(consistent):
    text = str(consistent)
    assert "slope of four" in text and "tracker alone" in text and "SYNTHETIC" in text
    assert 0 < consistent.below_tracker[2] < consistent.below_slope[2]


def test_the_metric_of_table_8_is_found(consistent):
    """0.0089 mm is |sum of the components|; 0.0066 its deviation: deviation over mean is 0.756 of a scalar normal."""
    axis, length, total = consistent.alone["position"]
    assert total == pytest.approx(8.9e-6, rel=0.03)
    assert axis == pytest.approx(6.4e-6 * np.sqrt(2 / np.pi), rel=0.02)
    assert length == pytest.approx(6.4e-6 * np.sqrt(8 / np.pi), rel=0.02)


def test_printed_errors_stand_beside_ours_where_the_numbers_are_the_same(consistent):
    assert consistent.printed_in == "Table 8" and consistent.printed["position"] == (8.9e-6, 8.9e-6)
    assert "Table 8" in str(consistent)
    path = F.TrackedPath()
    assert printed_errors(path, F.FusionSensors(acceleration_noise=0.0039))[0] == "Table 9"
    assert printed_errors(path, F.FusionSensors(rate_noise=np.radians(0.016))) == ("", {})  # no rotation in 3 axes
    turning = printed_errors(F.TrackedPath(axes=5), F.FusionSensors(rate_noise=np.radians(0.016)))
    assert turning == ("Table 9", {"angular_velocity": (None, pytest.approx(np.radians(0.35)))})
    assert printed_errors(path, F.FusionSensors(arm_error=1e-3)) == ("", {})


@pytest.mark.proof
@pytest.mark.parametrize(
    ("duration", "seed"),
    [(2.0, 1), *(pytest.param(F.TrackedPath().duration, seed, marks=pytest.mark.proof) for seed in range(1, 9))],
)  # the densities were chosen on 1 to 4
def test_five_axes_by_two_interacting_filters(duration, seed):
    study = F.fusion_study(F.TrackedPath(axes=5, duration=duration), filter=TWO_FILTERS, seed=seed)
    off, at = study.velocity_fused
    assert at <= study.velocity_tracker[1]
    assert 1 - at / study.velocity_slope[1] >= 0.60
    assert 1 - off / study.velocity_slope[0] >= 0.90
    assert max(study.velocity_smoothed) <= 0.3e-3
    assert study.fast_share[1] > 0.9 and study.fast_share[0] < 0.1
    assert any("ideal" in note for note in study.notes)


@pytest.mark.proof
def test_one_slow_filter_fails_at_the_bend():
    """The printed kind of model, angular acceleration nearly constant: worse there than the tracker alone."""
    slow = replace(TWO_FILTERS, fast_jerk_density=None, fast_angular_jerk_density=None, smooth=False)
    study = F.fusion_study(F.TrackedPath(axes=5, duration=2.0), filter=slow, seed=1)
    assert study.velocity_fused[1] > study.velocity_tracker[1]
    assert study.nis > study.nis_band[1]


@pytest.mark.proof
def test_a_sweep_says_where_fusion_ends():
    sweep = F.FusionSweep("acceleration_bias", (0.0, 0.01, 1.0))
    study = F.fusion_study(sweep=sweep)
    assert np.all(np.diff(study.sweep_fused) > 0)
    assert np.ptp(study.sweep_slope) == 0.0  # the tracker does not know of it
    assert study.limit_tracker is not None and study.limit_tracker < study.limit_slope
    assert study.limit_printed == 0.001
    assert "sweep" in study.figures
    assert study.sweep_consistent[0] and not study.sweep_consistent[-1]


def test_a_crossing_lies_between_two_values():
    assert _crossing([1.0, 10.0, 100.0], [1.0, 10.0, 100.0], [30.0] * 3) == pytest.approx(30.0)
    assert _crossing([1.0, 10.0], [1.0, 2.0], [3.0, 3.0]) is None
    assert _crossing([1.0, 10.0], [4.0, 5.0], [3.0, 3.0]) == 1.0


def test_the_same_seed_gives_the_same_study():
    path = F.TrackedPath(duration=0.1)
    a, b = F.fusion_study(path, seed=5), F.fusion_study(path, seed=5)
    assert str(a) == str(b) and a.trajectory == b.trajectory
    assert F.fusion_study(path, seed=6).nis != a.nis


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        (dict(path=F.TrackedPath(axes=5), filter=F.FusionFilter(printed=True)), "filter.printed"),
        (dict(filter=F.FusionFilter(printed=True, fast_jerk_density=1.0)), "filter.fast_jerk_density"),
        (dict(filter=F.FusionFilter(fast_angular_jerk_density=1.0)), "filter.fast_jerk_density"),
        (dict(filter=replace(TWO_FILTERS, kind="unscented")), "filter.kind"),
        (dict(filter=F.FusionFilter(kind="particle", smooth=True)), "filter.smooth"),
        (dict(path=F.TrackedPath(duration=0.01)), "path.duration"),
        (dict(sensors=F.FusionSensors(sample_time=1.0)), "sensors.sample_time"),
    ],
)
def test_what_does_not_fit_is_refused(options, argument):
    with pytest.raises(gt.results.ArgumentError) as refused:
        F.fusion_study(**options)
    assert refused.value.argument == argument


def test_the_effective_size_of_particles_is_said():
    study = F.fusion_study(F.TrackedPath(duration=0.1), filter=F.FusionFilter(kind="particle", particles=100))
    assert any("effective" in note for note in study.notes)


def test_a_study_can_be_stopped():
    study = F.fusion_study(F.TrackedPath(duration=1.0), max_seconds=1e-6)
    assert study.status.value == "interrupted" and str(study)


def test_a_study_is_stopped_while_it_compares_densities():
    """Six runs of the whole log, in which nobody asked."""
    said: list[str] = []
    study = F.fusion_study(
        F.TrackedPath(duration=0.3), filter=F.FusionFilter(printed=True),
        progress=lambda what, *_: said.append(what), stop=lambda: "likelihood of other densities" in said,
    )  # fmt: skip
    assert said[-1] == "likelihood of other densities" and study.nis is not None
    assert study.status.value == "interrupted" and study.preferred_jerk_density is None


@pytest.mark.proof
def test_outliers_of_the_tracker_are_weighed():
    """One position of ten off by twenty deviations: next to no loss with weights, four times the error without."""
    path, sensors = F.TrackedPath(duration=0.6), F.FusionSensors(outlier_share=0.1)
    clean, plain, robust = (
        F.fusion_study(path, s, F.FusionFilter(outliers=weights), seed=1)
        for s, weights in ((None, None), (sensors, None), (sensors, "huber"))
    )
    assert plain.velocity_fused[0] > 2 * clean.velocity_fused[0]
    assert robust.velocity_fused[0] < 1.2 * clean.velocity_fused[0]
    assert robust.counted_less.keys() == {"tracker"} and 0.22 < robust.counted_less["tracker"] < 0.30
    assert "off by 20 times" in robust.synthetic and "counted less as outliers" in str(robust)
    assert robust.nis_numbers < 6 == plain.nis_numbers


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"filter": F.FusionFilter(particles=50)}, "filter.particles"),
        ({"filter": F.FusionFilter(exact_step=True)}, "filter.exact_step"),
        ({"filter": F.FusionFilter(stay=0.9)}, "filter.stay"),
        ({"filter": F.FusionFilter(angular_jerk_density=1.0)}, "filter.angular_jerk_density"),
        ({"filter": F.FusionFilter(printed=True, jerk_density=(1.0, 1.0, 1.0))}, "filter.jerk_density"),
        ({"sensors": F.FusionSensors(rate_bias=0.1)}, "sensors.rate_bias"),
        ({"sensors": F.FusionSensors(arm=(0.0, 0.0, 0.1))}, "sensors.arm"),
        ({"path": F.TrackedPath(turn=0.1)}, "path.turn"),
        ({"path": F.TrackedPath(kind="line", amplitude=0.1)}, "path.amplitude"),
        ({"path": F.TrackedPath(duration=1e7)}, "path.duration"),
        ({"sweep": F.FusionSweep("rate_noise", (1e-3,))}, "sweep.parameter"),
        ({"sweep": F.FusionSweep("sample_time", ())}, "sweep.values"),
        ({"sweep": F.FusionSweep("sample_time", (0.001, -1.0))}, "sweep.values"),
        ({"sweep": F.FusionSweep("sample_time", (0.001, 3.0))}, "sweep.values"),
    ],
)
def test_what_changes_nothing_or_does_not_fit_is_refused(options, argument):
    with pytest.raises(ArgumentError) as caught:
        F.fusion_study(**options)
    assert caught.value.argument == argument


@pytest.mark.parametrize("asked", (1, 2, 3, 4, 5, 6, 8))
def test_a_stopped_study_has_the_numbers_of_the_rows_it_got_to(asked: int) -> None:
    asks = iter(range(asked))
    sweep = F.FusionSweep("acceleration_bias", (0.0, 1.0))
    s = F.fusion_study(F.TrackedPath(duration=0.8), sweep=sweep, seed=2, stop=lambda: next(asks, None) is None)
    assert s.status is gt.SolveStatus.INTERRUPTED
    if s.trajectory is None:  # before the filter ran
        assert asked <= 2 and not s.velocity_fused
        return
    motion = s.trajectory
    error = np.abs(motion["velocity_fused"] - motion["velocity"])[:, [0, 2]].mean(axis=1)
    settled, bend = motion.time >= 0.02, motion["at_bend"] > 0.5
    assert s.velocity_fused[0] == pytest.approx(
        error[settled & ~bend].mean(), rel=1e-12
    )  # the same sum, in another order
    assert len(motion) == 801 or "was stopped after" in s.notes[-1]
    assert all(s.figure(name) for name in s.figures) and "fused" in str(s)


def test_a_study_that_is_ended_while_it_smooths_has_its_filters_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    def late(_: object) -> None:
        raise Interrupted("an alarm")

    path = F.TrackedPath(duration=0.15)
    whole = F.fusion_study(path, seed=2)
    monkeypatch.setattr("gtmodel.filtering.fusion.study.smooth", late)
    s = F.fusion_study(path, filter=F.FusionFilter(smooth=True), seed=2)
    assert s.status is gt.SolveStatus.INTERRUPTED
    assert "fused" in str(s)
    assert (s.velocity_fused, s.below_tracker) == (whole.velocity_fused, whole.below_tracker)
