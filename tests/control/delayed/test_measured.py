"""m, c, k from the vibration after a command, and gain limits over poses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.control.delayed.command_step import _vibration
from gtmodel.inference import binomial_band
from gtmodel.results import ArgumentError
from tests.control.delayed.test_limit import CYCLE, LATE

D = gt.control.delayed
TRUE, SIZE, NOISE = np.array([3.0, 57.7, 34200.0]), 1e-3, 15e-6
T = 0.004 * np.arange(1, 150)
TABLE = 0.015  # relative: of limits between the points of a table of steps of 1 %, where the slope jumps by 4


def test_the_response_is_that_of_the_matrix_exponential() -> None:
    plant = D.equivalent_plant(*TRUE, CYCLE)
    y = D.command_response(*TRUE, [-0.001, 0.0, 0.0013, 0.004, 0.0095, 0.3], size=SIZE, cycle=CYCLE)
    block = np.block([[plant.A, SIZE * plant.B[:, None]], [np.zeros((1, 3))]])

    def expected(t: float) -> float:
        x = (scipy.linalg.expm(block * min(max(t, 0.0), CYCLE)) @ [0.0, 0.0, 1.0])[:2]
        return float((scipy.linalg.expm(plant.A * max(t - CYCLE, 0.0)) @ x)[0])

    np.testing.assert_allclose(y, [expected(t) for t in (-0.001, 0.0, 0.0013, 0.004, 0.0095, 0.3)], atol=1e-15)


def test_its_slopes_are_those_of_differences() -> None:
    _, slopes = _vibration(TRUE, T, SIZE, CYCLE)
    for i in range(3):
        h = 1e-5 * TRUE[i] * np.eye(3)[i]
        differences = (_vibration(TRUE + h, T, SIZE, CYCLE)[0] - _vibration(TRUE - h, T, SIZE, CYCLE)[0]) / (2 * h[i])
        assert np.max(np.abs(slopes[:, i] - differences)) < 1e-8 * np.max(np.abs(differences))


def hits(seeds: range, *, known: bool) -> np.ndarray:
    y = D.command_response(*TRUE, T, size=SIZE, cycle=CYCLE)
    count = np.zeros(3, int)
    for seed in seeds:
        measured = y + NOISE * np.random.default_rng(seed).standard_normal(len(T))  # synthetic
        fit = D.fit_command_step(T, measured, size=SIZE, cycle=CYCLE, sigma=NOISE if known else None)
        low, high = fit.intervals()
        count += (low < TRUE) & (high > TRUE)
    return count


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    low, high = binomial_band(20)
    count = hits(range(20), known=True)
    assert np.all((count >= low) & (count <= high))


@pytest.mark.proof
@pytest.mark.parametrize("known", [True, False])
def test_intervals_over_200_seeds(known: bool) -> None:
    low, high = binomial_band(200)
    count = hits(range(1000, 1200), known=known)
    assert np.all((count >= low) & (count <= high)), count


@pytest.mark.parametrize(("m", "f", "zeta"), [(0.2, 8.0, 0.03), (1.0, 30.0, 0.01), (5.0, 15.0, 0.3)])
def test_other_arms_are_fitted_from_the_same_starts(m: float, f: float, zeta: float) -> None:
    w = 2 * np.pi * f
    true = np.array([m, 2 * zeta * w * m, w**2 * m])
    fit = D.fit_command_step(T, D.command_response(*true, T, size=SIZE, cycle=CYCLE), size=SIZE, cycle=CYCLE)
    np.testing.assert_allclose(fit.values, true, rtol=1e-7)


def logged(seed: int = 3, noise: float = NOISE) -> np.ndarray:
    clean = D.command_response(*TRUE, T, size=SIZE, cycle=CYCLE)
    return clean + noise * np.random.default_rng(seed).standard_normal(len(T))  # synthetic


LATER = D.command_response(*TRUE, T - LATE, size=SIZE, cycle=CYCLE)
SECOND = D.command_response(1.0, 8.0, 2e4, T, size=SIZE, cycle=CYCLE)


WRONG: list[tuple[np.ndarray, np.ndarray, dict[str, float], str]] = [
    (T, -logged(), {}, "displacement"),  # the wrong sign: the limit would be 200 times too great
    (1e3 * T, logged(), {}, "time"),  # milliseconds
    (T, logged(), {"cycle": 3 * CYCLE}, "displacement"),
    (T, LATER, {}, "displacement"),  # the delay is left in
    (T, logged() + SIZE, {}, "displacement"),  # what the command itself moved is left in
    (T, np.clip(logged(), -3e-4, 3e-4), {}, "displacement"),  # saturated
    (T, logged() + SECOND, {}, "displacement"),  # a second mode
    (np.zeros(len(T)), logged(), {}, "time"),
]
WITHOUT_NOISE = (0, 4, 6)  # of the wrong ones, at every run


@pytest.mark.parametrize(
    ("time", "y", "options", "argument", "sigma"),
    [
        *((*wrong, NOISE) for wrong in WRONG),
        *(
            pytest.param(*wrong, None, marks=[pytest.mark.proof] * (k not in WITHOUT_NOISE))
            for k, wrong in enumerate(WRONG)
        ),
    ],
)
def test_logs_of_something_else_are_no_oscillator(
    time: np.ndarray, y: np.ndarray, options: dict[str, float], argument: str, sigma: float | None
) -> None:
    with pytest.raises(ArgumentError) as fault:
        D.fit_command_step(time, y, size=SIZE, **{"cycle": CYCLE, **options}, sigma=sigma)
    assert fault.value.argument == argument


def test_rows_that_share_times_or_lie_in_no_order_are_fitted() -> None:
    twice = np.repeat(T, 2)
    y = D.command_response(*TRUE, twice, size=SIZE, cycle=CYCLE) + NOISE * np.random.default_rng(1).standard_normal(298)
    one, other = (D.fit_command_step(twice[::k], y[::k], size=SIZE, cycle=CYCLE, sigma=NOISE) for k in (1, -1))
    np.testing.assert_allclose(one.values, other.values, rtol=1e-7)
    assert np.all(np.abs(one.values / TRUE - 1) < 0.05)


@pytest.mark.parametrize(
    "added",
    [5e-5 * T, np.full(len(T), 3e-5), D.command_response(*TRUE, T - 1e-3, size=SIZE, cycle=CYCLE) - logged(3, 0.0)],
)
def test_small_faults_of_a_log_are_in_the_notes(added: np.ndarray) -> None:
    """A drift, an offset, one millisecond of delay."""
    assert D.fit_command_step(T, logged() + added, size=SIZE, cycle=CYCLE, sigma=NOISE).notes


def test_good_logs_have_no_notes_and_noise_that_is_stated_too_small_is_one() -> None:
    good = [D.fit_command_step(T, logged(s), size=SIZE, cycle=CYCLE, sigma=NOISE) for s in range(20)]
    assert not any(g.notes for g in good)
    loud = D.fit_command_step(T, logged(), size=SIZE, cycle=CYCLE, sigma=NOISE / 3)
    assert loud.notes


def thesis_poses() -> np.ndarray:
    """Table 12 of Cvitanic 2021, joints 2 and 3 [rad]."""
    rows = [(-33.96, 113.53), (-31.26, 98.33), (-26.47, 81.25), (-19.33, 60.68), (-46.14, 115.56), (-41.59, 100.18),
            (-35.48, 83.05), (-27.42, 62.67), (-57.62, 114.56), (-51.05, 99.27), (-43.49, 82.17), (-34.31, 61.7),
            (-67.45, 110.6), (-59.08, 95.65), (-50.15, 78.59), (-39.74, 57.71)]  # fmt: skip
    return np.deg2rad(rows)


def smooth_field(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Synthetic m, c, k (n, 1) of an arm that is stiffer the more it is folded."""
    reach = np.cos(joints[:, 0]) + 0.7 * np.cos(joints.sum(axis=1))
    w = 2 * np.pi * (15.0 - 3.0 * reach)
    m = 2.0 * np.exp(0.3 * reach)
    return m[:, None], (0.1 * w * m)[:, None], (w**2 * m)[:, None]


