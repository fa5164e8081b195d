"""Tests of residuals keep their level for few and for many rows, and find what was planted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gtmodel.inference import binomial_band, chi_squared_over_noise, held_out_ratio
from gtmodel.measurements.inspection.misread_columns import OtherReading, compared
from gtmodel.measurements.inspection.residual_tests import (
    coloured,
    drifts,
    explained_by,
    one_far_off,
)
from gtmodel.results.suspicion import Suspicion

LEVEL = 0.05  # at which false alarms are counted; six exact tests share chance 1 - 0.999 with any seed
RUNS = 400
TINY = 1e-6
FOUND = 1e-3  # an alarm among ten tests
REMEDY = "look"


def fitted(rng: np.random.Generator, T: int, channels: int, n: int, beside: np.ndarray | None = None) -> tuple:
    """Jacobian and residuals of a linear fit to white noise, and to what is beside it."""
    J = rng.normal(size=(T, channels, n))
    r = rng.normal(size=(T, channels)) + (0 if beside is None else beside)
    Q = np.linalg.qr(J.reshape(-1, n))[0]
    return J, r - (Q @ (Q.T @ r.reshape(-1))).reshape(T, channels)


def found_in(J: np.ndarray, r: np.ndarray) -> list[Suspicion]:
    T = len(r)
    return [drifts(J, r, np.arange(T), REMEDY), coloured(J, r, REMEDY), one_far_off(J, r, REMEDY)]


@pytest.mark.parametrize(("T", "channels", "n"), [(8, 3, 4), (60, 1, 2)])
def test_of_white_residuals_each_test_alarms_as_often_as_it_says(T: int, channels: int, n: int) -> None:
    rng = np.random.default_rng(11)
    alarms = np.zeros(3, int)
    for _ in range(RUNS):
        alarms += [s.p < LEVEL for s in found_in(*fitted(rng, T, channels, n))]
    low, high = binomial_band(RUNS, 1 - LEVEL, 1 - 1e-3 / 6)
    few, many = RUNS - high, RUNS - low
    assert few <= alarms[0] <= many and few <= alarms[2] <= many
    assert alarms[1] <= many  # the best of some octaves counts: no more than it says


def test_an_f_test_of_one_column_is_the_square_of_students() -> None:
    rng = np.random.default_rng(12)
    x, y = rng.normal(size=30), rng.normal(size=30)
    assert explained_by(np.ones((30, 1)), y, x[:, None]).p == pytest.approx(stats.linregress(x, y)[3], rel=1e-9)


def test_columns_in_the_span_of_the_unknowns_explain_nothing() -> None:
    rng = np.random.default_rng(13)
    J, r = fitted(rng, 20, 3, 4)
    test = explained_by(J, r, J[:, :, :2] + J[:, :, 2:])
    assert test.more == 0 and np.isnan(test.p)


def test_what_was_planted_is_found_by_its_test() -> None:
    rng = np.random.default_rng(14)
    T = 200
    line, walk = np.linspace(0, 4, T)[:, None], np.cumsum(rng.normal(size=(T, 1)), axis=0)
    far = np.where(np.arange(T) == 77, 8.0, 0.0)[:, None]
    runs = [found_in(*fitted(rng, T, 1, 2, planted)) for planted in (line, walk, far)]
    assert max(found[k].p for k, found in enumerate(runs)) < FOUND
    found = runs[-1]
    assert "row 77 " in found[2].evidence
    assert found[1].p > TINY  # one reading far off is no colour


def test_a_drift_is_told_in_the_readings_unit() -> None:
    J, time = np.ones((50, 1)), np.linspace(3.0, 8.0, 50)
    r = 1.9 * (time - 5.5) / 5.0 + 1e-3 * np.random.default_rng(15).normal(size=50)
    assert "by 1.9 N over" in drifts(J, r, time, REMEDY, unit="N").evidence


def test_a_long_series_is_averaged_and_keeps_its_colour() -> None:
    rng = np.random.default_rng(16)
    J, r = fitted(rng, 20_000, 2, 3)
    assert coloured(J, r, REMEDY).p > TINY
    slow = np.repeat(rng.normal(size=(200, 2)), 100, axis=0)
    assert coloured(J, r + 0.2 * slow, REMEDY).p < TINY


def test_nothing_is_tested_of_rounding_and_of_too_few_rows() -> None:
    rng = np.random.default_rng(18)
    J, r = fitted(rng, 20, 3, 4)
    rounding = [
        drifts(J, 1e-15 * r, np.arange(20), REMEDY, least=1e-12),
        coloured(J, 1e-15 * r, REMEDY, least=1e-12),
        one_far_off(J, 1e-15 * r, REMEDY, least=1e-12),
    ]
    few = found_in(*fitted(rng, 2, 1, 2))
    assert all(np.isnan(s.p) for s in rounding + few)


def test_sizes_that_do_not_matter_are_no_alarm_however_sure() -> None:
    def over_stated(chi_squared: float, degrees_of_freedom: float) -> float:
        return chi_squared_over_noise(chi_squared, degrees_of_freedom).suspicion("over_noise", REMEDY).p

    def held_out_worse(*numbers: float, tests: int = 1) -> float:
        return held_out_ratio(*numbers, tests=tests).suspicion("held_out", REMEDY).p

    assert over_stated(1.4**2 * 10_000, 10_000) == 1.0
    assert over_stated(15.0**2 * 60, 60) < TINY
    otherwise = [OtherReading("reading", "they look", "otherwise")]
    assert compared(1.4, otherwise, lambda _: 1.0, 10_000).p == 1.0
    assert compared(16.3, otherwise, lambda _: 1.0, 60, tests=2).p < TINY
    assert held_out_worse(1.4, 1.0, 1e4, 1e4) == 1.0
    assert held_out_worse(3.0, 1.2, 30, 30, tests=2) < 1e-5
    assert np.isnan(held_out_worse(3.0, 1.2, 0, 30))
    assert np.isnan(over_stated(3.0, 0)) and np.isnan(compared(3.0, otherwise, lambda _: 1.0, 0).p)
