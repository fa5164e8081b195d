"""Orientations in the representations of files: quaternions, rotation vectors, matrices and Euler angles."""

from __future__ import annotations

import re

import numpy as np

from ..results.refusal import ArgumentError

LAST, VECTOR, MATRIX, KUKA = "quaternion x y z w", "rotation vector", "matrix", "KUKA A B C"
FIRST = "quaternion w x y z"
EULER = re.compile(r"(intrinsic|extrinsic) ([xyz]{3})$")
NAMED = {"ABC": "intrinsic zyx", KUKA: "intrinsic zyx", "RPY": "extrinsic xyz"}
WORDS = f"{FIRST}, {LAST}, {VECTOR}, {MATRIX}, {KUKA}, ABC, RPY, intrinsic zyx or extrinsic xyz (any axes)"
UNIT_LENGTH = 1e-3  # tolerance of a measured quaternion's length; printed digits stay below it
SQUARE = 1e-3  # tolerance of a matrix's orthogonality; printed digits stay below it


def in_angles(representation: str) -> bool:
    """Whether its columns are angles. Raises ArgumentError for an unknown representation."""
    axes = EULER.match(NAMED.get(representation, representation))
    if axes is not None and any(a == b for a, b in zip(axes[2], axes[2][1:], strict=False)):
        raise ArgumentError(f"turns about one axis twice in a row: '{representation}'; name three axes such as zyx")
    if axes is None and representation not in (FIRST, LAST, VECTOR, MATRIX):
        raise ArgumentError(f"expected one of {WORDS}; found '{representation}'")
    return axes is not None or representation == VECTOR


def quaternions(rows: np.ndarray, representation: str) -> np.ndarray:
    """Return quaternions (N, 4), scalar first, from rows in a representation, with angles in rad.

    "intrinsic zyx" turns about z, the new y and the newest x, in the order of the columns; "extrinsic xyz" about x, y
    and z of the frame. KUKA's A, B, C ("ABC") are intrinsic zyx; "RPY" are roll, pitch and yaw, extrinsic xyz. A matrix
    is written row by row: 9 numbers, or the 12 or 16 of a pose. Raises ArgumentError for a wrong number of columns, and
    for a matrix that is not a rotation.

    >>> from gtmodel.measurements.orientations import quaternions
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
    from scipy.spatial.transform import Rotation  # here: keys of problems need the words alone

    if representation == MATRIX:
        turn = Rotation.from_matrix(_orthogonal(rows))
    elif representation == VECTOR:
        turn = Rotation.from_rotvec(rows)
    else:
        kind, axes = NAMED.get(representation, representation).split()
        turn = Rotation.from_euler(axes.upper() if kind == "intrinsic" else axes, rows)
    return turn.as_quat(canonical=True, scalar_first=True)


def orientation_vectors(rows: np.ndarray, representation: str, unit: str) -> np.ndarray:
    """Return rotation vectors (N, 3) [rad] from rows in a representation, see `quaternions`; `unit`: SI unit of the
    rows. Raises ArgumentError, also for angles in another unit than rad, and for a quaternion whose length is not 1.

    >>> from gtmodel.measurements.orientations import orientation_vectors
    >>> orientation_vectors(np.array([[0.8, 0.0, 0.0, 0.6]]), "quaternion w x y z", "1").round(4)
    array([[0.   , 0.   , 1.287]])
    """
    rows = np.array(rows, float).reshape(len(rows), -1)  # scipy needs writable rows
    if in_angles(representation) and unit != "rad":
        raise ArgumentError(f"'{representation}' consists of angles, found the unit {unit}: set the unit to deg or rad")
    q = quaternions(rows, representation)
    if representation == VECTOR:
        return rows
    off = np.abs(np.linalg.norm(q, axis=1) - 1)
    if np.any(off > UNIT_LENGTH):
        k = int(np.argmax(off))
        raise ArgumentError(f"expected quaternions of length 1; pose {k + 1} has the length {np.linalg.norm(q[k]):.4g}")
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(q, scalar_first=True).as_rotvec()


def _orthogonal(rows: np.ndarray) -> np.ndarray:
    R = rows.reshape(len(rows), 3, 3) if rows.shape[1] == 9 else rows[:, :12].reshape(len(rows), 3, 4)[:, :, :3]
    deviation = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    invalid = np.flatnonzero((deviation > SQUARE) | (np.linalg.det(R) < 0))
    if invalid.size:
        k = int(invalid[0])
        what = "is mirrored" if deviation[k] <= SQUARE else f"deviates from orthogonality by {deviation[k]:.3g}"
        raise ArgumentError(
            f"the matrix of pose {k + 1} is not a rotation: it {what}; are its rows and columns exchanged?"
        )
    return R
