"""Worst cases over a box, recommended gains, and directions between two axes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.results import ArgumentError
from tests.control.delayed.test_limit import CYCLE, LATE, arm

D = gt.control.delayed
BOX = {"m": (2.55, 3.45), "c": (49.0, 66.4), "k": (29070.0, 39330.0), "delay": (0.050, 0.054)}  # 15 %, 2 ms
SOFT = (12.0, 0.06)  # Hz and damping ratio of y, and of x below: declared, none is printed
STIFF = (17.0, 0.06, 0.25)
PRINTED = {np.deg2rad(45.0): (0.03, 0.05), np.deg2rad(60.0): (0.04, 0.06)}  # Cvitanic 2021, Fig. 38
ROW_19 = (0.01, 0.02)  # Table 14: the greatest gain predicted stable, and the next step


def loop_of(p: Mapping[str, float]) -> Any:
    return D.DelayedLoop(D.equivalent_plant(p["m"], p["c"], p["k"], CYCLE), CYCLE, p["delay"])


def test_the_worst_case_is_not_better_than_any_draw() -> None:
    worst = D.worst_case(loop_of, BOX, draws=200)
    assert worst.gain == pytest.approx(D.gain_limit(loop_of(worst.point)).gain, rel=1e-12)
    assert all(low <= worst.point[name] <= high for name, (low, high) in BOX.items())
    middle = {name: (low + high) / 2 for name, (low, high) in BOX.items()}
    assert worst.nominal == pytest.approx(D.gain_limit(loop_of(middle)).gain, rel=1e-12)
    # draws of another seed
    shares = np.random.default_rng(77).random((300, 4))
    low, high = np.array(list(BOX.values())).T
    limits = [D.gain_limit(loop_of(dict(zip(BOX, v, strict=True)))).gain for v in low + shares * (high - low)]
    assert worst.gain <= min(limits) and worst.gain <= worst.limits.min() and len(worst.limits) == 200
    assert worst.gain < 0.95 * worst.nominal


def test_a_worst_point_inside_the_box_is_reached_by_the_search() -> None:
    """The mass enters as 1 + (s - 0.3)^2, so that the least limit lies at s = 0.3, on no vertex."""

    def bent(p: Mapping[str, float]) -> Any:
        m = 3.0 * (1 + (p["s"] - 0.3) ** 2)
        return D.DelayedLoop(arm(m=m), CYCLE, LATE)

    worst = D.worst_case(bent, {"s": (0.0, 1.0)}, draws=10)
    assert worst.point["s"] == pytest.approx(0.3, abs=1e-3)
    assert worst.gain == pytest.approx(D.gain_limit(bent({"s": 0.3})).gain, rel=1e-6)


def test_a_box_that_holds_loops_without_any_stable_gain_has_the_limit_0() -> None:
    """x'' + c x' + k x = u: unstable by itself where c is below 0."""

    def swings(p: Mapping[str, float]) -> Any:
        return D.DelayedLoop(D.CorrectedPlant([[0, 1], [-5e3, -p["c"]]], [0, 5e3], [1, 0]), CYCLE, LATE)

    worst = D.worst_case(swings, {"c": (-1.0, 20.0)}, draws=40)
    assert worst.gain == 0 and worst.point["c"] <= 0 and worst.nominal > 0
    assert D.recommended_gain(worst.gain, step=0.1) == 0.0


