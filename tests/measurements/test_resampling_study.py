"""The resampling study on objects: clocks, delays, gaps, intervals that heed coloured residuals."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.measurements import AlignBy, EvenGrid, resample, resampling_study
from gtmodel.results import ArgumentError


def wave(t: np.ndarray) -> np.ndarray:
    return np.sin(t + 0.3 * t**2)


def sampled(step: float, seed: int, *, late: float = 0.0, noise: float = 0.0, name: str = "q") -> gt.Trajectory:
    rng = np.random.default_rng(seed)
    t = step * (np.arange(round(6.0 / step)) + 0.3 * rng.uniform(-1, 1, round(6.0 / step)))
    return gt.Trajectory(t, {name: wave(t - late) + noise * rng.normal(size=len(t))}, {name: "rad"})


def test_one_clock_is_what_resample_gives() -> None:
    log = sampled(0.01, 1)
    study = resampling_study(log, EvenGrid(sample_time=0.01, method="monotone"))
    by_hand = resample(log, 0.01, method="monotone")
    assert np.array_equal(study.trajectory["q"], by_hand.trajectory["q"])
    assert study.trajectory.time == pytest.approx(by_hand.trajectory.time, abs=1e-12)
    assert study.error["q"] == by_hand.error["q"].tolist() and study.stretches == 1
    assert study.trajectory.names == ("q",) and study.estimate is None


def test_a_known_delay_is_taken_off() -> None:
    both = {"a": sampled(0.01, 1), "b": sampled(0.004, 2, late=0.03, name="late")}
    study = resampling_study(both, EvenGrid(sample_time=0.01), delays={"late": 0.03})
    assert study.trajectory["late"] == pytest.approx(study.trajectory["q"], abs=1e-4)
    as_it_stands = resampling_study(both, EvenGrid(sample_time=0.01))
    assert np.abs(as_it_stands.trajectory["late"] - as_it_stands.trajectory["q"]).max() > 0.05
    assert any("'b' are not aligned" in note for note in as_it_stands.notes)


def test_a_gap_of_one_signal_parts_all_and_the_stretches_are_numbered() -> None:
    first, second = sampled(0.01, 1), sampled(0.02, 2, name="p")
    keep = (second.time < 2.0) | (second.time > 3.0)
    second = gt.Trajectory(second.time[keep], {"p": second["p"][keep]}, {"p": "rad"})
    study = resampling_study({"a": first, "b": second}, EvenGrid(sample_time=0.01, start=1.0, end=5.0))
    made = study.trajectory
    assert study.stretches == 2 and made.time[0] == 1.0 and made.time[-1] == pytest.approx(5.0)
    assert np.array_equal(np.unique(made["session"]), [0.0, 1.0])
    assert not np.any((made.time > 2.01) & (made.time < 2.98))
    assert made["p"] == pytest.approx(wave(made.time), abs=1e-3)
    assert resampling_study({"a": first, "b": second}, EvenGrid(sample_time=0.01, longest_gap=1.5)).stretches == 1


def test_an_interval_holds_the_truth_and_is_wider_where_residuals_are_coloured() -> None:
    grid, by = EvenGrid(sample_time=0.02), [AlignBy("q", "other", drift=False)]
    white = {"a": sampled(0.02, 5, noise=0.01), "b": sampled(0.02, 6, late=0.7, noise=0.01, name="other")}
    study = resampling_study(white, grid, by)
    low, high = study.interval("offset of b")
    assert low < -0.7 < high and study.offset_interval["b"] == [low, high] and not study.coloured["b"]
    assert study.trajectory["other"] == pytest.approx(study.trajectory["q"], abs=0.08)
    t = white["b"].time
    hum = white["b"].with_values({"other": white["b"]["other"] + 0.05 * np.sin(2 * np.pi * 3.1 * t)})
    coloured = resampling_study({"a": white["a"], "b": hum}, grid, by)
    first, last = coloured.interval("offset of b")
    assert first < -0.7 < last and last - first > 2 * (high - low) and coloured.coloured["b"]
    assert any("b: " in note and "coloured" in note and "Newey" in note for note in coloured.notes)


def test_it_says_what_a_coarse_grid_folds_down_and_stops_when_asked() -> None:
    assert any("aliased" in note for note in resampling_study(sampled(0.01, 1), EvenGrid(sample_time=0.1)).notes)
    assert resampling_study(sampled(0.01, 1), stop=lambda: True).status is gt.SolveStatus.INTERRUPTED


@pytest.mark.parametrize(
    ("arguments", "argument"),
    [
        (({},), "recording"),
        (({"a": sampled(0.01, 1), "b": sampled(0.01, 2)},), "recording"),
        ((gt.Trajectory([0.0], {"q": [1.0]}),), "recording"),
        ((sampled(0.01, 1), EvenGrid(start=7.0)), "grid"),
        ((sampled(0.01, 1), None, [AlignBy("q", "q")]), "align_by[0].other"),
        ((sampled(0.01, 1), None, [AlignBy("p", "q")]), "align_by[0].reference"),
    ],
)
def test_wrong_arguments(arguments: tuple, argument: str) -> None:
    with pytest.raises(ArgumentError) as error:
        resampling_study(*arguments)
    assert error.value.argument == argument
    with pytest.raises(ArgumentError, match="there is no signal 'x'"):
        resampling_study(sampled(0.01, 1), delays={"x": 1.0})
