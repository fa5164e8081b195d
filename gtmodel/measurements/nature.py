"""What the numbers of a signal are: plain ones, a wrapped angle, or a rotation, and how such are taken between rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from ..results.trajectory import Trajectory
from ..results.trajectory_errors import Array
from .streams.form import LogError

Nature = Literal["angle", "quaternion", "direction", "matrix"]
Natures = Mapping[tuple[str, ...], Nature]
NEAR = 0.03  # of length 1: what rows of a quaternion may be off
MOST_OFF = 0.1  # of the rows of a quaternion may be further off, for they are damaged
ON_SPHERE = 1e-6  # a direction of unit length or a rotation matrix: closer than a plain vector comes by chance
MOST_TURN = 90.0  # deg from row to row: the other way round, 270 deg, is three times as far
TURN = 2 * np.pi  # rad; trajectories are in SI
TURNS = 1e-6  # of a turn: written digits of the ends of a wrapped angle


def nature_of(rows: Array, unit: str) -> Nature | None:
    """What rows (n,) or (n, k) in this SI unit are; None for plain numbers, and for what never changes.

    A wrapped angle stays within one turn and jumps by more than half of one. Four columns without unit, of length 1, or
    nine that are a rotation matrix, are an orientation; two or three of length 1 to round-off a direction.

    >>> from gtmodel.measurements.nature import nature_of
    >>> nature_of(np.array([2.9, 3.1, -3.0, -2.8]), "rad"), nature_of(np.array([2.9, 3.1, 3.3, 3.5]), "rad")
    ('angle', None)
    """
    if unit == "rad":
        flat = rows.reshape(len(rows), -1)
        wrapped = (np.ptp(flat, axis=0) <= (1 + TURNS) * TURN) & (_largest(flat) > 0.5 * TURN)
        return "angle" if np.any(wrapped) else None
    if unit not in ("1", "") or rows.ndim != 2 or rows.shape[1] < 2 or not np.any(np.ptp(rows, axis=0) > ON_SPHERE):
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

    of: what its signals are; by `natures` if left out. Raises LogError where a signal turns so far from row to row that
    which way is not clear, and where rows of a quaternion have another length than 1.

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
        shown = " ".join(names)
        rows = _stacked(values, names)
        if nature == "angle":
            rows = _unwrapped(trajectory.time, rows, shown)
        elif nature == "quaternion":
            rows = _continuous(trajectory.time, rows, shown)
        elif nature == "direction":
            _refuse_fast(trajectory.time, np.arccos(np.clip(np.sum(rows[1:] * rows[:-1], axis=1), -1, 1)), shown)
        else:
            trace = np.sum(rows[1:] * rows[:-1], axis=1)
            _refuse_fast(trajectory.time, np.arccos(np.clip(0.5 * (trace - 1), -1, 1)), shown)
        _put(values, names, rows)
    return Trajectory(
        trajectory.time, values, trajectory.units, title=trajectory.title, provenance=trajectory.provenance,
        synthetic=trajectory.synthetic,
    )  # fmt: skip


def rotations_again(values: dict[str, Array], of: Natures) -> dict[str, Array]:
    """Signals that were interpolated or filtered as smooth numbers: lengths are 1 again, and matrices rotations.

    The nearest rotation is the same in every frame of reference, for the numbers of a turned frame are these times an
    orthogonal matrix.
    """
    values = dict(values)
    for names, nature in of.items():
        if nature == "angle":
            continue
        rows = _stacked(values, names)
        if nature == "matrix":
            U, _, Vt = np.linalg.svd(rows.reshape(-1, 3, 3))
            rows = (U @ Vt).reshape(-1, 9)
        else:
            rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
        _put(values, names, rows)
    return values


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
        raise LogError(
            f"'{shown}' is a quaternion, and {bad.size} of its {len(rows)} rows have another length than 1, the first "
            f"at {time[bad[0]]:.6g} s, the worst {length[worst]:.3g}; leave these rows out"
        )
    unit = rows / length[:, None]
    dot = np.sum(unit[1:] * unit[:-1], axis=1)
    _refuse_fast(time, 2 * np.arccos(np.clip(np.abs(dot), 0.0, 1.0)), shown)
    return unit * np.concatenate([[1.0], np.cumprod(np.where(dot < 0, -1.0, 1.0))])[:, None]


def _refuse_fast(time: Array, turned: Array, shown: str) -> None:
    """Raises LogError for a turn [rad] from row to row that could as well go the other way."""
    if len(turned) and (worst := float(np.degrees(turned.max()))) > MOST_TURN:
        k = int(np.argmax(turned))
        raise LogError(
            f"'{shown}' turns by {worst:.4g} deg from {time[k]:.6g} s to {time[k + 1]:.6g} s; expected at most "
            f"{MOST_TURN:g} deg from row to row, so that which way it turns is clear: record faster, cut the recording "
            "there, or leave out wrong rows"
        )
