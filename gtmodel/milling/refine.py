"""The best angle near a grid point, by nonlinear programming on smooth oscillators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

SAMPLES = 96  # of a turn at which the norm is bounded
HARMONICS = 16  # of the spindle that carry force, the strongest first
QUIET = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-9}


@dataclass(frozen=True)
class Start:
    """angle between low and high [rad], speed [1/s]."""

    angle: float
    low: float
    high: float
    speed: float


@dataclass(frozen=True)
class Refined:
    """angle [rad], speed [1/s] and largest norm of the steady deflection there [m]; whether the solver converged; peak:
    dynamic index there [m], where it was computed."""

    angle: float
    speed: float
    steady_peak: float
    converged: bool
    peak: float = np.nan


def refine(
    field: Any, spectrum: np.ndarray, starts: Sequence[Start], speed: tuple[float, float] | None = None
) -> list[Refined]:
    """Minimise the largest norm of the periodic deflection over the angle, and over the speed where it is free.

    field: CasADi function A -> m, c, k (3 each), world axes; spectrum (h + 1, 3): force by harmonics of the spindle,
    world coordinates; starts: where to begin and between which angles to stay; speed: least and greatest [1/s], each
    start's own if left out. The norm is bounded at SAMPLES angles by one variable (epigraph), and that is minimised.
    Raises ValueError for a start outside its ends or a speed that is not positive.
    """
    for start in starts:
        low, high = speed or (start.speed, start.speed)
        if not start.low <= start.angle <= start.high or not 0 < low <= start.speed <= high:
            raise ValueError(
                f"the start at {np.rad2deg(start.angle):g} deg and {60 * start.speed:g} rpm is outside "
                f"{np.rad2deg(start.low):g} to {np.rad2deg(start.high):g} deg, {60 * low:g} to {60 * high:g} rpm"
            )
    v = ca.SX.sym("v", 3)  # angle [rad], spindle in 100 rad/s, bound on the squared norm [mm2]
    squares = 1e6 * _squared_norm(field, spectrum, v[0], 100 * v[1])
    level = ca.Function("level", [v], [ca.mmax(squares)])
    problem = {"x": v, "f": v[2], "g": squares - v[2]}
    solver = ca.nlpsol("refine", "ipopt", problem, {**QUIET, "error_on_fail": False})
    unit, found = 2 * np.pi / 100, []
    for start in starts:
        low, high = speed or (start.speed, start.speed)
        x0 = [start.angle, unit * start.speed, 0.0]
        x0[2] = float(level(x0))
        ends = {"lbx": [start.low, unit * low, 0], "ubx": [start.high, unit * high, ca.inf]}
        best = np.asarray(solver(x0=x0, **ends, lbg=-ca.inf, ubg=0)["x"]).ravel()
        angle, turning = np.clip(best[0], start.low, start.high), np.clip(best[1] / unit, low, high)
        peak = 1e-3 * float(np.sqrt(float(level([angle, unit * turning, 0.0]))))
        found.append(Refined(float(angle), float(turning), peak, bool(solver.stats()["success"])))
    return found


def _squared_norm(field: Any, spectrum: np.ndarray, A: ca.SX, w: ca.SX) -> ca.SX:
    """|x|^2 [m2] at SAMPLES angles of the turn, from the strongest harmonics."""
    m, c, k = field(A)
    strongest = np.argsort(-np.abs(spectrum[1:]).max(axis=1), kind="stable")[:HARMONICS] + 1
    theta = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    x = ca.repmat((ca.DM(np.real(spectrum[0])) / k).T, SAMPLES, 1)
    for n in np.sort(strongest):
        stiff, damped = k - m * (n * w) ** 2, c * n * w
        size = stiff**2 + damped**2
        real, imaginary = ca.DM(np.real(spectrum[n])), ca.DM(np.imag(spectrum[n]))
        X, Y = (real * stiff + imaginary * damped) / size, (imaginary * stiff - real * damped) / size
        x += 2 * (ca.DM(np.cos(n * theta)) @ X.T - ca.DM(np.sin(n * theta)) @ Y.T)
    return ca.sum2(x**2)
