"""Delays between efforts and positions: a known fraction of a sample biases nothing, and the intervals of the other
parameters allow for an estimated delay.

Synthetic logs of tests/support/vendor_logs.py, at 8 ms, with exactly delayed efforts; seeds fixed beforehand.
"""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify.alignment import CorrectionModel
from gtmodel.inference import binomial_band
from gtmodel.measurements import Corrections, Signal, session_of
from tests.identify.vendor_problems import NAMES, ThreeAxes
from tests.support.vendor_logs import Run

STEP, LATE, SEED = 0.008, 0.012, 4300  # s, s: one and a half samples
PROCESSING = gt.identify.Processing(cutoff=8.0)


def log(seed: int, noise: float) -> tuple[gt.Trajectory, dict[str, float]]:
    """Positions and late efforts without offset, with white noise relative to the rms of each effort."""
    run = Run("ur", seed, None)
    time = np.arange(0.0, 24.0, STEP)
    tau = run.torques(time - LATE, run.mgl)
    tau += noise * np.sqrt(np.mean(tau**2, axis=0)) * np.random.default_rng(seed).standard_normal(tau.shape)
    truth = dict(zip(NAMES, [*run.J, *run.v, *run.c, run.mgl], strict=True))
    return gt.Trajectory(time, {"q": run.motion(time)[0], "tau": tau}, {"q": "rad", "tau": "N.m"}), truth


def signals(delay: float | str) -> dict[str, Signal]:
    return {"q": Signal("q", "rad"), "tau": Signal("tau", "N.m", delay=delay)}


def viscous_error(still: str) -> float:
    """Mean relative error of viscous friction at the exact delay, without noise."""
    errors = []
    for seed in range(SEED, SEED + 6):
        raw, truth = log(seed, 0.0)
        rows = gt.identify.rows_of(
            Corrections(signals(LATE), [session_of(raw)]).apply(still=still),
            gt.identify.Regressor(ThreeAxes(), NAMES), PROCESSING,
        )  # fmt: skip
        e = gt.identify.identify(rows, test=[]).estimate
        errors += [e.value(f"v_{i}") / truth[f"v_{i}"] - 1 for i in (1, 2, 3)]
    return float(np.mean(errors))


def test_a_fraction_of_a_sample_biases_friction_only_if_the_efforts_are_interpolated() -> None:
    # the sampled steps of Coulomb friction are not band limited
    assert viscous_error(still="") > 1e-3
    assert abs(viscous_error(still="tau")) < 1e-5


def coverage(count: int) -> tuple[list[int], list[int]]:
    """Hits of the 95 % intervals of all parameters, and of the delays."""
    hits, late = [], []
    for seed in range(SEED, SEED + count):
        raw, truth = log(seed, 0.02)
        s = gt.identify.study(ThreeAxes(), raw, NAMES, signals=signals("estimate"))
        assert s.status.ok, s.message
        assert s.intervals is not None
        hits.append([s.intervals[n][0] <= truth[n] <= s.intervals[n][1] for n in NAMES])
        late.append([s.intervals[f"tau.delay[{i}]"][0] <= LATE <= s.intervals[f"tau.delay[{i}]"][1] for i in range(3)])
    return np.sum(hits, axis=0).tolist(), np.sum(late, axis=0).tolist()


def test_intervals_allow_for_an_estimated_delay() -> None:
    hits, late = coverage(4)
    low, _ = binomial_band(4 * 13, 0.95)
    assert sum(hits) + sum(late) >= low


@pytest.mark.proof
def test_intervals_hold_with_an_estimated_delay() -> None:
    hits, late = coverage(100)
    low, high = binomial_band(100, 0.95, 0.999)
    assert all(low <= h <= high for h in [*hits, *late]), (hits, late)


def test_columns_are_the_derivatives_of_the_misfit() -> None:
    """Compared with the rate of the measured efforts, which a delay of all efforts adds to first order."""
    raw, truth = log(SEED, 0.0)
    regressor = gt.identify.Regressor(ThreeAxes(), NAMES)
    alignment = CorrectionModel(Corrections(signals("estimate"), [session_of(raw)]), regressor, PROCESSING, "q", "tau")
    values = np.full(3, LATE)
    columns = alignment.columns(values, np.array([truth[n] for n in NAMES]), PROCESSING).sum(axis=2)
    rate = alignment.rows(values, PROCESSING).effort_rate
    assert rate is not None
    # a single step of friction moves by no sample or by a whole one; on average they are right
    assert -np.sum(columns * rate) / np.sum(rate**2) == pytest.approx(1.0, abs=0.15)


def test_a_cut_off_that_lets_noise_of_the_position_pass_fails_the_run() -> None:
    raw, truth = log(SEED, 0.01)
    noise = 1e-4 * np.random.default_rng(1).standard_normal(raw["q"].shape)
    noisy = gt.Trajectory(raw.time, {"q": raw["q"] + noise, "tau": raw["tau"]}, raw.units)
    usual = gt.identify.study(ThreeAxes(), noisy, NAMES, signals=signals(LATE))
    assert usual.checks["cutoff_moves_a_parameter"].passed and usual.cutoff < 10.0
    assert usual.parameters["J_1"] == pytest.approx(truth["J_1"], rel=0.01)
    wide = gt.identify.Processing(cutoff=40.0)
    biased = gt.identify.study(ThreeAxes(), noisy, NAMES, signals=signals(LATE), processing=wide)
    check = biased.checks["cutoff_moves_a_parameter"]
    assert not check.passed and "set cutoff_Hz" in check.advice
    assert biased.parameters["J_1"] < 0.97 * truth["J_1"]


def test_drift_belongs_to_estimated_offsets_and_is_found() -> None:
    raw, truth = log(SEED, 0.01)
    drift = np.array([0.5, -0.4, 0.1])  # N m in a second
    tau = raw["tau"] + 2.0 + drift * (raw.time - raw.time.mean())[:, None]
    drifting = gt.Trajectory(raw.time, {"q": raw["q"], "tau": tau}, raw.units)
    how = gt.identify.Fitting(drift=True)
    with pytest.raises(gt.results.ArgumentError, match="needs estimated offsets"):
        gt.identify.study(ThreeAxes(), drifting, NAMES, signals=signals(LATE), fitting=how)
    free = signals(LATE) | {"tau": Signal("tau", "N.m", delay=LATE, offset="estimate")}
    with pytest.raises(gt.results.ArgumentError, match="leave out held_out"):
        gt.identify.study(ThreeAxes(), drifting, NAMES, held_out=drifting, signals=free, fitting=how)
    s = gt.identify.study(ThreeAxes(), drifting, NAMES, signals=free, fitting=how)
    assert [s.corrections[f"tau.drift[{i}]"] for i in range(3)] == pytest.approx(drift, abs=0.02)
    low, high = s.intervals["mgl"]
    assert low < truth["mgl"] < high
