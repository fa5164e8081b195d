"""Interpolation of signals between rows: plain numbers, wrapped angles and rotations, which are detected."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from .._lazy import hint
from .trajectory_checks import Array, TrajectoryError, columns

if TYPE_CHECKING:
    from .trajectory import Trajectory
else:
    Trajectory = hint("gtmodel.results.trajectory", "Trajectory")

Kind = Literal["linear", "pchip", "previous"]
KINDS = ("linear", "pchip", "previous")
Nature = Literal["angle", "quaternion", "direction", "matrix"]
Natures = Mapping[tuple[str, ...], Nature]
NUMBERS = ("1", "")  # possible units of a rotation
WRITTEN = (
    5e-3  # deviation of a quaternion's length from 1: rounding to three digits 1e-3, noise of 1e-3 four times that
)
NEAR = 0.03  # the same if names contain x, y, z, w: rounding to two digits 1e-2; rows further off are damaged
MOST_OFF = 0.1  # largest share of damaged rows of a quaternion
ON_SPHERE = 1e-6  # deviation of a direction's length from 1, closer than a plain vector comes by chance
ON_ARC = 1e-5, 0.01  # rounding to five digits: 9e-6; a straight line of the second length deviates from the sphere more
ORTHONORMAL = 2e-3  # of M M' - 1: rounding to three digits 2 sqrt(3) 5e-4
MOST_TURN = 90.0  # deg from row to row: the other way round, 270 deg, is three times as far
MOST_JUMPS = 0.5  # largest share of jumps in the steps of a wrapped angle
LEAST_PROVEN = 0.5  # smallest share of jumps that continue the steps beside them; noise and gaps hide some
BESIDE = 3  # steps on either side of a jump to compare with
DIGITS = 1e-2  # rad: rounding to two digits at both ends of a step
AS_LARGE = 0.05  # rad: largest difference of a step from the steps beside it; by chance with probability 0.05 / pi
SCATTER, MOST_SCATTER = 4.0, 0.4  # multiple of the median deviation of the steps beside it; largest value in rad
TURN = 2 * np.pi  # rad; trajectories are in SI
FLAT = 1e-6  # rad between two rows: below it, chord and arc differ by 1e-13 of it


def nature_of(rows: Array, unit: str, time: Array | None = None, near: float = WRITTEN) -> Nature | None:
    """Return the nature of rows (n,) or (n, k) in this SI unit; None for plain numbers and constant signals.

    time: (n,) [s], for uneven rows. near: largest deviation of a quaternion's length from 1.

    An angle, or one of several angles, is wrapped if it stays within one turn, jumps by more than half a turn in at
    most half of its steps, and continues across the jumps, modulo one turn, as beside them. Four columns without unit
    and of length 1, or nine that form a rotation matrix, are an orientation; two or three of length 1 to five digits
    are a direction. Integers are switches, and non-negative rows with the sum 1 are shares: neither is a rotation. A
    single component has no nature.

    >>> from gtmodel.results.interpolation import nature_of
    >>> nature_of(np.array([2.7, 2.9, 3.1, -3.0, -2.8]), "rad"), nature_of(np.array([0.0, 0.0, 5.0, 5.0]), "rad")
    ('angle', None)
    """
    if unit == "rad":
        return "angle" if wrapped(rows, time).any() else None
    if unit not in NUMBERS or rows.ndim != 2 or rows.shape[1] < 2 or not np.any(np.ptp(rows, axis=0) > ON_SPHERE):
        return None
    shares = np.all(rows >= 0) and np.all(np.abs(rows.sum(axis=1) - 1.0) <= WRITTEN)
    if shares or np.array_equal(rows, np.round(rows)):
        return None
    off = np.abs(np.linalg.norm(rows, axis=1) - 1.0)
    if rows.shape[1] == 4 and np.mean(off > near) < MOST_OFF:
        return "quaternion"
    if np.all(off <= (ON_ARC[0] if np.ptp(rows, axis=0).max() > ON_ARC[1] else ON_SPHERE)):
        return "direction"
    return "matrix" if rows.shape[1] == 9 and _orthonormal(rows) else None


def wrapped(rows: Array, time: Array | None = None) -> npt.NDArray[np.bool_]:
    """Return a mask (k,) of the wrapped components of angles (n, k) or (n,) [rad]."""
    step_time = np.ones(len(rows) - 1) if time is None else np.diff(time)
    return np.array([_wrapped(x, step_time) for x in rows.reshape(len(rows), -1).T])


def _wrapped(x: Array, step_time: Array) -> bool:
    step = np.diff(x)
    jumps = np.abs(step) > 0.5 * TURN
    if np.ptp(x) > TURN + DIGITS or not jumps.any() or np.count_nonzero(jumps) > MOST_JUMPS * len(jumps):
        return False
    across, calm = np.flatnonzero(jumps), np.flatnonzero(~jumps)
    turned = step[across] - TURN * np.sign(step[across])
    beside = _nearest(calm, across, BESIDE)
    proven = _as_beside(turned, step[beside], step[beside] / step_time[beside] * step_time[across, None])
    still = ~np.any(step[beside], axis=1)
    if still.any():  # a slow angle of few digits, or a setpoint that steps by a whole turn
        moving = calm[step[calm] != 0]
        next_ones = step[_nearest(moving, across, 1)] if moving.size else np.full((1, 1), TURN)
        proven &= ~still | np.all(np.abs(next_ones) <= DIGITS, axis=1)
    return bool(np.mean(proven) >= LEAST_PROVEN)


def _nearest(steps: npt.NDArray[np.intp], to: npt.NDArray[np.intp], count: int) -> npt.NDArray[np.intp]:
    """(len(to), 2 count): the nearest of ascending steps on both sides of each; at the ends the last one repeats."""
    places = np.searchsorted(steps, to)[:, None] + np.arange(-count, count)
    return steps[np.clip(places, 0, len(steps) - 1)]


def _as_beside(turned: Array, *besides: Array) -> npt.NDArray[np.bool_]:
    """Mask (m,) of steps similar to those beside them (m, k) [rad], in the version with the smallest scatter."""
    middle = np.array([np.median(b, axis=1) for b in besides])
    size = np.array([np.median(np.abs(b), axis=1) for b in besides])
    scatter = np.array([np.median(np.abs(b - m[:, None]), axis=1) for b, m in zip(besides, middle, strict=True)])
    least = np.argmin(scatter, axis=0), np.arange(len(turned))
    allowed = DIGITS + np.minimum(size[least], AS_LARGE) + np.minimum(SCATTER * scatter[least], MOST_SCATTER)
    return np.abs(turned - middle[least]) <= allowed


def _orthonormal(rows: Array) -> bool:
    matrices = rows.reshape(-1, 3, 3)
    return bool(np.all(np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)) <= ORTHONORMAL))


def natures(trajectory: Trajectory) -> dict[tuple[str, ...], Nature]:
    """Return the signals that are angles or rotations; of vectors of angles, the components.

    Nine consecutive scalar signals may be a rotation matrix. Four are a quaternion if their names differ in one letter
    w, x, y, z or in one digit from 0 to 3 or from 1 to 4.
    """
    known, single = dict[tuple[str, ...], Nature](), list[str]()
    for name in trajectory.names:
        rows, unit = trajectory[name], trajectory.unit(name)
        if rows.ndim == 2 and unit == "rad":
            known |= {(f"{name}[{k}]",): "angle" for k in np.flatnonzero(wrapped(rows, trajectory.time))}
        elif (nature := nature_of(rows, unit, trajectory.time)) is not None:
            known[name,] = nature
        if rows.ndim == 1 and unit in NUMBERS:
            single.append(name)
    return known | _of_columns(trajectory, single)


def _of_columns(trajectory: Trajectory, single: list[str]) -> dict[tuple[str, ...], Nature]:
    seen, first = dict[tuple[str, ...], Nature](), 0
    while first + 9 <= len(single):
        nine = tuple(single[first : first + 9])
        if _orthonormal(np.array([trajectory[n][0] for n in nine])) and (
            nature_of(np.column_stack([trajectory[n] for n in nine]), "1") == "matrix"
        ):
            seen[nine] = "matrix"
            del single[first : first + 9]
        else:
            first += 1
    for kind, near in (("wxyz", NEAR), ("0123", WRITTEN), ("1234", WRITTEN)):
        for four in _called(single, kind):
            rows = np.column_stack([trajectory[n] for n in four])
            if all(n in single for n in four) and nature_of(rows, "1", near=near) == "quaternion":
                seen[four] = "quaternion"
                single = [n for n in single if n not in four]
    return seen


def _called(names: list[str], kind: str) -> list[tuple[str, ...]]:
    """Groups of names that differ in one letter or digit and have all letters or digits of this kind."""
    stems, like = dict[tuple[str, str], dict[str, str]](), "wxyz" if kind == "wxyz" else "0123456789"
    for name in names:
        for k, mark in enumerate(name.lower()):
            if mark in like:
                stems.setdefault((name[:k], name[k + 1 :]), {})[mark] = name
    return [tuple(marks.values()) for marks in stems.values() if set(marks) == set(kind)]


def smooth(trajectory: Trajectory, of: Natures | None = None) -> Trajectory:
    """Return the trajectory with unwrapped angles, and quaternions without jumps of sign; other numbers do not change.

    of: natures of its signals; from `natures` if left out. A component selected alone is a plain number. Raises
    TrajectoryError if a signal turns so far from row to row that the direction is ambiguous, and if rows of a
    quaternion do not have the length 1.

    >>> t = 0.1 * np.arange(5)
    >>> log = gt.Trajectory(t, {"a": [2.7, 2.9, 3.1, -3.0, -2.8]}, {"a": "rad"})
    >>> gt.measurements.smooth(log)["a"].round(3).tolist()
    [2.7, 2.9, 3.1, 3.283, 3.483]
    """
    of = natures(trajectory) if of is None else of
    if not of:
        return trajectory
    values = {name: trajectory[name] for name in trajectory.names}
    for names, nature in of.items():
        _put(values, names, smooth_rows(trajectory.time, _stacked(values, names), nature, " ".join(names)))
    return trajectory.with_values(values)


class SmoothRows:
    """Rows of a trajectory's signals after `smooth`, cached.

    A call with the trajectory and a signal returns the names of the columns that form a rotation with it, or its own
    name; their nature; and their rows (n,) or (n, k).
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self._of = natures(trajectory)
        self._groups = {name: group for group in self._of for name in group}
        self._rows = dict[tuple[str, ...], Array]()

    def __call__(self, trajectory: Trajectory, signal: str) -> tuple[tuple[str, ...], Nature | None, Array]:
        group = self._groups.get(signal, (signal,))
        if group not in self._rows:
            values = {name: trajectory[name] for name in group}
            angles = [(c,) for c in columns(signal, values[signal]) if (c,) in self._of]
            for names in [group] if group in self._of else angles:
                rows = smooth_rows(trajectory.time, _stacked(values, names), self._of[names], " ".join(names))
                _put(values, names, rows)
            self._rows[group] = _stacked(values, group)
        return group, self._of.get(group), self._rows[group]


