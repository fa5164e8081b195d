"""Three-vectors of plain numbers, sums in the order x, y, z: another language that keeps it has the same bits."""

from __future__ import annotations

import math

Vector = tuple[float, float, float]
Turn = tuple[Vector, Vector, Vector]  # rotation matrix, its rows
ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Turn = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
UNIT_LENGTH = 1e-9  # of directions that are declared


def dot(a: Vector, b: Vector) -> float:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def length(a: Vector) -> float:
    """|a|."""
    return math.sqrt(dot(a, a))


def plus(a: Vector, by: float, b: Vector) -> Vector:
    """a + by b."""
    return (a[0] + by * b[0], a[1] + by * b[1], a[2] + by * b[2])


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def limited(a: Vector, most: float) -> Vector:
    """a, shortened to the length `most` where it is longer."""
    size = length(a)
    if size <= most:
        return a
    by = most / size
    return (by * a[0], by * a[1], by * a[2])


def forth(turn: Turn, a: Vector) -> Vector:
    """R a."""
    return (dot(turn[0], a), dot(turn[1], a), dot(turn[2], a))


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
    """Whether these are three numbers of length 1."""
    return len(a) == 3 and abs(length(a) - 1.0) <= UNIT_LENGTH


def whole(*vectors: Vector) -> bool:
    """Whether all numbers are finite."""
    return all(math.isfinite(x) for a in vectors for x in a)
