"""From how far away a calibration finds its optimum: fits from random starts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gtmodel.calibrate.calibration import calibrate
from gtmodel.calibrate.problem import CalibrationProblem

SAME = 1e-3  # of the least sum of squares: redundant unknowns end elsewhere, their residuals do not


def basin(
    problem: CalibrationProblem, x: np.ndarray, sizes: Mapping[str, float], times: float, starts: int, seed: int
) -> tuple[int, float]:
    """How many of `starts` fits of length errors end at the optimum x, and the rms length error [m] of the starts.

    Each unknown starts at x plus a normal error of `times` its size, by the beginning of its name or 1e-3.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, round(1e6 * times)]))
    names = problem.unknowns.names
    size = np.array([next((s for b, s in sizes.items() if n.startswith(b)), 1e-3) for n in names])
    best = float(np.sum(problem.residuals(x) ** 2))
    reached, squares = 0, 0.0
    for _ in range(starts):
        at = x + times * size * rng.standard_normal(len(x))
        squares += float(np.mean(problem.residuals(at) ** 2)) / starts
        c = calibrate(problem, start=problem.unknowns.named(at))
        reached += bool(c.status.ok and np.sum(c.residuals**2) <= best * (1 + SAME))
    return reached, float(np.sqrt(squares))