def smooth_rows(time: Array, rows: Array, nature: Nature | None, shown: str) -> Array:
    """Return rows (n,) or (n, k) of this nature after `smooth`; `shown` names them in a TrajectoryError."""
    if nature == "angle":
        return _unwrapped(time, rows, shown)
    if nature is None:
        return rows
    rows = _continuous(time, rows, shown) if nature == "quaternion" else rows
    apart = _between(rows[:-1], rows[1:], nature)
    _refuse_fast(time, apart * (2.0 if nature == "quaternion" else 1.0), shown)
    return rows


def rotations_again(values: dict[str, Array], of: Natures) -> dict[str, Array]:
    """Return interpolated or filtered signals, projected back to unit length or to rotation matrices.

    The nearest rotation does not depend on the frame of reference.
    """
    values = dict(values)
    for names, nature in of.items():
        if nature != "angle":
            _put(values, names, rotation_rows(_stacked(values, names), nature))
    return values


def rotation_rows(rows: Array, nature: Nature | None) -> Array:
    """Return the nearest rows of this nature to rows (n,) or (n, k)."""
    if nature in (None, "angle"):
        return rows
    if nature == "matrix":
        U, _, Vt = np.linalg.svd(rows.reshape(-1, 3, 3))
        return np.asarray(U @ Vt).reshape(-1, 9)
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def said(of: Natures) -> list[str]:
    """Return sentences about the detected natures and their treatment."""
    words = {
        "angle": "a wrapped angle, which is unwrapped",
        "quaternion": "a quaternion, treated as a rotation: its sign does not jump and its length is 1",
        "direction": "a direction, whose length stays 1",
        "matrix": "a rotation matrix, which stays orthonormal",
    }
    return [f"{' '.join(names)} is {words[nature]}" for names, nature in of.items()]