@pytest.mark.parametrize("draws", [80, pytest.param(2000, marks=pytest.mark.proof)])
def test_a_wide_box_of_two_modes_has_its_worst_point_where_they_meet_inside(draws: int) -> None:
    """Delay and frequencies far apart: the least limit lies on no vertex, and below each of many draws."""

    def two(p: Mapping[str, float]) -> Any:
        modes = [arm(p["f1"], 0.03, 1.0), arm(p["f2"], 0.03, 2.0)]
        return D.DelayedLoop(D.side_by_side(modes, [1.0, 1.0], [1.0, 1.0]), CYCLE, p["delay"])

    box = {"f1": (5.0, 30.0), "f2": (20.0, 60.0), "delay": (0.02, 0.06)}
    worst = D.worst_case(two, box, draws=200)
    low, high = np.array(list(box.values())).T
    shares = np.random.default_rng(99).random((draws, 3))
    shares[: draws // 4, :2] = 0.0  # the softest, at any delay
    limits = [D.gain_limit(two(dict(zip(box, v, strict=True)))).gain for v in low + shares * (high - low)]
    assert worst.gain <= min(limits)
    assert 0.021 < worst.point["delay"] < 0.059


@pytest.mark.parametrize(
    ("limit", "step", "gain"),
    [(0.3, 0.1, 0.3), (0.299999, 0.1, 0.2), (0.004, 0.01, 0.0), (0.07, 0.01, 0.07), (np.inf, 0.1, np.inf)],
)
def test_a_recommended_gain_is_the_step_below(limit: float, step: float, gain: float) -> None:
    assert D.recommended_gain(limit, step) == gain


FINE = 200_000  # frequencies of a grid, by which a phase margin is known to about 1e-3 rad
ABOUT = 2e-3  # rad


def margins_of(loop: Any, gain: float) -> tuple[float, float]:
    """Gain margin by eigenvalues and phase margin on a fine grid: least distance from -1 in angle where P |L| >= 1."""
    w = np.pi / CYCLE * np.arange(1, FINE + 1) / FINE
    response = gain * loop.response(w)
    large = np.abs(response) >= 1
    return D.gain_limit(loop).gain / gain, float(np.min(np.abs(np.angle(-response[large])), initial=np.pi))


@pytest.mark.parametrize("seed", range(6))
def test_the_greatest_gain_with_margins_is_where_one_of_them_is_reached(seed: int) -> None:
    rng = np.random.default_rng(seed)
    modes = [arm(*v) for v in rng.uniform([4.0, 0.003, 0.5], [60.0, 0.3, 3.0], (2, 3))]
    loop = D.DelayedLoop(D.side_by_side(modes, [1.0, 1.0], [1.0, 1.0]), CYCLE, rng.uniform(0.0, 0.06))
    asked = D.GainMargins(gain=rng.uniform(1.0, 2.0), phase=rng.uniform(0.1, 1.2))
    limit = D.margin_limit(loop, asked)
    gain, phase = margins_of(loop, limit)
    assert gain >= asked.gain * (1 - 1e-9) and phase >= asked.phase - ABOUT
    gain, phase = margins_of(loop, 1.01 * limit)
    assert gain < asked.gain or phase < asked.phase + ABOUT


def test_a_recommended_gain_keeps_its_margins_at_points_of_the_box_that_were_not_looked_at() -> None:
    """The worst corner of pose 19 along y was unstable at the gain of 0.01 that was recommended: radius 1.0043."""
    y, asked = D.FeedbackAxis(12.0, 0.06, limit=0.016, gain=0.01, gain_step=0.0005), D.GainMargins()
    timing, box = D.FeedbackTiming(), D.FeedbackBox(draws=20)
    study = gt.control.delayed_feedback({"y": y}, timing, box=box, path=None)
    gain = study.recommended["y"]
    assert 0 < gain <= study.margin_limit["y"] <= study.worst_limit["y"] / asked.gain < 0.01
    assert any("unstable in part of the box" in note and "0.01" in note for note in study.notes)
    m, w = y.equivalent_mass(timing), 2 * np.pi * 12.0
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 4)).reshape(4, -1).T
    inside = np.random.default_rng(11).uniform(-1, 1, (8, 4))
    for mass, damping, stiffness, late in np.vstack([corners, inside]) * [0.15, 0.15, 0.15, 0.002]:
        plant = D.equivalent_plant(m * (1 + mass), 0.12 * w * m * (1 + damping), w**2 * m * (1 + stiffness), CYCLE)
        factor, phase = margins_of(D.DelayedLoop(plant, CYCLE, LATE + late), gain)
        assert factor >= asked.gain and phase >= asked.phase


def test_along_the_axes_the_limits_are_those_of_the_axes_and_they_turn_with_them() -> None:
    x, y = arm(17.0, 0.06, 3.0), arm(12.0, 0.06, 0.2)
    alone = [D.gain_limit(D.DelayedLoop(p, CYCLE, LATE)).gain for p in (y, x)]
    np.testing.assert_allclose(D.off_axis_limits(x, y, [0.0, np.pi / 2], CYCLE, LATE), alone, rtol=1e-9)
    angles = np.deg2rad([20.0, 50.0])
    np.testing.assert_allclose(
        D.off_axis_limits(x, y, angles, CYCLE, LATE),
        D.off_axis_limits(y, x, np.pi / 2 - angles, CYCLE, LATE),
        rtol=1e-9,
    )
    # equal plants: every direction is alike
    np.testing.assert_allclose(D.off_axis_limits(x, x, angles, CYCLE, LATE), alone[1], rtol=1e-9)


