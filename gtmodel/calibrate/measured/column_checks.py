"""What is wrong with measured poses before anything is solved: units, axes, columns; each in one sentence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import permutations, product
from typing import NamedTuple, TypeVar

import numpy as np

from ...geometry.rotations import nearest_rotation
from ...inference import chance_ratio
from ...measurements.orders import orders

Trial = TypeVar("Trial")

# of a signal's spread to the robot's size: beyond, its unit is another one
LEAST, GREATEST = 5e-3, 30.0
# another reading of the columns is believed when it brings the poses so many times nearer to the model's, or more where
# chance does that in few poses
NEARER = 3.0
# of the robot's size: poses nearer to the model's than this part are read right, whatever else may be nearer still
CLOSE = 0.02
AXES = "xyz"
SMALLER = {"m": "mm", "mm": "um"}
LARGER = {"um": "mm", "mm": "m", "m": "km"}


class ColumnReading(NamedTuple):
    """Another reading of the columns: what to say, and the rms distance [m] from the model's positions that is left."""

    message: str
    left: float


def unit_sentence(name: str, rows: np.ndarray, size: float, unit: str) -> str | None:
    """Of lengths (N, k) [m] of a robot of a `size` [m], whose columns were declared in `unit`; None where they fit."""
    spread = _spread(rows)
    if LEAST * size <= spread <= GREATEST * size or spread == 0:
        return None
    if len(rows) > 3 and spread > GREATEST * size:
        far = int(np.argmax(np.linalg.norm(rows - np.median(rows, axis=0), axis=1)))
        others = _spread(np.delete(rows, far, axis=0))
        if LEAST * size <= others <= GREATEST * size:
            return f"'{name}' at pose {far + 1} is {spread:.4g} m from others, which span {others:.4g} m: mend its line"
    large = spread > size
    meant = (SMALLER if large else LARGER).get(unit)
    thousand = LEAST * size <= spread * (1e-3 if large else 1e3) <= GREATEST * size
    hint = f"the column is probably in {meant}" if thousand and meant else "check its unit"
    times = f"{spread / size:.3g} times the robot's {size:.3g} m"
    return f"'{name}' spans {spread:.4g} m as declared in {unit}, {times}; {hint}"


def _spread(rows: np.ndarray) -> float:
    return float(np.max(np.ptp(rows, axis=0)))


def angle_sentence(name: str, rows: np.ndarray, unit: str) -> str | None:
    """Of angles (N, k) [rad]; None where they fit within two turns."""
    spread = float(np.max(np.ptp(rows, axis=0)))
    if spread <= 4 * np.pi:
        return None
    return (
        f"'{name}' spans {spread:.4g} rad as declared in {unit}, {spread / 2 / np.pi:.0f} turns: it looks like degrees"
    )


def scale_sentence(name: str, measured: np.ndarray, predicted: np.ndarray) -> str | None:
    """Positions (N, 3) [m] that spread otherwise than the model's: another unit, or the unit of the actuators."""
    ratio = float(np.sqrt(np.sum(np.var(measured, axis=0)) / np.sum(np.var(predicted, axis=0))))
    if 1 / 1.5 <= ratio <= 1.5:
        return None
    return (
        f"'{name}' spreads {ratio:.4g} times as far as the robot's model says for these actuators; check the units of "
        "both"
    )


def stuck_columns(names: Sequence[str], rows: np.ndarray, misfit: float, size: float) -> str | None:
    """Columns (N, k) of which some never change while others do: a dead channel, unless the robot's model says that
    they stood, with `misfit` [m] rms from what was measured (infinite: most poses are out of its reach)."""
    still = np.ptp(rows, axis=0) == 0
    if not still.any() or still.all() or misfit <= CLOSE * size:
        return None
    dead = [names[k] for k in np.flatnonzero(still).tolist()]
    missed = "most poses are out of the model's reach"
    if np.isfinite(misfit):
        missed = f"the poses miss the model's by {length(misfit)} rms"
    return (
        f"{' and '.join(dead)} is {rows[0, np.flatnonzero(still)[0]]:.4g} at all {len(rows)} poses while the others "
        f"change, and {missed}: is its channel recorded?"
    )


def much_nearer(left: float, before: float, tried: int, beyond: float) -> bool:
    """Whether what another reading leaves, rms, is so much less than `before` that chance does not explain it: the best
    of so many that were `tried`, with `beyond` degrees of freedom of what either leaves; with none nothing can be."""
    return left * max(NEARER, chance_ratio(beyond, beyond, tests=tried)) < before


def nearest(
    before: float, left: Callable[[Trial], float], trials: Iterable[Trial], beyond: float
) -> tuple[float, Trial | None]:
    """Of other readings the one that leaves least, and what it leaves; None where it leaves not much less than
    `before`, see much_nearer()."""
    best, chosen, tried = before, None, 0
    for trial in trials:
        rms = left(trial)
        tried += 1
        if rms < best * (1 - 1e-9):
            best, chosen = rms, trial
    return (best, chosen) if much_nearer(best, before, tried, beyond) else (before, None)


