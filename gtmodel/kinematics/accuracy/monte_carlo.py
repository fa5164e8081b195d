"""Positioning errors by drawing: synthetic errors of lengths or base points through exact kinematics."""

from __future__ import annotations

import numpy as np

from .corners import Array
from .ellipsoids import Ellipsoids
from .spheres import common_point


def length_cloud(a: Array, T: Array, lengths: Array, r: Array, samples: int, seed: int) -> Array:
    """Errors (samples, 3) [m] at one pose for link-length errors drawn evenly from -r to r.

    Args:
        a: (3, 3) base points [m]. T: (3,) nominal point [m]. lengths, r: (3,) [m].
        seed: of NumPy's default generator.

    Raises ValueError where a draw has no solution.

    Three links of 1 m at right angles:

    >>> from gtmodel.kinematics.accuracy import length_cloud
    >>> cloud = length_cloud(-np.eye(3), np.zeros(3), np.ones(3), np.full(3, 1e-4), samples=1000, seed=1)
    >>> cloud.shape, (1e3 * np.abs(cloud).max(axis=0)).round(2)  # mm
    ((1000, 3), array([0.1, 0.1, 0.1]))
    """
    drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, 3)) * r
    return _cloud(np.broadcast_to(a, (samples, 3, 3)), T, lengths + drawn)


def base_point_cloud(a: Array, T: Array, lengths: Array, ellipsoids: Ellipsoids, samples: int, seed: int) -> Array:
    """Errors (samples, 3) [m] at one pose for base points drawn from the surfaces of their ellipsoids.

    Directions are drawn evenly and stretched by the half-axes; see `length_cloud` for the arguments.

    Three links of 1 m at right angles, base points 0.1 mm off:

    >>> from gtmodel.kinematics.accuracy import Ellipsoids, base_point_cloud
    >>> within = Ellipsoids(np.tile(np.eye(3), (3, 1, 1)), np.full((3, 3), 1e-4))
    >>> cloud = base_point_cloud(-np.eye(3), np.zeros(3), np.ones(3), within, samples=1000, seed=1)
    >>> cloud.shape, (1e3 * np.abs(cloud).max(axis=0)).round(2)  # mm
    ((1000, 3), array([0.1, 0.1, 0.1]))
    """
    drawn = np.random.default_rng(seed).standard_normal((samples, 3, 3))
    drawn /= np.linalg.norm(drawn, axis=2, keepdims=True)
    moved = np.einsum("nik,ik,ikc->nic", drawn, ellipsoids.half, ellipsoids.axes)
    return _cloud(a + moved, T, np.broadcast_to(lengths, (samples, 3)))


def _cloud(centres: Array, T: Array, radii: Array) -> Array:
    points, status = common_point(centres, radii, np.broadcast_to(T, (len(radii), 3)))
    if np.any(status != 0):
        raise ValueError(
            f"{int(np.sum(status != 0))} of {len(radii)} drawn robots cannot be assembled near the nominal point; "
            "the pose is too close to a singularity for errors of this size"
        )
    return points - T