def _stacked(values: Mapping[str, Array], names: tuple[str, ...]) -> Array:
    name, *others = names
    if others:
        return np.column_stack([values[n] for n in names])
    if name in values:
        return values[name]
    base, k = _component(name)
    return values[base][:, k]


def _put(values: dict[str, Array], names: tuple[str, ...], rows: Array) -> None:
    for name, column in zip(names, rows.T if len(names) > 1 else [rows], strict=True):
        if name in values:
            values[name] = column
        else:
            base, k = _component(name)
            values[base] = values[base].copy()
            values[base][:, k] = column


def _component(name: str) -> tuple[str, int]:
    base, _, index = name.rpartition("[")
    return base, int(index[:-1])


def _unwrapped(time: Array, rows: Array, shown: str) -> Array:
    """Unwrap an angle, or the wrapped components of a vector."""
    flat = rows.reshape(len(rows), -1).copy()
    for k in [0] if rows.ndim == 1 else np.flatnonzero(wrapped(rows, time)):
        flat[:, k] = np.unwrap(flat[:, k])
        _refuse_fast(time, np.abs(np.diff(flat[:, k])), shown)
    return flat.reshape(rows.shape)


def _continuous(time: Array, rows: Array, shown: str) -> Array:
    length = np.linalg.norm(rows, axis=1)
    if (bad := np.flatnonzero(np.abs(length - 1.0) > NEAR)).size:
        worst = bad[np.argmax(np.abs(length[bad] - 1.0))]
        raise TrajectoryError(
            f"'{shown}' is a quaternion, but {bad.size} of its {len(rows)} rows do not have the length 1, the first "
            f"at {time[bad[0]]:.6g} s, the worst with length {length[worst]:.3g}; leave these rows out"
        )
    dot = np.sum(rows[1:] * rows[:-1], axis=1)
    return rows * np.concatenate([[1.0], np.cumprod(np.where(dot < 0, -1.0, 1.0))])[:, None]


