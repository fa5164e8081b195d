"""Link clusters: which link stands on which cart, and the plate orientation at which clusters are parallel."""

from __future__ import annotations

import numpy as np

from ..geometry.quaternions import quaternion_of
from ..geometry.rotations import nearest_rotation

Array = np.ndarray
LINKS = ("1", "2a", "2b", "3a", "3b", "3c")
ROWS = ([0], [1, 2], [3, 4, 5])  # links of each arm


def centred(rows: Array) -> Array:
    """Rows less their mean."""
    return rows - rows.mean(axis=0)


def orientation(cart: Array, plate: Array) -> tuple[Array, float]:
    """Rotation R (3, 3) from plate to world at which clusters are nearest to parallel, and the worst misfit [m].

    A Wahba fit of R B_ij to A_ij within each cluster, det R = +1; cart (6, 3) in world, plate (6, 3) in plate
    coordinates. The misfit is some millimetres on calibrated sets and hundreds where a sign or a row is wrong.
    """
    a = np.vstack([centred(np.asarray(cart, dtype=float)[rows]) for rows in ROWS])
    b = np.vstack([centred(np.asarray(plate, dtype=float)[rows]) for rows in ROWS])
    R = nearest_rotation(a.T @ b)
    return R, float(np.max(np.linalg.norm(a - b @ R.T, axis=1)))


def attitude(cart: Array, plate: Array) -> tuple[Array, float]:
    """The same rotation as a unit quaternion, scalar first, its largest entry positive."""
    R, misfit = orientation(cart, plate)
    return quaternion_of(R, positive="largest"), misfit
