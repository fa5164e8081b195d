"""One calibration of a synthetic L1 with guideway errors or a drifting device, by seed; worker processes import it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from gtmodel.calibrate import Calibration, Measurements, calibrate, prepare
from gtmodel.calibrate.problem import CalibrationProblem
from gtmodel.calibrate.report.intervals import with_smooth_errors
from gtmodel.calibrate.synthetic.measurements import GuidewayError
from gtmodel.inference.covariance import automatic_lag, fixed_b
from gtmodel.results import Estimate
from tests.calibrate.synthetic import poses, true_robot

SIZES_UM = ((11.0, 28.0), (58.0, 38.0), (19.0, 47.0))  # along and across, Dressler 2012, Table 4.2
CYCLIC = 10e-6, 0.01  # m: amplitude and period
TRACKER = 10e-6  # m
DRIFT = 0.8, 50e-6  # correlation from pose to pose, and standard deviation [m]
OF_AN_ARM = 7  # unknowns


@cache
def placed(number: int, grid: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Actuators and tool centre points at random, or in the order of a grid inside the random ones."""
    if not grid:
        known = poses("three_link", 100)
        return known["q"][:number], known["T"][:number]
    T = poses("three_link", 100)["T"]
    middle, half = (T.max(axis=0) + T.min(axis=0)) / 2, 0.6 * (T.max(axis=0) - T.min(axis=0)) / 2
    lines = [np.linspace(m - h, m + h, n) for m, h, n in zip(middle, half, (7, 6, 6), strict=True)]
    at = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    q, status = true_robot("three_link").causal(known="T", targets=["q"])(at)
    reached = np.flatnonzero(status == 0)
    reached = reached[np.round(np.linspace(0, len(reached) - 1, number)).astype(int)]
    return q[reached], at[reached]


@cache
def ready(number: int, grid: bool = False) -> CalibrationProblem:
    q, T = placed(number, grid)
    return prepare(true_robot("three_link"), Measurements({"q": q, "T": T}))


def off_straight(number: int, k: int, rng: np.random.Generator, size: float = 1.0) -> Measurements:
    """Carts where the tool centre point stands although their guideways bend; the device's noise."""
    robot = true_robot("three_link")
    A, v, L = (np.array(getattr(robot, name), float) for name in "AvL")
    straight, T = placed(number)
    q = straight.copy()
    for i, (along, across) in enumerate(SIZES_UM):
        low, high = straight[:, i].min() - 0.01, straight[:, i].max() + 0.01
        curve = GuidewayError(
            v[i], low, high, 1e-6 * size * along, 1e-6 * size * across, size * CYCLIC[0], CYCLIC[1],
            np.random.SeedSequence([k, 3, i]),
        )  # fmt: skip
        for _ in range(20):  # Newton on the link's length; errors of a few um shrink by their slope of 0.01 or less
            d = T - A[i] - q[:, [i]] * v[i] - curve(q[:, i])
            length = np.linalg.norm(d, axis=1)
            q[:, i] += (length - L[i]) * length / (d @ v[i])
    return Measurements({"q": q, "T": T + TRACKER * rng.standard_normal(T.shape)})


def fit(m: Measurements, grid: bool = False) -> Calibration:
    return calibrate(ready(len(m), grid).on(m))


def with_guideway_errors(rng: np.random.Generator, k: int, number: int, size: float = 1.0) -> tuple[Estimate, Estimate]:
    """Estimates for white noise and with smooth errors."""
    c = fit(off_straight(number, k, rng, size))
    smooth = with_smooth_errors(c)
    assert c.estimate is not None and smooth is not None
    return c.estimate, smooth[0]


def with_drift(rng: np.random.Generator, k: int, number: int) -> tuple[Estimate, Estimate]:
    """Estimates for white noise and by Newey and West over poses in the order of a grid."""
    rho, size = DRIFT
    e = rng.standard_normal((number, 3))
    for j in range(1, number):
        e[j] = rho * e[j - 1] + np.sqrt(1 - rho**2) * e[j]
    q, T = placed(number, grid=True)
    c = fit(Measurements({"q": q, "T": T + size * e}), grid=True)
    assert c.estimate is not None
    J, moves = c.problem.jacobian(c.x), np.zeros((number, len(c.x)))
    for i in range(3):
        columns = np.flatnonzero(np.any(J[:, i] != 0, axis=0))
        moves[:, columns] = c.residuals[:, [i]] * np.linalg.pinv(J[:, i][:, columns]).T
    lags, covariance = automatic_lag(c.residuals), moves.T @ moves
    for j in range(1, lags + 1):
        cross = moves[j:].T @ moves[:-j]
        covariance += (1 - j / (lags + 1)) * (cross + cross.T)
    covariance *= number / (number - OF_AN_ARM) * fixed_b((lags + 1) / number) ** 2
    return c.estimate, replace(c.estimate, covariance=covariance)