def test_a_field_gives_the_limits_of_poses_that_were_not_measured() -> None:
    joints = thesis_poses()
    field = D.fit_gain_field(joints, *smooth_field(joints), directions=["x"])
    new = np.deg2rad([[-38.53, 107.42], [-43.22, 91.79], [-51.27, 89.57]])  # Table 13
    limits = D.limits_over(field, new, "x", cycle=CYCLE, delay=LATE, draws=200)
    for row, m, c, k in zip(limits, *(v[:, 0] for v in smooth_field(new)), strict=True):
        exact = D.gain_limit(D.DelayedLoop(D.equivalent_plant(m, c, k, CYCLE), CYCLE, LATE)).gain
        assert abs(np.median(row) / exact - 1) < 0.05
        assert np.quantile(row, 0.001) * 0.99 < exact < np.quantile(row, 0.999) * 1.01


def test_limits_of_many_draws_are_those_computed_one_by_one() -> None:
    rng = np.random.default_rng(3)
    joints = thesis_poses()
    noisy = [v * np.exp(0.15 * rng.standard_normal(v.shape)) for v in smooth_field(joints)]  # synthetic, 15 %
    field = D.fit_gain_field(joints, *noisy, directions=["x"])
    new = np.deg2rad([[-38.53, 107.42], [-43.22, 91.79]])
    limits = D.limits_over(field, new, "x", cycle=CYCLE, delay=LATE, draws=150)
    mean, std = field.at(new, "x")
    free = np.random.default_rng(0).standard_normal((3, 1, 150))
    for i, j in [(0, 0), (1, 7), (0, 60), (1, 149), (0, 100)]:
        m, c, k = np.exp(mean[:, i] + std[:, i] * free[:, 0, j])
        exact = D.gain_limit(D.DelayedLoop(D.equivalent_plant(m, c, k, CYCLE), CYCLE, LATE)).gain
        assert abs(limits[i, j] / exact - 1) < TABLE
    gains = D.recommended_over(limits, 0.01)
    assert np.all(gains <= limits.min(axis=1)) and np.all(gains > limits.min(axis=1) - 0.01)
    kept = D.limits_over(field, new, "x", cycle=CYCLE, delay=LATE, draws=50, margins=D.GainMargins())
    same = D.limits_over(field, new, "x", cycle=CYCLE, delay=LATE, draws=50)
    assert np.all(kept <= same / 2 * (1 + TABLE))