def signals_exchanged(
    actuators: str, position: str, before: float, left: float, beyond: float, size: float
) -> str | None:
    """Actuators that look like the position and the position like them: rms distances [m] from the model's positions
    `before`, as given, and what is `left` where one is read as the other, with `beyond` degrees of freedom. Poses out
    of reach count as missed by the robot's `size` [m]."""
    if not much_nearer(left, min(before, size), 1, beyond):
        return None
    return (
        f"'{actuators}' and '{position}' look exchanged: poses miss the model's by {length(before)} rms as given, and "
        f"by {length(left)} when each is read from the columns of the other"
    )


def exchanged(names: Sequence[str], order: Sequence[int]) -> tuple[str, str]:
    """The columns that another order changes, and the columns that are read for them."""
    changed = [k for k, j in enumerate(order) if j != k]
    return ", ".join(names[k] for k in changed), ", ".join(names[order[k]] for k in changed)


def other_columns(
    names: Sequence[str], groups: Sequence[Sequence[int]], q: np.ndarray, before: float,
    left: Callable[[np.ndarray], float], beyond: float, size: float,
) -> ColumnReading | None:  # fmt: skip
    """Columns of actuators q (N, k) that belong to each other's arms, or count the other way: single columns, groups of
    one unit and all are tried. `left(q)`: rms distance [m] of the model's positions from the measured ones, `before` as
    given, infinite out of reach, which counts as the robot's `size` [m]. `groups`: columns of one unit; `beyond`:
    degrees of freedom of the distances."""
    every = list(range(len(names)))
    said = f"poses miss the model's by {length(before)} rms as given, and by"
    missed = min(before, size)
    best, order = nearest(missed, lambda trial: left(q[:, trial]), orders(len(names), groups), beyond)
    signs = [*([k] for k in every), *map(list, groups), every]
    turned, backward = nearest(
        missed, lambda trial: left(np.where(np.isin(every, trial), -1.0, 1.0) * q), signs, beyond
    )
    if backward is not None and (order is None or turned < best):
        which = ", ".join(names[k] for k in backward)
        hint = f"{length(turned)} with the other sign; is a scale -1?"
        return ColumnReading(f"the columns {which} look reversed: {said} {hint}", turned)
    if order is None:
        return None
    which, read = exchanged(names, order)
    return ColumnReading(f"the columns {which} look exchanged: {said} {length(best)} when read as {read}", best)


def swapped_axes(
    name: str, measured: np.ndarray, predicted: np.ndarray, size: float, free_frame: bool = False
) -> ColumnReading | None:
    """Positions (N, 3) or (N, 2) whose axes are exchanged or reversed against the model's, as the cart directions show.

    With a frame that is unknown (`free_frame`) only the handedness can be found.
    """
    axes = measured.shape[1]
    if free_frame:
        proper, mirrored = (aligned(measured, predicted, hand)[2] for hand in (1, -1))
        if proper > CLOSE * size and much_nearer(mirrored, proper, 1, degrees_of_freedom(len(measured), axes, True)):
            return ColumnReading(
                f"'{name}' is left-handed: no turn brings it nearer than {length(proper)} rms to the model's, "
                f"a mirrored one {length(mirrored)}; an axis is reversed or two are exchanged",
                mirrored,
            )
        return None
    before = distance(measured, predicted)
    if before <= CLOSE * size:
        return None
    readings = product(permutations(range(axes)), product((1.0, -1.0), repeat=axes))
    best, reading = nearest(
        before, lambda r: distance(measured[:, r[0]] * r[1], predicted), readings,
        degrees_of_freedom(len(measured), axes),
    )  # fmt: skip
    if reading is None:
        return None
    order, signs = reading
    read = ", ".join(("-" if s < 0 else "") + AXES[k] for k, s in zip(order, signs, strict=True))
    left = np.linalg.det(np.eye(axes)[list(order)]) * np.prod(signs) < 0
    return ColumnReading(
        f"the axes of '{name}' look swapped: poses miss the model's by {length(before)} rms as given, and by "
        f"{length(best)} when ({read}) is read as ({', '.join(AXES[:axes])})"
        + ("; as given they are left-handed" if left else ""),
        best,
    )


def degrees_of_freedom(poses: int, axes: int = 3, free_frame: bool = False) -> int:
    """Of the distances of so many positions, less those of a frame where one is sought."""
    return axes * poses - (axes * (axes + 1) // 2 if free_frame else 0)


def aligned(measured: np.ndarray, predicted: np.ndarray, hand: int = 1) -> tuple[np.ndarray, np.ndarray, float]:
    """t (3,), R (3, 3) with predicted = t + R measured as nearly as may be, det R = hand, and the rms distance [m]."""
    a, b = measured - measured.mean(axis=0), predicted - predicted.mean(axis=0)
    R = nearest_rotation(b.T @ a, hand)
    return predicted.mean(axis=0) - R @ measured.mean(axis=0), R, distance(a @ R.T, b)


def distance(measured: np.ndarray, predicted: np.ndarray) -> float:
    """Rms distance [m] of positions (N, 3) or (N, 2)."""
    return float(np.sqrt(np.mean(np.sum((measured - predicted) ** 2, axis=1))))


def length(metres: float) -> str:
    """For a sentence."""
    if not np.isfinite(metres):
        return "no pose at all"
    return f"{metres:.3g} m" if metres >= 1 else f"{1e3 * metres:.3g} mm"
