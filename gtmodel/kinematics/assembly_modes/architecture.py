"""Architecturally singular platforms: the six legs are linearly dependent in every pose.

Such a platform has no finite number of assembly modes: with the lengths of a pose it can move from that pose on, a
self-motion; with others it mostly cannot be assembled. Examples: similar hexagons in base and platform (Griffis
and Duffy), all platform joints on one line, four platform joints in one point.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .platform import Real, ScaledLegs
from .study import rotation_and_position

POSES = 6
SEED = 20121
DEPENDENT = 1e-10  # smallest singular value over the largest, below which the legs count as dependent


def architecturally_singular(scaled: ScaledLegs) -> NDArray[np.bool_]:
    """(n,) True where the leg Jacobian is singular in each of some fixed random poses."""
    z = np.random.default_rng(SEED).normal(size=(POSES, 8))
    R, T = rotation_and_position(z)  # the part of y along x drops out of T
    independent = np.zeros(len(scaled.legs), dtype=bool)
    for attitude, position in zip(R, T, strict=True):
        rows = leg_jacobian(scaled.legs.A, scaled.legs.B, attitude, position)
        values = np.linalg.svd(rows, compute_uv=False)
        independent |= values[:, -1] > DEPENDENT * values[:, 0]
    return ~independent


def leg_jacobian(A: Real, B: Real, R: Real, T: Real) -> Real:
    """Rows d.dT + (R B x d).omega of the legs d = T + R B - A, for A, B (n, 6, 3); shape (n, 6, 6).

    The rows are divided by the length of d where that is not zero.
    """
    arm = B @ R.T
    d = T + arm - A
    length = np.linalg.norm(d, axis=-1, keepdims=True)
    return np.concatenate([d, np.cross(arm, d)], axis=-1) / np.where(length > 0, length, 1.0)
