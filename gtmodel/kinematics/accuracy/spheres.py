"""The common point of three spheres by Newton's method: a cross-check of the model's forward kinematics."""

from __future__ import annotations

import numpy as np

from ...results import Status
from .corners import SINGULAR, Array

STEPS = 8
CLOSE = 1e-12  # residual of the lengths [m]: rounding of points some metres from the origin


def common_point(centres: Array, radii: Array, start: Array) -> tuple[Array, Array]:
    """Points (n, 3) [m] at distances radii (n, 3) from centres (n, 3, 3), from nearby start values (n, 3).

    Returns the points and codes (n,) of `Status`: SINGULAR where the three directions lie in a plane, NOT_CONVERGED
    where the spheres do not meet near the start. Other rows than OK are NaN.

    Spheres of 1 m, and one that is too small to meet the others:

    >>> centres = np.tile(-np.eye(3), (2, 1, 1))
    >>> radii = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 0.1]])
    >>> points, status = gt.kinematics.accuracy.common_point(centres, radii, np.zeros((2, 3)))
    >>> points.round(6) + 0.0, [gt.Status(code).name for code in status]
    (array([[ 0.,  0.,  0.],
           [nan, nan, nan]]), ['OK', 'NOT_CONVERGED'])
    """
    x = np.array(start, dtype=float)
    status = np.where(np.isfinite(x).all(axis=1) & np.isfinite(centres).all(axis=(1, 2)), Status.OK, Status.NOT_FINITE)
    for step in range(STEPS + 1):
        good = np.flatnonzero(status == Status.OK)
        d = x[good, None] - centres[good]
        distance = np.linalg.norm(d, axis=2)
        gap = radii[good] - distance
        if step == STEPS or not len(good):
            status[good[~(np.abs(gap) < CLOSE).all(axis=1)]] = Status.NOT_CONVERGED
            break
        u = d / distance[..., None]
        singular = ~(np.abs(np.linalg.det(u)) >= SINGULAR)
        status[good[singular]] = Status.SINGULAR
        x[good[~singular]] += np.linalg.solve(u[~singular], gap[~singular][..., None])[..., 0]
    x[status != Status.OK] = np.nan
    return x, status
