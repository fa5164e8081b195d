"""Which points the L1 prototype reaches, by hand in NumPy on contiguous columns, as a user of this one robot writes it.

A point is out of reach (1), within `least` [rad] of a singular pose, or with a link outside a cone of `half_angle`
[rad] about its direction at home (101); else 0. Angles are compared by sine and cosine.
"""

from __future__ import annotations

import numpy as np

from gtmodel.kinematics.workspace.reach import FIRST_LIMIT

from .l1_by_hand import Data
from .rows_by_hand import BLOCK, Array

SINGULAR, CONES = FIRST_LIMIT, FIRST_LIMIT + 1


def links(d: Data, T: Array) -> tuple[list[Array], Array]:
    """Unit vectors (3, n) from cart to plate, and whether all links reach."""
    units, reached = [], np.ones(T.shape[1], bool)
    for A, L, ahead in zip(d.A, d.L, d.ahead, strict=True):
        dy, dz = T[1] - A[1], T[2] - A[2]
        square = L * L - dy * dy - dz * dz
        reached &= square >= 0
        units.append(np.stack([ahead * np.sqrt(square), dy, dz]) / L)
    return units, reached


def reachability(d: Data, T: Array, home: Array, half_angle: float, least: float) -> Array:
    """Codes (n,) of points (n, 3)."""
    axes = [u[:, 0] for u in links(d, home[:, None])[0]]
    codes = np.empty(len(T), np.uint8)
    with np.errstate(invalid="ignore"):
        for begin in range(0, len(T), BLOCK):
            block = slice(begin, begin + BLOCK)
            units, reached = links(d, np.ascontiguousarray(T[block].T))
            regular = np.ones(len(reached), bool)
            for u in units:
                regular &= np.abs(u[0]) >= np.sin(least)
            for i in range(3):
                u, v, w = units[i], units[i - 2], units[i - 1]
                normal = v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]
                height = np.abs(u[0] * normal[0] + u[1] * normal[1] + u[2] * normal[2])
                length = np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
                regular &= height >= np.sin(least) * length
            inside = np.ones(len(reached), bool)
            for u, axis in zip(units, axes, strict=True):
                inside &= axis @ u >= np.cos(half_angle)
            codes[block] = np.where(~reached, 1, np.where(~regular, SINGULAR, np.where(~inside, CONES, 0)))
    return codes
