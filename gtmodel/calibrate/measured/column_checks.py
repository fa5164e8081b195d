"""What is wrong with measured poses before anything is solved: units, scales, dead channels; each in one sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...geometry.rotations import nearest_rotation
from ...results.suspicion import Suspicion

# of a signal's spread to the robot's size: beyond, its unit is another one
LEAST, GREATEST = 5e-3, 30.0
# another reading of the columns is believed when it brings the poses so many times nearer to the model's, or more where
# chance does that in few poses
NEARER = 3.0
# of the robot's size: poses nearer to the model's than this part are read right, whatever else may be nearer still
CLOSE = 0.02
SMALLER = {"m": "mm", "mm": "um"}
LARGER = {"um": "mm", "mm": "m", "m": "km"}


def other_unit(name: str, rows: np.ndarray, size: float, unit: str) -> Suspicion | None:
    """Of lengths (N, k) [m] of a robot of a `size` [m], whose columns were declared in `unit`; None where they fit."""
    spread = _spread(rows)
    if LEAST * size <= spread <= GREATEST * size or spread == 0:
        return None
    if len(rows) > 3 and spread > GREATEST * size:
        far = int(np.argmax(np.linalg.norm(rows - np.median(rows, axis=0), axis=1)))
        others = _spread(np.delete(rows, far, axis=0))
        if LEAST * size <= others <= GREATEST * size:
            away = f"'{name}' at pose {far + 1} is {spread:.4g} m from others, which span {others:.4g} m"
            return Suspicion("unit", f"{away}: mend its line")
    large = spread > size
    meant = (SMALLER if large else LARGER).get(unit)
    thousand = LEAST * size <= spread * (1e-3 if large else 1e3) <= GREATEST * size
    hint = f"the column is probably in {meant}" if thousand and meant else "check its unit"
    times = f"{spread / size:.3g} times the robot's {size:.3g} m"
    return Suspicion("unit", f"'{name}' spans {spread:.4g} m as declared in {unit}, {times}", remedy=hint)


def _spread(rows: np.ndarray) -> float:
    return float(np.max(np.ptp(rows, axis=0)))


def too_many_turns(name: str, rows: np.ndarray, unit: str) -> Suspicion | None:
    """Of angles (N, k) [rad]; None where they fit within two turns."""
    spread = float(np.max(np.ptp(rows, axis=0)))
    if spread <= 4 * np.pi:
        return None
    turns = f"{spread / 2 / np.pi:.0f} turns: it looks like degrees"
    return Suspicion("unit", f"'{name}' spans {spread:.4g} rad as declared in {unit}, {turns}")


def other_scale(name: str, measured: np.ndarray, predicted: np.ndarray) -> Suspicion | None:
    """Positions (N, 3) [m] that spread otherwise than the model's: another unit, or the unit of the actuators."""
    ratio = float(np.sqrt(np.sum(np.var(measured, axis=0)) / np.sum(np.var(predicted, axis=0))))
    if 1 / 1.5 <= ratio <= 1.5:
        return None
    evidence = f"'{name}' spreads {ratio:.4g} times as far as the robot's model says for these actuators"
    return Suspicion("scale", evidence, remedy="check the units of both")


def stuck_columns(names: Sequence[str], rows: np.ndarray, misfit: float, size: float) -> Suspicion | None:
    """Columns (N, k) of which some never change while others do: a dead channel, unless the robot's model says that
    they stood, with `misfit` [m] rms from what was measured (infinite: most poses are out of its reach)."""
    still = np.ptp(rows, axis=0) == 0
    if not still.any() or still.all() or misfit <= CLOSE * size:
        return None
    dead = [names[k] for k in np.flatnonzero(still).tolist()]
    missed = "most poses are out of the model's reach"
    if np.isfinite(misfit):
        missed = f"the poses miss the model's by {length(misfit)} rms"
    return Suspicion(
        "stuck_columns",
        f"{' and '.join(dead)} is {rows[0, np.flatnonzero(still)[0]]:.4g} at all {len(rows)} poses while the others "
        f"change, and {missed}: is its channel recorded?",
    )


def degrees_of_freedom(poses: int, axes: int = 3, free_frame: bool = False) -> int:
    """Of the distances of so many positions, less those of a frame where one is sought."""
    return axes * poses - (axes * (axes + 1) // 2 if free_frame else 0)


def aligned(measured: np.ndarray, predicted: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """t (3,), R (3, 3) with predicted = t + R measured as nearly as may be, det R = +1, and the rms distance [m]."""
    a, b = measured - measured.mean(axis=0), predicted - predicted.mean(axis=0)
    R = nearest_rotation(b.T @ a)
    return predicted.mean(axis=0) - R @ measured.mean(axis=0), R, distance(a @ R.T, b)


def distance(measured: np.ndarray, predicted: np.ndarray) -> float:
    """Rms distance [m] of positions (N, 3) or (N, 2)."""
    return float(np.sqrt(np.mean(np.sum((measured - predicted) ** 2, axis=1))))


def length(metres: float) -> str:
    """For a sentence."""
    if not np.isfinite(metres):
        return "no pose at all"
    return f"{metres:.3g} m" if metres >= 1 else f"{1e3 * metres:.3g} mm"
