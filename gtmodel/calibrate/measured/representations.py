"""Orientations as they stand in files: quaternions, Euler angles, rotation vectors, matrices; as quaternions."""

from __future__ import annotations

import re

import numpy as np
import scipy

from ...results import ArgumentError

LAST, VECTOR, MATRIX, KUKA = "quaternion x y z w", "rotation vector", "matrix", "KUKA A B C"
FIRST = "quaternion w x y z"
EULER = re.compile(r"(intrinsic|extrinsic) ([xyz]{3})$")
WORDS = f"{FIRST}, {LAST}, {VECTOR}, {MATRIX}, {KUKA}, intrinsic zyx or extrinsic xyz (any axes)"
SQUARE = 1e-3  # by which a matrix may miss being orthogonal: printed digits leave less


def in_angles(representation: str) -> bool:
    """Whether its columns are angles. Raises ArgumentError for words that name no representation."""
    axes = EULER.match(representation)
    if axes is not None and any(a == b for a, b in zip(axes[2], axes[2][1:], strict=False)):
        raise ArgumentError(f"turns about one axis twice in a row: '{representation}'; name three axes such as zyx")
    if axes is None and representation not in (FIRST, LAST, VECTOR, MATRIX, KUKA):
        raise ArgumentError(f"expected one of {WORDS}; found '{representation}'")
    return axes is not None or representation in (VECTOR, KUKA)


def quaternions(rows: np.ndarray, representation: str) -> np.ndarray:
    """Quaternions (N, 4), scalar first, of rows in a representation, angles in rad.

    "intrinsic zyx" turns about z, the new y and the newest x, in the order of the columns; "extrinsic xyz" about x, y
    and z of the frame. KUKA's A, B, C are intrinsic zyx. A matrix is written row by row: 9 numbers, or the 12 or 16 of
    a pose. Raises ArgumentError for another number of columns, and for what is no rotation.

    >>> from gtmodel.calibrate.measured.representations import quaternions
    >>> quaternions(np.array([[np.pi / 2, 0.0, 0.0]]), "KUKA A B C").round(4)
    array([[0.7071, 0.    , 0.    , 0.7071]])
    """
    angles = in_angles(representation)
    expected = (9, 12, 16) if representation == MATRIX else (3,) if angles else (4,)
    if rows.shape[1] not in expected:
        raise ArgumentError(f"'{representation}' has {' or '.join(map(str, expected))} columns; found {rows.shape[1]}")
    if representation == FIRST:
        return rows
    if representation == LAST:
        return np.roll(rows, 1, axis=1)
    Rotation = scipy.spatial.transform.Rotation
    if representation == MATRIX:
        turn = Rotation.from_matrix(_orthogonal(rows))
    elif representation == VECTOR:
        turn = Rotation.from_rotvec(rows)
    else:
        kind, axes = ("intrinsic", "zyx") if representation == KUKA else representation.split()
        turn = Rotation.from_euler(axes.upper() if kind == "intrinsic" else axes, rows)
    return turn.as_quat(canonical=True, scalar_first=True)


def positions(rows: np.ndarray) -> np.ndarray:
    """The last column (N, 3) of matrices of a pose, 12 or 16 numbers row by row."""
    if rows.shape[1] not in (12, 16):
        raise ArgumentError(f"the matrix of a pose has 12 or 16 columns; found {rows.shape[1]}")
    return rows[:, 3:12:4]


def _orthogonal(rows: np.ndarray) -> np.ndarray:
    R = rows.reshape(len(rows), 3, 3) if rows.shape[1] == 9 else rows[:, :12].reshape(len(rows), 3, 4)[:, :, :3]
    left = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = np.flatnonzero((left > SQUARE) | (np.linalg.det(R) < 0))
    if wrong.size:
        k = int(wrong[0])
        what = "is mirrored" if left[k] <= SQUARE else f"misses being orthogonal by {left[k]:.3g}"
        raise ArgumentError(
            f"the matrix of pose {k + 1} is no rotation: it {what}; are its rows and columns exchanged?"
        )
    return R