def _between(below: Array, above: Array, nature: Nature) -> Array:
    """(n,) angles [rad] between rows (n, k); for unit quaternions half the angle of rotation of the body."""
    dot = np.sum(below * above, axis=-1)
    if nature == "matrix":
        dot = 0.5 * (dot - 1)
    else:
        dot = dot / (np.linalg.norm(below, axis=-1) * np.linalg.norm(above, axis=-1))
    return np.arccos(np.clip(dot, -1.0, 1.0))


def _refuse_fast(time: Array, turned: Array, shown: str) -> None:
    """Raises TrajectoryError for a turn [rad] from row to row whose direction is ambiguous."""
    if len(turned) and (worst := float(np.degrees(turned.max()))) > MOST_TURN:
        k = int(np.argmax(turned))
        beside = np.concatenate([turned[max(k - BESIDE, 0) : k], turned[k + 1 : k + 1 + BESIDE]])
        if len(beside) and np.all(beside <= FLAT):
            cure = "it rests before and after, like a setpoint: hold its rows (kind='previous'), or cut there"
        else:
            cure = "the direction of the turn is ambiguous: record faster, cut the recording there, or drop wrong rows"
        raise TrajectoryError(
            f"'{shown}' turns by {worst:.4g} deg from {time[k]:.6g} s to {time[k + 1]:.6g} s; expected at most "
            f"{MOST_TURN:g} deg from row to row; {cure}"
        )


