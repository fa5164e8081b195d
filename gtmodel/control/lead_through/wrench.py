"""Wrenches in other frames and about other points, and the checks that rows of wrenches and poses pass."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError

ORTHONORMAL = 1e-6  # of R'R - I: poses come with six and more digits


def moment_about(force: ArrayLike, moment: ArrayLike, point: ArrayLike) -> np.ndarray:
    """The moment (..., 3) [N m] about `point` (3,) [m] of a wrench given about the origin: moment - point x force.

    force, moment: (..., 3) [N], [N m], all in one frame. Raises ArgumentError for other shapes.

    >>> gt.control.lead_through.moment_about([0.0, 0.0, 10.0], [0.0, -1.0, 0.0], [0.1, 0.0, 0.0])
    array([0., 0., 0.])
    """
    f, m, p = (np.asarray(x, float) for x in (force, moment, point))
    for name, x in (("force", f), ("moment", m), ("point", p)):
        if x.shape[-1:] != (3,) or (name == "point" and x.shape != (3,)):
            raise ArgumentError(f"has the shape {x.shape}; expected {'(3,)' if name == 'point' else '(..., 3)'}", name)
    return m - np.cross(p, f)


def rows_of(values: ArrayLike, name: str, count: int | None = None) -> np.ndarray:
    """Finite rows (n, 3); `count` of them where it is given."""
    rows = np.asarray(values, float)
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows) or count not in (None, len(rows)):
        raise ArgumentError(f"has the shape {rows.shape}; expected ({count or 'rows'}, 3)", name)
    if not np.all(np.isfinite(rows)):
        row = int(np.argwhere(~np.isfinite(rows))[0, 0])
        raise ArgumentError(f"is not finite in row {row}; remove the row or mend the data", name)
    return rows


def vector_of(values: ArrayLike, name: str) -> np.ndarray:
    """A finite vector (3,)."""
    vector = np.asarray(values, float)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise ArgumentError(f"expected three finite numbers; found {values!r}", name)
    return vector


def turns_of(values: ArrayLike, name: str) -> np.ndarray:
    """Rotation matrices (n, 3, 3)."""
    turns = np.asarray(values, float)
    if turns.ndim != 3 or turns.shape[1:] != (3, 3) or not len(turns):
        raise ArgumentError(f"has the shape {turns.shape}; expected (poses, 3, 3)", name)
    off = np.abs(np.swapaxes(turns, 1, 2) @ turns - np.eye(3)).max(axis=(1, 2))
    bad = ~(off <= ORTHONORMAL) | ~(np.einsum("ni,ni->n", np.cross(turns[:, 0], turns[:, 1]), turns[:, 2]) > 0)
    if bad.any():
        raise ArgumentError(f"row {int(np.argmax(bad))} is no rotation matrix: R'R = I and det R = 1 expected", name)
    return turns


def sigma_of(value: float | None, name: str) -> None:
    """Refuse a standard deviation that is not positive."""
    if value is not None and not (np.isfinite(value) and value > 0):
        raise ArgumentError(f"must be a number above 0; found {value!r}", name)


def axes(word: str) -> Sequence[str]:
    """word_x, word_y, word_z."""
    return [f"{word}_{axis}" for axis in "xyz"]
