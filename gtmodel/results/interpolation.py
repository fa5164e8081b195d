"""What the numbers of a signal are, plain ones, a wrapped angle or a rotation, and its values between the rows."""

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
NUMBERS = ("1", "")  # units of what may be a rotation
WRITTEN = 5e-3  # of length 1, of rows of a quaternion: three written digits leave 1e-3, noise of 1e-3 four times that
NEAR = 0.03  # of length 1 where names say x, y, z, w: two written digits leave 1e-2; rows further off are damaged
MOST_OFF = 0.1  # of the rows of a quaternion may be further off, for they are damaged
ON_SPHERE = 1e-6  # a direction of unit length: one condition on a row, closer than a plain vector comes by chance
ON_ARC = 1e-5, 0.01  # five written digits leave 9e-6; a straight line of the second length leaves the sphere by more
ORTHONORMAL = 2e-3  # of M M' - 1: three written digits leave 2 sqrt(3) 5e-4
MOST_TURN = 90.0  # deg from row to row: the other way round, 270 deg, is three times as far
MOST_JUMPS = 0.5  # of the steps of a wrapped angle
LEAST_PROVEN = 0.5  # of the jumps of a wrapped angle; noise and gaps hide some
BESIDE = 3  # steps on either side of a jump that tell how the angle goes on
DIGITS = 1e-2  # rad: two written digits of both ends of a step
AS_LARGE = 0.05  # rad: by so much at most a step may differ in size from those beside; a chance of 0.05 / pi
SCATTER, MOST_SCATTER = 4.0, 0.4  # times the median deviation of the steps beside; rad at most
TURN = 2 * np.pi  # rad; trajectories are in SI
FLAT = 1e-6  # rad between two rows: chord and arc differ by 1e-13 of it


def nature_of(rows: Array, unit: str, time: Array | None = None, near: float = WRITTEN) -> Nature | None:
    """What rows (n,) or (n, k) in this SI unit are; None for plain numbers, and for what never changes.

    time: (n,) [s], for rows that are not even. near: what the length of a quaternion may be off 1.

    An angle, or a component of several, is wrapped where it stays within one turn and jumps by more than half of one,
    and goes on across its jumps as beside them, modulo one turn; it jumps in at most half of its steps, for what turns
    by less than half a turn from row to row does not jump more often. Four columns without unit, of length 1, or nine
    that are a rotation matrix, are an orientation; two or three of length 1 to five digits a direction. Whole numbers
    are switches, and rows of shares, none negative with the sum 1, are no rotation. One component alone tells nothing.

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
    """(k,) which components of angles (n, k) [rad], or whether the one of (n,), are wrapped."""
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
    """(len(to), 2 count) of ascending steps those next to each, on both sides; at the ends the last one again."""
    places = np.searchsorted(steps, to)[:, None] + np.arange(-count, count)
    return steps[np.clip(places, 0, len(steps) - 1)]


def _as_beside(turned: Array, *besides: Array) -> npt.NDArray[np.bool_]:
    """Whether steps (m,) are of the size of those beside them (m, k) [rad], where these scatter least."""
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
    """The signals that are more than plain numbers; of vectors of angles the components.

    Nine single columns in a row may be one rotation matrix. Four are one quaternion if their names, too, say so: they
    differ in one letter w, x, y, z or one digit from 0 to 3 or from 1 to 4.
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
    """Names that differ in one letter or digit only, which are all of this kind, in the order of `names`."""
    stems, like = dict[tuple[str, str], dict[str, str]](), "wxyz" if kind == "wxyz" else "0123456789"
    for name in names:
        for k, mark in enumerate(name.lower()):
            if mark in like:
                stems.setdefault((name[:k], name[k + 1 :]), {})[mark] = name
    return [tuple(marks.values()) for marks in stems.values() if set(marks) == set(kind)]


def smooth(trajectory: Trajectory, of: Natures | None = None) -> Trajectory:
    """The trajectory with angles unwrapped, and quaternions whose sign does not jump; no number changes otherwise.

    of: what its signals are; by `natures` if left out. A component selected alone is a plain number. Raises
    TrajectoryError where a signal turns so far from row to row that which way is not clear, and where rows of a
    quaternion have another length than 1.

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
    """Rows of a trajectory's signals as `smooth` gives them, each kept once it was asked for.

    Called with the trajectory and a signal: the names of the columns that it is one rotation with, or of itself; what
    they are; and their rows (n,) or (n, k).
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
    """Rows (n,) or (n, k) of this nature as `smooth` gives them; `shown` names them in a TrajectoryError."""
    if nature == "angle":
        return _unwrapped(time, rows, shown)
    if nature is None:
        return rows
    rows = _continuous(time, rows, shown) if nature == "quaternion" else rows
    apart = _between(rows[:-1], rows[1:], nature)
    _refuse_fast(time, apart * (2.0 if nature == "quaternion" else 1.0), shown)
    return rows


