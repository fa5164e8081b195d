"""Readings that no calibration should be built on: larger off than noise, one far off, or at the end of a range."""

from __future__ import annotations

import numpy as np

from ...inference import over_noise
from ...results import Check, Estimate, at_most

FALSE_ALARM = 1e-4  # of all residuals together
ROUNDING = 1e-9  # of the largest reading: below it residuals are no noise
SAME = 3  # equal readings at an end: noise does not repeat itself
LOOK = "look at the row where the residual is largest: contact, motion, a saturated reading, or units"


def suspect_residuals(estimate: Estimate, readings: np.ndarray, name: str) -> dict[str, Check]:
    """Residuals over the noise that was stated, or the largest over that of the others, with a bound for chance."""
    if estimate.known_noise:
        judged = over_noise(estimate)
        if not np.isfinite(judged.ratio):
            return {}
        return {f"{name}_over_noise": Check(judged.ratio, judged.bound, LOOK, judged=judged.passed)}
    from scipy import stats

    off, count = np.abs(np.asarray(estimate.residuals)).reshape(-1), estimate.degrees_of_freedom
    rest = float(np.sum(off**2) - off.max() ** 2)
    if not count > 2 or np.sqrt(np.mean(off**2)) <= ROUNDING * np.abs(readings).max():
        return {}
    # Student's without the leverage of the row: too small rather than too large
    size = float(off.max() / np.sqrt(max(rest, np.finfo(float).tiny) / (count - 1)))
    bound = float(stats.t.isf(FALSE_ALARM / (2 * len(off)), count - 1))
    return {f"{name}_largest_residual": at_most(size, bound, LOOK)}


def ends_of_range(readings: np.ndarray, name: str) -> list[str]:
    """Notes on components (rows, 3) that stop at the same number in several poses, below what else they reach."""
    notes = []
    for axis, values in zip("xyz", readings.T, strict=True):
        for end in (float(values.max()), float(values.min())):
            count = int(np.count_nonzero(values == end))
            if SAME <= count < len(values) and end != 0.0:
                notes.append(
                    f"{name} {axis} reads exactly {end:g} in {count} poses, an end of its readings: saturated?"
                )
    return notes
