"""What the numbers of a signal are, plain ones, a wrapped angle or a rotation, and its values between the rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from .trajectory_errors import Array, TrajectoryError

if TYPE_CHECKING:
    from .trajectory import Trajectory

Kind = Literal["linear", "pchip", "previous"]
KINDS = ("linear", "pchip", "previous")
Nature = Literal["angle", "quaternion", "direction", "matrix"]
Natures = Mapping[tuple[str, ...], Nature]
NEAR = 0.03  # of length 1: what rows of a quaternion may be off
MOST_OFF = 0.1  # of the rows of a quaternion may be further off, for they are damaged
ON_SPHERE = 1e-6  # a direction of unit length or a rotation matrix: closer than a plain vector comes by chance
MOST_TURN = 90.0  # deg from row to row: the other way round, 270 deg, is three times as far
MOST_JUMPS = 0.5  # of the steps of a wrapped angle
TURN = 2 * np.pi  # rad; trajectories are in SI
FLAT = 1e-6  # rad between two rows: chord and arc differ by 1e-13 of it
TURNS = 1e-6  # of a turn: written digits of the ends of a wrapped angle


def nature_of(rows: Array, unit: str) -> Nature | None:
    """What rows (n,) or (n, k) in this SI unit are; None for plain numbers, and for what never changes.

    A wrapped angle stays within one turn and jumps by more than half of one, in at most half of its steps: one that
    turns by less than half a turn from row to row does not jump more often. Four columns without unit, of length 1, or
    nine that are a rotation matrix, are an orientation; two or three of length 1 to round-off a direction. Whole
    numbers are switches.

    >>> from gtmodel.results.interpolation import nature_of
    >>> nature_of(np.array([2.9, 3.1, -3.0, -2.8]), "rad"), nature_of(np.array([2.9, 3.1, 3.3, 3.5]), "rad")
    ('angle', None)
    """
    if unit == "rad":
        flat = rows.reshape(len(rows), -1)
        jumps = np.abs(np.diff(flat, axis=0)) > 0.5 * TURN
        often = np.count_nonzero(jumps, axis=0) > MOST_JUMPS * len(jumps)
        wrapped = (np.ptp(flat, axis=0) <= (1 + TURNS) * TURN) & np.any(jumps, axis=0) & ~often
        return "angle" if np.any(wrapped) else None
    if unit not in ("1", "") or rows.ndim != 2 or rows.shape[1] < 2 or not np.any(np.ptp(rows, axis=0) > ON_SPHERE):
        return None
    if np.array_equal(rows, np.round(rows)):
        return None
    off = np.abs(np.linalg.norm(rows, axis=1) - 1.0)
    if rows.shape[1] == 4 and np.mean(off > NEAR) < MOST_OFF:
        return "quaternion"
    if np.all(off <= ON_SPHERE):
        return "direction"
    if rows.shape[1] == 9:
        matrices = rows.reshape(-1, 3, 3)
        if np.all(np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)) <= ON_SPHERE):
            return "matrix"
    return None


def natures(trajectory: Trajectory) -> dict[tuple[str, ...], Nature]:
    """The signals that are more than plain numbers; four single ones in a row may be one quaternion."""
    known = dict[tuple[str, ...], Nature]()
    single = list[str]()
    for name in trajectory.names:
        rows, unit = trajectory[name], trajectory.unit(name)
        nature = nature_of(rows, unit)
        if nature is not None:
            known[name,] = nature
        single = [*single[-3:], name] if rows.ndim == 1 and unit in ("1", "") else []
        if len(single) == 4 and nature_of(np.column_stack([trajectory[n] for n in single]), "1") == "quaternion":
            known[tuple(single)], single = "quaternion", []
    return known


def smooth(trajectory: Trajectory, of: Natures | None = None) -> Trajectory:
    """The trajectory with angles unwrapped, and quaternions of length 1 whose sign does not jump.

    of: what its signals are; by `natures` if left out. Raises TrajectoryError where a signal turns so far from row to
    row that which way is not clear, and where rows of a quaternion have another length than 1.

    >>> t = 0.1 * np.arange(4)
    >>> log = gt.Trajectory(t, {"a": [2.9, 3.1, -3.0, -2.8]}, {"a": "rad"})
    >>> gt.measurements.smooth(log)["a"].round(3).tolist()
    [2.9, 3.1, 3.283, 3.483]
    """
    of = natures(trajectory) if of is None else of
    if not of:
        return trajectory
    values = {name: trajectory[name] for name in trajectory.names}
    for names, nature in of.items():
        _put(values, names, smooth_rows(trajectory.time, _stacked(values, names), nature, " ".join(names)))
    return trajectory.with_values(values)


def smooth_rows(time: Array, rows: Array, nature: Nature | None, shown: str) -> Array:
    """Rows (n,) or (n, k) of this nature as `smooth` gives them; `shown` names them in a TrajectoryError."""
    if nature == "angle":
        return _unwrapped(time, rows, shown)
    if nature == "quaternion":
        rows = _continuous(time, rows, shown)
    if nature is not None:
        _refuse_fast(time, _between(rows, nature) * (2.0 if nature == "quaternion" else 1.0), shown)
    return rows


def rotations_again(values: dict[str, Array], of: Natures) -> dict[str, Array]:
    """Signals that were interpolated or filtered as smooth numbers: lengths are 1 again, and matrices rotations.

    The nearest rotation is the same in every frame of reference, for the numbers of a turned frame are these times an
    orthogonal matrix.
    """
    values = dict(values)
    for names, nature in of.items():
        _put(values, names, rotation_rows(_stacked(values, names), nature))
    return values


def rotation_rows(rows: Array, nature: Nature | None) -> Array:
    """The nearest rows of this nature to rows (n,) or (n, k)."""
    if nature in (None, "angle"):
        return rows
    if nature == "matrix":
        U, _, Vt = np.linalg.svd(rows.reshape(-1, 3, 3))
        return np.asarray(U @ Vt).reshape(-1, 9)
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def said(of: Natures) -> list[str]:
    """What was recognised and is done with it, in sentences."""
    words = {
        "angle": "a wrapped angle, which is unwrapped",
        "quaternion": "a quaternion, taken as a rotation: its sign does not jump and its length is 1",
        "direction": "a direction, whose length stays 1",
        "matrix": "a rotation matrix, which stays one",
    }
    return [f"{' '.join(names)} is {words[nature]}" for names, nature in of.items()]


def _largest(rows: Array) -> Array:
    return np.max(np.abs(np.diff(rows, axis=0)), axis=0, initial=0.0)


def _stacked(values: Mapping[str, Array], names: tuple[str, ...]) -> Array:
    return values[names[0]] if len(names) == 1 else np.column_stack([values[n] for n in names])


def _put(values: dict[str, Array], names: tuple[str, ...], rows: Array) -> None:
    values.update({names[0]: rows} if len(names) == 1 else dict(zip(names, rows.T, strict=True)))


def _unwrapped(time: Array, rows: Array, shown: str) -> Array:
    """Of a vector the components that jump are unwrapped, and looked at."""
    flat = rows.reshape(len(rows), -1).copy()
    for k in np.flatnonzero(_largest(flat) > 0.5 * TURN):
        flat[:, k] = np.unwrap(flat[:, k])
        _refuse_fast(time, np.abs(np.diff(flat[:, k])), shown)
    return flat.reshape(rows.shape)


def _continuous(time: Array, rows: Array, shown: str) -> Array:
    length = np.linalg.norm(rows, axis=1)
    if (bad := np.flatnonzero(np.abs(length - 1.0) > NEAR)).size:
        worst = bad[np.argmax(np.abs(length[bad] - 1.0))]
        raise TrajectoryError(
            f"'{shown}' is a quaternion, and {bad.size} of its {len(rows)} rows have another length than 1, the first "
            f"at {time[bad[0]]:.6g} s, the worst {length[worst]:.3g}; leave these rows out"
        )
    unit = rows / length[:, None]
    dot = np.sum(unit[1:] * unit[:-1], axis=1)
    return unit * np.concatenate([[1.0], np.cumprod(np.where(dot < 0, -1.0, 1.0))])[:, None]


def _between(rows: Array, nature: Nature) -> Array:
    """(n - 1,) angles [rad] from row to row, on the sphere of unit quaternions half of what the body turns by."""
    dot = np.sum(rows[1:] * rows[:-1], axis=1)
    return np.arccos(np.clip(0.5 * (dot - 1) if nature == "matrix" else dot, -1.0, 1.0))


def _refuse_fast(time: Array, turned: Array, shown: str) -> None:
    """Raises TrajectoryError for a turn [rad] from row to row that could as well go the other way."""
    if len(turned) and (worst := float(np.degrees(turned.max()))) > MOST_TURN:
        k = int(np.argmax(turned))
        raise TrajectoryError(
            f"'{shown}' turns by {worst:.4g} deg from {time[k]:.6g} s to {time[k + 1]:.6g} s; expected at most "
            f"{MOST_TURN:g} deg from row to row, so that which way it turns is clear: record faster, cut the recording "
            "there, or leave out wrong rows"
        )


def interpolate(grid: Array, value: Array, times: Array, kind: Kind, nature: Nature | None = None) -> Array:
    """Values (..., k) at times inside the grid, of rows that `smooth_rows` gave for their nature.

    Between two rows "linear" turns a rotation about one axis at one speed (Shoemake 1985, slerp): the chord, parted in
    sin(w a) to sin((1 - w) a) for the angle a between the rows, shows that way.
    """
    if kind not in KINDS:
        raise TrajectoryError(f"kind is {kind!r}; expected 'linear', 'pchip' or 'previous'")
    if kind == "previous" or grid.size == 1:
        return value[np.searchsorted(grid, times, side="right") - 1]
    if kind == "pchip":
        from scipy.interpolate import PchipInterpolator

        between = PchipInterpolator(grid, value, axis=0)(times)
        end = times == grid[-1]  # scipy evaluates the last polynomial there, which rounds
        made = np.where(end[..., None] if value.ndim == 2 else end, value[-1], between)
    else:
        left = np.clip(np.searchsorted(grid, times, side="right") - 1, 0, grid.size - 2)
        weight = (times - grid[left]) / (grid[left + 1] - grid[left])
        if nature not in (None, "angle"):
            angle = _between(value, nature)[left]
            far, near = np.sin(weight * angle), np.sin((1.0 - weight) * angle)
            weight = np.where(angle > FLAT, far / np.where(angle > FLAT, far + near, 1.0), weight)
        weight = weight[..., None] if value.ndim == 2 else weight
        below, above = value[left], value[left + 1]
        made = np.where(weight == 1.0, above, below + weight * (above - below))
    if nature in (None, "angle"):
        return made
    return rotation_rows(made.reshape(-1, made.shape[-1]), nature).reshape(made.shape)


class CubicHermite:
    """The cubics through values (n, k) with derivatives (n, k) on an ascending grid, n at least 2; beyond its ends, the
    outermost ones. The numbers are those of scipy.interpolate.CubicHermiteSpline, which takes longer to import than a
    motion to re-simulate.
    """

    def __init__(self, grid: Array, value: Array, derivative: Array) -> None:
        h = np.diff(grid)[:, None]
        slope = np.diff(value, axis=0) / h
        bend = (derivative[:-1] + derivative[1:] - 2.0 * slope) / h
        self._grid = grid
        self._powers = value[:-1], derivative[:-1], (slope - derivative[:-1]) / h - bend, bend / h

    def __call__(self, times: Array, order: int = 0) -> Array:
        """Values (m, k) at times (m,), or their derivatives where order is 1."""
        piece = np.clip(np.searchsorted(self._grid, times, side="right") - 1, 0, len(self._grid) - 2)
        s = (times - self._grid[piece])[:, None]
        zeroth, first, second, third = (p[piece] for p in self._powers)
        if order == 1:
            return first + second * s * 2.0 + third * (s * s) * 3.0
        return zeroth + first * s + second * (s * s) + third * (s * s * s)
