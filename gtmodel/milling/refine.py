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
    """Where a refinement begins: angle, between low and high [rad], and speed of the spindle [1/s]."""

    angle: float
    low: float
    high: float
    speed: float


@dataclass(frozen=True)
class Refined:
    """A refined angle [rad] and speed of the spindle [1/s].

    steady_peak: largest norm of the steady deflection there [m]. converged: whether the solver did. peak: dynamic index
    there [m], NaN where it was not computed.
    """

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
    world coordinates; starts: where to begin and between which angles to stay, a result for each; speed: least and
    greatest [1/s], each start's own if left out. The norm is bounded at SAMPLES angles by one variable (epigraph), and
    that is minimised. Raises ValueError for a start outside its ends or a speed that is not positive.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> robots = gt.milling.Oscillators.with_damping_ratio([[350] * 3] * 2, [[2e6] * 3, [3e6] * 3], [[0.03] * 3] * 2)
    >>> table = gt.milling.AngleTable(np.radians([0.0, 60.0]), robots)
    >>> spectrum = gt.milling.force_spectrum(cutter, cut, 16) @ gt.milling.to_world(np.eye(3), feed=[1.0, 0.0, 0.0])
    >>> start = gt.milling.Start(angle=np.radians(30.0), low=0.0, high=np.radians(60.0), speed=25.0)
    >>> (best,) = gt.milling.refine(table.casadi_function(), spectrum, [start])
    >>> round(np.degrees(best.angle), 1), best.converged  # the stiffer end
    (np.float64(60.0), True)
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
    unit, refined = 2 * np.pi / 100, []
    for start in starts:
        low, high = speed or (start.speed, start.speed)
        x0 = [start.angle, unit * start.speed, 0.0]
        x0[2] = float(level(x0))
        ends = {"lbx": [start.low, unit * low, 0], "ubx": [start.high, unit * high, ca.inf]}
        best = np.asarray(solver(x0=x0, **ends, lbg=-ca.inf, ubg=0)["x"]).ravel()
        angle, turning = np.clip(best[0], start.low, start.high), np.clip(best[1] / unit, low, high)
        peak = 1e-3 * float(np.sqrt(float(level([angle, unit * turning, 0.0]))))
        refined.append(Refined(float(angle), float(turning), peak, bool(solver.stats()["success"])))
    return refined


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