def interpolate(grid: Array, value: Array, times: Array, kind: Kind, nature: Nature | None = None) -> Array:
    """Return values (..., k) at times inside the grid, from rows after `smooth_rows`.

    At the times of rows the values are exact; between them lengths are 1 and matrices rotations. "linear" rotates about
    a constant axis at constant speed (Shoemake 1985, slerp): the chord is divided in the ratio sin(w a) to
    sin((1 - w) a), where a is the angle between the rows.
    """
    if kind not in KINDS:
        raise TrajectoryError(f"kind is {kind!r}; expected 'linear', 'pchip' or 'previous'")
    if kind == "previous" or grid.size == 1:
        return value[np.searchsorted(grid, times, side="right") - 1]
    left = np.clip(np.searchsorted(grid, times, side="right") - 1, 0, grid.size - 2)
    if kind == "pchip":
        from scipy.interpolate import PchipInterpolator

        between = PchipInterpolator(grid, value, axis=0)(times)
        end = times == grid[-1]  # scipy evaluates the last polynomial there, which rounds
        result = np.where(end[..., None] if value.ndim == 2 else end, value[-1], between)
    else:
        weight = (times - grid[left]) / (grid[left + 1] - grid[left])
        below, above = value[left], value[left + 1]
        if nature not in (None, "angle"):
            below, above = (_as_rotations(rows, nature) for rows in (below, above))
            angle = _between(below, above, nature)
            far, near = np.sin(weight * angle), np.sin((1.0 - weight) * angle)
            weight = np.where(angle > FLAT, far / np.where(angle > FLAT, far + near, 1.0), weight)
        weight = weight[..., None] if value.ndim == 2 else weight
        result = np.where(weight == 1.0, above, below + weight * (above - below))
    if nature in (None, "angle"):
        return result
    result = _as_rotations(result, nature)
    for row in (left, left + 1):
        result = np.where((times == grid[row])[..., None], value[row], result)
    return result


def _as_rotations(rows: Array, nature: Nature) -> Array:
    return rotation_rows(rows.reshape(-1, rows.shape[-1]), nature).reshape(rows.shape)


class CubicHermite:
    """Piecewise cubics through values (n, k) with derivatives (n, k) on an ascending grid, n at least 2; extrapolated
    with the outermost cubics. Equal to scipy.interpolate.CubicHermiteSpline, which takes longer to import than the
    re-simulation of a motion.
    """

    def __init__(self, grid: Array, value: Array, derivative: Array) -> None:
        h = np.diff(grid)[:, None]
        slope = np.diff(value, axis=0) / h
        bend = (derivative[:-1] + derivative[1:] - 2.0 * slope) / h
        self._grid = grid
        self._powers = value[:-1], derivative[:-1], (slope - derivative[:-1]) / h - bend, bend / h

    def __call__(self, times: Array, order: int = 0) -> Array:
        """Return values (m, k) at times (m,), or derivatives if order is 1."""
        piece = np.clip(np.searchsorted(self._grid, times, side="right") - 1, 0, len(self._grid) - 2)
        s = (times - self._grid[piece])[:, None]
        zeroth, first, second, third = (p[piece] for p in self._powers)
        if order == 1:
            return first + second * s * 2.0 + third * (s * s) * 3.0
        return zeroth + first * s + second * (s * s) + third * (s * s * s)
