"""Wrenches in other frames and about other points, in plain numbers summed in the order x, y, z, and their status."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain

import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError
from ...results.status import NumberedStatus


class WrenchStatus(NumberedStatus):
    """Whether a force sensor's wrench may be used; OK is 0, all others give the reason why not.

    `message` is the explanation for people; `ok` is True only for OK.

    >>> gt.control.lead_through.WrenchStatus.NO_FORCE.message
    'the force does not exceed its noise or the declared least force: it has no direction'
    """

    OK = 0, "the wrench can be used"
    NO_FORCE = 1, "the force does not exceed its noise or the declared least force: it has no direction"
    ONE_DIRECTION = 2, "all forces are nearly parallel: the lever arm along them is undetermined"
    WRONG_SIGN = 3, "the sensor reports the force exerted by the tool, or its axes or gravity are reversed"
    NOT_FINITE = 4, "a number of the wrench or its age is not finite"
    SATURATED = 5, "a component of the wrench reaches the end of its range"
    STALE = 6, "the wrench is older than the law allows"
    SENSOR_FAULT = 7, "the sensor reports a fault"
    NO_ROTATION = 8, "the orientation of the tool is not a rotation matrix"
    WRONG_LOAD = 9, "at rest the sensor does not read the weight of its calibration: another load, sensor or frame"
    DOUBTFUL = 10, "the readings do not follow bias and weight: see the alarms"


Vector = tuple[float, float, float]
Turn = tuple[Vector, Vector, Vector]  # rotation matrix, its rows
ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Turn = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
UNIT_LENGTH = 1e-9  # tolerance of the length of declared directions


def dot(a: Vector, b: Vector) -> float:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def length(a: Vector) -> float:
    """|a|."""
    return math.sqrt(dot(a, a))


def plus(a: Vector, factor: float, b: Vector) -> Vector:
    """a + factor b."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def crossed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b of two arrays (3,); np.cross does the same, but takes ten times as long."""
    return np.array(cross(a.tolist(), b.tolist()))


def limited(a: Vector, most: float) -> Vector:
    """a, shortened to the length `most` if it is longer."""
    size = length(a)
    if size <= most:
        return a
    factor = most / size
    return (factor * a[0], factor * a[1], factor * a[2])


def forth(turn: Turn, a: Vector) -> Vector:
    """R a."""
    (a0, a1, a2), (x, y, z) = a, turn  # written out: twenty of them a cycle
    return (
        x[0] * a0 + x[1] * a1 + x[2] * a2,
        y[0] * a0 + y[1] * a1 + y[2] * a2,
        z[0] * a0 + z[1] * a1 + z[2] * a2,
    )


def back(turn: Turn, a: Vector) -> Vector:
    """R' a."""
    return (
        turn[0][0] * a[0] + turn[1][0] * a[1] + turn[2][0] * a[2],
        turn[0][1] * a[0] + turn[1][1] * a[1] + turn[2][1] * a[2],
        turn[0][2] * a[0] + turn[1][2] * a[1] + turn[2][2] * a[2],
    )


def is_turn(turn: Turn, within: float) -> bool:
    """Whether these are the rows of a rotation matrix: R R' = I within a tolerance, det R > 0."""
    x, y, z = turn
    for row in (x, y, z):
        if not abs(dot(row, row) - 1.0) <= within:
            return False
    if not (abs(dot(x, y)) <= within and abs(dot(y, z)) <= within and abs(dot(z, x)) <= within):
        return False
    return dot(cross(x, y), z) > 0.0


def is_direction(a: Vector) -> bool:
    """Whether this is a unit vector (3,)."""
    return len(a) == 3 and abs(length(a) - 1.0) <= UNIT_LENGTH


def whole(*vectors: Vector) -> bool:
    """Whether all numbers are finite."""
    return all(map(math.isfinite, chain.from_iterable(vectors)))


ORTHONORMAL = 1e-6  # tolerance of R'R - I: poses have six or more digits


def moment_about(force: ArrayLike, moment: ArrayLike, point: ArrayLike) -> np.ndarray:
    """Return the moment (..., 3) [N m] about `point` (3,) [m] of a wrench about the origin: moment - point x force.

    force, moment: (..., 3) [N], [N m], in the same frame. Raises ArgumentError if shapes do not fit.

    >>> gt.control.lead_through.moment_about([0.0, 0.0, 10.0], [0.0, -1.0, 0.0], [0.1, 0.0, 0.0])
    array([0., 0., 0.])
    """
    f, m, p = (np.asarray(x, float) for x in (force, moment, point))
    for name, x in (("force", f), ("moment", m), ("point", p)):
        if x.shape[-1:] != (3,) or (name == "point" and x.shape != (3,)):
            raise ArgumentError(f"has the shape {x.shape}; expected {'(3,)' if name == 'point' else '(..., 3)'}", name)
    return m - np.cross(p, f)


def rows_of(values: ArrayLike, name: str, count: int | None = None) -> np.ndarray:
    """Return finite rows (n, 3), or raise ArgumentError; n must be `count` if it is set."""
    rows = np.asarray(values, float)
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows) or count not in (None, len(rows)):
        raise ArgumentError(f"has the shape {rows.shape}; expected ({count or 'rows'}, 3)", name)
    if not np.all(np.isfinite(rows)):
        row = int(np.argwhere(~np.isfinite(rows))[0, 0])
        raise ArgumentError(f"is not finite in row {row}; remove the row or repair the data", name)
    return rows


def vector_of(values: ArrayLike, name: str) -> np.ndarray:
    """Return a finite vector (3,), or raise ArgumentError."""
    vector = np.asarray(values, float)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise ArgumentError(f"expected three finite numbers; found {values!r}", name)
    return vector


def turns_of(values: ArrayLike, name: str) -> np.ndarray:
    """Return rotation matrices (n, 3, 3), or raise ArgumentError."""
    turns = np.asarray(values, float)
    if turns.ndim != 3 or turns.shape[1:] != (3, 3) or not len(turns):
        raise ArgumentError(f"has the shape {turns.shape}; expected (poses, 3, 3)", name)
    off = np.abs(np.swapaxes(turns, 1, 2) @ turns - np.eye(3)).max(axis=(1, 2))
    bad = ~(off <= ORTHONORMAL) | ~(np.einsum("ni,ni->n", np.cross(turns[:, 0], turns[:, 1]), turns[:, 2]) > 0)
    if bad.any():
        raise ArgumentError(f"row {int(np.argmax(bad))} is not a rotation matrix: R'R = I and det R = 1 expected", name)
    return turns


def sigma_of(value: float | None, name: str) -> None:
    """Raise ArgumentError if a standard deviation is not positive."""
    if value is not None and not (np.isfinite(value) and value > 0):
        raise ArgumentError(f"must be a number above 0; found {value!r}", name)


def axes(word: str) -> Sequence[str]:
    """word_x, word_y, word_z."""
    return [f"{word}_{axis}" for axis in "xyz"]
