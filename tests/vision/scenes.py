"""Synthetic scenes of a target before a camera with distortion, for tests of detection."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from gtmodel.vision import rendering

SIZE = (640, 480)
FOCAL = 700.0
EDGE = 7.0  # pixel between the target and the picture's border


def lens(rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """Points (n, 3) in the camera's frame to pixels, with Brown's distortion, written out here once more."""
    c = np.array([319.5, 239.5]) + 5 * rng.standard_normal(2)
    p1, p2 = 1e-3 * rng.standard_normal(2)

    def project(P: np.ndarray) -> np.ndarray:
        x, y = P[:, 0] / P[:, 2], P[:, 1] / P[:, 2]
        r2 = x * x + y * y
        radial = 1 - 0.25 * r2 + 0.08 * r2**2
        return np.column_stack([
            FOCAL * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + c[0],
            FOCAL * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + c[1],
        ])  # fmt: skip

    return project


def scene(target, seed: int):
    """A projection of the target's frame, at a random place and turn such that all of it is in the picture, and where
    its marks are there."""
    rng = np.random.default_rng(seed)
    camera, points = lens(rng), target.points
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    corners = np.concatenate([np.concatenate(list(layer.shapes)) for layer in target.layers])
    while True:
        tilt = Rotation.from_rotvec([*rng.uniform(-0.5, 0.5, 2), 0.0])
        R = (tilt * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])).as_matrix()
        z = np.ptp(points, axis=0).max() * FOCAL / rng.uniform(150, 330)
        u, v = rng.uniform(80, 560), rng.uniform(80, 400)
        t = np.array([(u - 319.5) / FOCAL * z, (v - 239.5) / FOCAL * z, z])

        def project(X: np.ndarray, R: np.ndarray = R, t: np.ndarray = t) -> np.ndarray:
            return camera((X - middle) @ R.T + t)

        there = project(corners)
        if np.all((there > EDGE - 1) & (there < np.array(SIZE) - EDGE)):
            return project, project(points)


def picture(target, project, seed: int, **exposure) -> np.ndarray:
    """Blur 0.7 pixel, noise 2 of 255."""
    background = np.random.default_rng([seed, 1]).uniform(60, 180)
    return rendering.rendered(
        target.layers, project, SIZE, rendering.Exposure(**{"seed": seed, "background": background, **exposure})
    )