def test_a_plant_of_a_limit_has_it() -> None:
    for frequency, zeta, limit in ((17.0, 0.06, 0.25), (8.0, 0.01, 0.003), (30.0, 0.3, 1.0)):
        plant = D.plant_of_limit(frequency, zeta, limit, CYCLE, 0.0533)
        poles = np.linalg.eigvals(plant.A)
        np.testing.assert_allclose(np.abs(poles), 2 * np.pi * frequency)
        np.testing.assert_allclose(-poles.real / np.abs(poles), zeta, rtol=1e-9)
        assert D.gain_limit(D.DelayedLoop(plant, CYCLE, 0.0533)).gain == pytest.approx(limit, rel=1e-9)


@pytest.mark.parametrize(
    ("frequency", "limit"),
    [
        (17.0, 0.2),
        pytest.param(17.0, 0.25, marks=pytest.mark.proof),
        pytest.param(17.0, 0.299, marks=pytest.mark.proof),
        pytest.param(20.0, 0.25, marks=pytest.mark.proof),
        pytest.param(14.0, 0.25, marks=pytest.mark.proof),
    ],
)
def test_one_pair_of_plants_meets_both_printed_brackets_and_the_row_of_pose_19(frequency: float, limit: float) -> None:
    x = D.plant_of_limit(frequency, 0.06, limit, CYCLE, LATE)
    ((low, high),) = D.limits_that_meet(
        lambda p: D.plant_of_limit(*SOFT, p, CYCLE, LATE), PRINTED, x, CYCLE, LATE, between=(0.005, 0.1)
    )
    assert ROW_19[0] < low < high < ROW_19[1]
    for y_limit, meets in ((0.999 * low, False), (1.001 * low, True), (0.999 * high, True), (1.001 * high, False)):
        y = D.plant_of_limit(*SOFT, y_limit, CYCLE, LATE)
        limits = D.off_axis_limits(x, y, list(PRINTED), CYCLE, LATE)
        assert all(b[0] < g < b[1] for g, b in zip(limits, PRINTED.values(), strict=True)) is meets


def test_no_limit_may_meet_the_brackets() -> None:
    x = D.plant_of_limit(*STIFF, CYCLE, LATE)
    wrong = {np.deg2rad(45.0): (0.03, 0.05), np.deg2rad(60.0): (0.01, 0.015)}
    met = D.limits_that_meet(
        lambda p: D.plant_of_limit(*SOFT, p, CYCLE, LATE), wrong, x, CYCLE, LATE, between=(0.005, 0.1)
    )
    assert met == []


@pytest.mark.parametrize(
    ("wrong", "argument"),
    [
        (lambda: D.worst_case(loop_of, {}), "box"),
        (lambda: D.worst_case(loop_of, {"m": (2.0, 1.0)}), "box"),
        (lambda: D.worst_case(loop_of, {"m": (1.0, np.inf)}), "box"),
        (lambda: D.worst_case(loop_of, {str(i): (0.0, 1.0) for i in range(13)}), "box"),
        (lambda: D.worst_case(loop_of, BOX, draws=0), "draws"),
        (lambda: D.recommended_gain(-1.0, 0.1), "limit"),
        (lambda: D.recommended_gain(np.nan, 0.1), "limit"),
        (lambda: D.recommended_gain(1.0, 0.0), "step"),
        (lambda: D.GainMargins(gain=0.9), "gain"),
        (lambda: D.GainMargins(phase=1.6), "phase"),
        (lambda: D.plant_of_limit(0.0, 0.1, 0.1, CYCLE, LATE), "frequency"),
        (lambda: D.plant_of_limit(9.0, 0.0, 0.1, CYCLE, LATE), "damping_ratio"),
        (lambda: D.plant_of_limit(9.0, 0.1, -0.1, CYCLE, LATE), "limit"),
        (lambda: D.limits_that_meet(lambda p: arm(), {}, arm(), CYCLE, LATE, between=(0.1, 0.2)), "brackets"),
        (
            lambda: D.limits_that_meet(lambda p: arm(), {0.0: (2.0, 1.0)}, arm(), CYCLE, LATE, between=(0.1, 0.2)),
            "brackets",
        ),
        (lambda: D.limits_that_meet(lambda p: arm(), PRINTED, arm(), CYCLE, LATE, between=(0.2, 0.1)), "between"),
    ],
)
def test_what_is_refused(wrong: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as fault:
        wrong()
    assert fault.value.argument == argument
