"""Distances between points z of projective space, given as complex vectors with |z| = 1."""

from __future__ import annotations

import numpy as np

from .platform import Real
from .study import Array

SAME = 1e-6  # below it two points are taken for one where nothing better is known


def projective_distance(z: Array, w: Array) -> Array:
    """Distance of points (..., 8) from the complex line through w (..., 8); both with unit norm."""
    return np.linalg.norm(z - w * np.sum(np.conj(w) * z, axis=-1, keepdims=True), axis=-1)


def distances(z: Array) -> Real:
    """Projective distances between points z (..., m, 8), |z| = 1; shape (..., m, m), the diagonal infinite."""
    inner = np.conj(z) @ np.swapaxes(z, -1, -2)
    gap = z[..., None, :, :] - inner[..., None] * z[..., :, None, :]
    result = np.linalg.norm(gap, axis=-1)
    i = np.arange(z.shape[-2])
    result[..., i, i] = np.inf
    return result


def distance_to_conjugate(z: Array) -> Real:
    """Projective distance (m,) of points z (m, 8), |z| = 1, from their own conjugates: zero for a real point."""
    w = np.conj(z)
    return np.linalg.norm(w - z * np.sum(w * w, axis=-1, keepdims=True), axis=-1)