@pytest.mark.proof
def test_limits_lie_above_their_quantile_as_often_as_it_says() -> None:
    """Poses 17 to 22 of the thesis, both directions, synthetic arms of twelve seeds, 15 % from test to test. Errors of
    a seed go together: of 144, 90 % are asked for where 95 % are expected."""
    new = np.deg2rad(
        [[-38.53, 107.42], [-34.02, 91.33], [-49.4, 107.92], [-43.22, 91.79], [-59.1, 105.55], [-51.27, 89.57]]
    )
    above = []
    for seed in range(100, 112):
        options = D.SyntheticCommands(repeatability=0.15, seed=seed)
        plants, _ = D.synthetic_plants(thesis_poses(), options, ("x", "y"), CYCLE)
        field = D.fit_gain_field(plants.joints, plants.m, plants.c, plants.k, directions=("x", "y"))
        true = D.true_plants(new, options)
        for i, direction in enumerate("xy"):
            limits = D.limits_over(field, new, direction, cycle=CYCLE, delay=LATE, draws=200)
            for row, (m, c, k) in zip(limits, true[:, :, i].T, strict=True):
                loop = D.DelayedLoop(D.equivalent_plant(m, c, k, CYCLE), CYCLE, LATE)
                above.append(D.gain_limit(loop).gain > np.quantile(row, 0.05))
    assert np.mean(above) > 0.9


@pytest.mark.parametrize(
    ("wrong", "argument"),
    [
        (lambda: D.command_response(3.0, 1e6, 34200.0, T, size=SIZE, cycle=CYCLE), "m"),
        (lambda: D.command_response(*TRUE, [np.nan], size=SIZE, cycle=CYCLE), "time"),
        (lambda: D.fit_command_step(T, T[:-1], size=SIZE, cycle=CYCLE), "displacement"),
        (lambda: D.fit_command_step(T, np.full(len(T), np.nan), size=SIZE, cycle=CYCLE), "displacement"),
        (lambda: D.fit_command_step(T[:5], T[:5], size=SIZE, cycle=CYCLE), "time"),
        (lambda: D.fit_command_step(T, T, size=0.0, cycle=CYCLE), "size"),
        (lambda: D.fit_command_step(T, T, size=SIZE, cycle=-1.0), "cycle"),
        (lambda: D.fit_command_step(T, 0 * T, size=SIZE, cycle=CYCLE), "displacement"),
        (lambda: D.fit_gain_field(thesis_poses()[:, :1], *smooth_field(thesis_poses()), directions=["x"]), "joints"),
        (lambda: D.fit_gain_field(thesis_poses(), *smooth_field(thesis_poses())), "m"),
        (lambda: D.fit_gain_field(thesis_poses()[:3], *smooth_field(thesis_poses()[:3]), directions=["x"]), "joints"),
    ],
)
def test_what_is_refused(wrong: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as fault:
        wrong()
    assert fault.value.argument == argument
