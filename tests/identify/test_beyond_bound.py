"""A parameter that the data push beyond its bound fails the run; one whose true value is the bound does not.

Synthetic rows: three parameters at or near zero, white noise, seeds stated beforehand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify.checks import beyond_bound
from gtmodel.inference import FALSE_ALARM, binomial_band

SEED, NOISE = 20261129, 0.5  # N


class Slide(gt.Model):
    """A slide on a slope, with friction."""

    m, d, f = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(5.0, unit="N")
    q, tau = gt.variable(unit="m"), gt.variable(unit="N")

    def equations(self):
        v = gt.der(self.q)
        yield self.tau == self.m * gt.der(v) + self.d * v + self.f


@pytest.fixture(scope="module")
def rows() -> gt.identify.Rows:
    time = 0.004 * np.arange(2500)
    q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    log = gt.identify.LogSimulator(Slide(), q).draw(1, gt.identify.Sensors(effort_noise=NOISE))
    return gt.identify.rows_of(gt.measurements.session_of(log), gt.identify.Regressor(Slide(), ["m", "d", "f"]))


def deviations(rows: gt.identify.Rows, truth: list[float], draw: int) -> tuple[float, bool]:
    """Standard deviations beyond the bound, and whether the check passes."""
    noise = NOISE * np.random.default_rng([SEED, draw]).standard_normal(rows.effort.shape)
    effort = rows.Y @ np.array(truth) + rows.y0 + noise
    found = beyond_bound(gt.identify.identify(replace(rows, effort=effort), test=[], confidence="white"))
    return (found.deviations, found.passed) if found is not None else (0.0, True)


def false_alarms(rows: gt.identify.Rows, draws: int) -> int:
    return sum(not deviations(rows, [2.0, 0.0, 0.0], k)[1] for k in range(draws))


def test_true_values_at_the_bound_raise_no_alarm(rows: gt.identify.Rows) -> None:
    assert false_alarms(rows, 200) <= binomial_band(200, FALSE_ALARM)[1]


@pytest.mark.proof
def test_false_alarms_are_as_rare_as_stated(rows: gt.identify.Rows) -> None:
    assert false_alarms(rows, 10_000) <= binomial_band(10_000, FALSE_ALARM)[1]


def test_values_beyond_the_bound_raise_one(rows: gt.identify.Rows) -> None:
    noise = NOISE * np.random.default_rng(SEED).standard_normal(rows.effort.shape)
    std = gt.identify.identify(replace(rows, effort=rows.Y @ [2.0, 5.0, 0.0] + noise)).unbounded.std[2]
    found = [deviations(rows, [2.0, 5.0, -8 * float(std)], k) for k in range(20)]
    # 8 +- 1 deviations, by an estimated standard deviation
    assert all(4.0 < far < 13.0 and not passed for far, passed in found)


def test_the_study_fails_names_the_parameter_and_can_be_told_to_accept() -> None:
    time = 0.004 * np.arange(2500)
    q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    log = gt.identify.LogSimulator(Slide(f=-5.0), q).draw(2, gt.identify.Sensors(effort_noise=NOISE))
    s = gt.identify.study(Slide(), log, ["m", "d", "f"])
    check = s.checks["deviations_beyond_bound"]
    assert s.status is gt.results.SolveStatus.CHECK_FAILED and not check.passed
    assert check.value > 50 and check.advice.startswith("f is held at 0, but the data say -5")
    accept = gt.identify.Fitting(accept=["deviations_beyond_bound"])
    assert "deviations_beyond_bound" not in gt.identify.study(Slide(), log, ["m", "d", "f"], fitting=accept).checks
    free = gt.identify.Fitting(nonnegative=["m", "d"])
    s = gt.identify.study(Slide(), log, ["m", "d", "f"], fitting=free)
    assert s.status.ok and s.parameters["f"] == pytest.approx(-5.0, abs=0.2)