def rotations_again(values: dict[str, Array], of: Natures) -> dict[str, Array]:
    """Signals that were interpolated or filtered as smooth numbers: lengths are 1 again, and matrices rotations.

    The nearest rotation is the same in every frame of reference, for the numbers of a turned frame are these times an
    orthogonal matrix.
    """
    values = dict(values)
    for names, nature in of.items():
        if nature != "angle":
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
    """Of a vector the components that are wrapped."""
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
            f"'{shown}' is a quaternion, and {bad.size} of its {len(rows)} rows have another length than 1, the first "
            f"at {time[bad[0]]:.6g} s, the worst {length[worst]:.3g}; leave these rows out"
        )
    dot = np.sum(rows[1:] * rows[:-1], axis=1)
    return rows * np.concatenate([[1.0], np.cumprod(np.where(dot < 0, -1.0, 1.0))])[:, None]


def _between(below: Array, above: Array, nature: Nature) -> Array:
    """(n,) angles [rad] from rows (n, k) to others; of unit quaternions half of what the body turns by."""
    dot = np.sum(below * above, axis=-1)
    if nature == "matrix":
        dot = 0.5 * (dot - 1)
    else:
        dot = dot / (np.linalg.norm(below, axis=-1) * np.linalg.norm(above, axis=-1))
    return np.arccos(np.clip(dot, -1.0, 1.0))


def _refuse_fast(time: Array, turned: Array, shown: str) -> None:
    """Raises TrajectoryError for a turn [rad] from row to row that could as well go the other way."""
    if len(turned) and (worst := float(np.degrees(turned.max()))) > MOST_TURN:
        k = int(np.argmax(turned))
        beside = np.concatenate([turned[max(k - BESIDE, 0) : k], turned[k + 1 : k + 1 + BESIDE]])
        if len(beside) and np.all(beside <= FLAT):
            cure = "it stands before and after, as a setpoint does: hold its rows (kind='previous'), or cut there"
        else:
            cure = "which way it turns must be clear: record faster, cut the recording there, or leave out wrong rows"
        raise TrajectoryError(
            f"'{shown}' turns by {worst:.4g} deg from {time[k]:.6g} s to {time[k + 1]:.6g} s; expected at most "
            f"{MOST_TURN:g} deg from row to row; {cure}"
        )


def interpolate(grid: Array, value: Array, times: Array, kind: Kind, nature: Nature | None = None) -> Array:
    """Values (..., k) at times inside the grid, of rows that `smooth_rows` gave for their nature.

    At the times of rows these are as they are; between them lengths are 1 and matrices rotations. "linear" turns a
    rotation about one axis at one speed (Shoemake 1985, slerp): the chord, parted in sin(w a) to sin((1 - w) a) for the
    angle a between the rows, shows that way.
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
        made = np.where(end[..., None] if value.ndim == 2 else end, value[-1], between)
    else:
        weight = (times - grid[left]) / (grid[left + 1] - grid[left])
        below, above = value[left], value[left + 1]
        if nature not in (None, "angle"):
            below, above = (_as_rotations(rows, nature) for rows in (below, above))
            angle = _between(below, above, nature)
            far, near = np.sin(weight * angle), np.sin((1.0 - weight) * angle)
            weight = np.where(angle > FLAT, far / np.where(angle > FLAT, far + near, 1.0), weight)
        weight = weight[..., None] if value.ndim == 2 else weight
        made = np.where(weight == 1.0, above, below + weight * (above - below))
    if nature in (None, "angle"):
        return made
    made = _as_rotations(made, nature)
    for row in (left, left + 1):
        made = np.where((times == grid[row])[..., None], value[row], made)
    return made


def _as_rotations(rows: Array, nature: Nature) -> Array:
    return rotation_rows(rows.reshape(-1, rows.shape[-1]), nature).reshape(rows.shape)


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
