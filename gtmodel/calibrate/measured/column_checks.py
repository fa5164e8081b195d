"""Checks of measured poses before the fit: units, scales, dead channels; each message is one sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...geometry.rotations import nearest_rotation
from ...results.suspicion import Suspicion

# a signal's spread over the robot's size: beyond these limits its unit is wrong
LEAST, GREATEST = 5e-3, 30.0
# another reading of the columns is accepted if it brings the poses this many times nearer to the model's, or more if
# few poses make chance likely
NEARER = 3.0
# of the robot's size: poses nearer to the model's than this are read right, even if another reading is nearer still
CLOSE = 0.02
SMALLER = {"m": "mm", "mm": "um"}
LARGER = {"um": "mm", "mm": "m", "m": "km"}


def other_unit(name: str, rows: np.ndarray, size: float, unit: str) -> Suspicion | None:
    """Check lengths (N, k) [m] declared in `unit` against the robot's `size` [m]; None if they fit."""
    spread = _spread(rows)
    if LEAST * size <= spread <= GREATEST * size or spread == 0:
        return None
    if len(rows) > 3 and spread > GREATEST * size:
        farthest = int(np.argmax(np.linalg.norm(rows - np.median(rows, axis=0), axis=1)))
        others = _spread(np.delete(rows, farthest, axis=0))
        if LEAST * size <= others <= GREATEST * size:
            away = f"'{name}' at pose {farthest + 1} is {spread:.4g} m from the others, which span {others:.4g} m"
            return Suspicion("unit", f"{away}: correct its line")
    large = spread > size
    meant = (SMALLER if large else LARGER).get(unit)
    thousand = LEAST * size <= spread * (1e-3 if large else 1e3) <= GREATEST * size
    hint = f"the column is probably in {meant}" if thousand and meant else "check its unit"
    times = f"{spread / size:.3g} times the robot's size of {size:.3g} m"
    return Suspicion("unit", f"'{name}' spans {spread:.4g} m with the declared unit {unit}, {times}", remedy=hint)


def _spread(rows: np.ndarray) -> float:
    return float(np.max(np.ptp(rows, axis=0)))


def too_many_turns(name: str, rows: np.ndarray, unit: str) -> Suspicion | None:
    """Check angles (N, k) [rad]; None if they span no more than two turns."""
    spread = float(np.max(np.ptp(rows, axis=0)))
    if spread <= 4 * np.pi:
        return None
    turns = f"{spread / 2 / np.pi:.0f} turns: the column is probably in degrees"
    return Suspicion("unit", f"'{name}' spans {spread:.4g} rad with the declared unit {unit}, {turns}")


def other_scale(name: str, measured: np.ndarray, predicted: np.ndarray) -> Suspicion | None:
    """Check whether positions (N, 3) [m] spread as the model's do; if not, their unit or the actuators' is wrong."""
    ratio = float(np.sqrt(np.sum(np.var(measured, axis=0)) / np.sum(np.var(predicted, axis=0))))
    if 1 / 1.5 <= ratio <= 1.5:
        return None
    evidence = f"'{name}' spreads {ratio:.4g} times as far as the robot's model predicts for these actuators"
    return Suspicion("scale", evidence, remedy="check the units of both")


def stuck_columns(names: Sequence[str], rows: np.ndarray, misfit: float, size: float) -> Suspicion | None:
    """Check for columns (N, k) that never change while others do: dead channels, unless the model agrees.

    `misfit`: rms distance [m] of model and measured poses (infinite: most poses are out of its reach)."""
    constant = np.ptp(rows, axis=0) == 0
    if not constant.any() or constant.all() or misfit <= CLOSE * size:
        return None
    dead = [names[k] for k in np.flatnonzero(constant).tolist()]
    missed = "most poses are out of the model's reach"
    if np.isfinite(misfit):
        missed = f"measured and predicted poses differ by {length(misfit)} rms"
    return Suspicion(
        "stuck_columns",
        f"{' and '.join(dead)} is {rows[0, np.flatnonzero(constant)[0]]:.4g} at all {len(rows)} poses while the others "
        f"change, and {missed}: is its channel recorded?",
    )


def degrees_of_freedom(poses: int, axes: int = 3, free_frame: bool = False) -> int:
    """Degrees of freedom of the distances of this number of positions, less those of a fitted frame."""
    return axes * poses - (axes * (axes + 1) // 2 if free_frame else 0)


def aligned(measured: np.ndarray, predicted: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """t (3,) and R (3, 3) that bring t + R measured nearest to predicted, det R = +1, and the rms distance [m]."""
    a, b = measured - measured.mean(axis=0), predicted - predicted.mean(axis=0)
    R = nearest_rotation(b.T @ a)
    return predicted.mean(axis=0) - R @ measured.mean(axis=0), R, distance(a @ R.T, b)


def distance(measured: np.ndarray, predicted: np.ndarray) -> float:
    """Rms distance [m] of positions (N, 3) or (N, 2)."""
    return float(np.sqrt(np.mean(np.sum((measured - predicted) ** 2, axis=1))))


def length(metres: float) -> str:
    """Format a length for a sentence."""
    if not np.isfinite(metres):
        return "no pose at all"
    return f"{metres:.3g} m" if metres >= 1 else f"{1e3 * metres:.3g} mm"
