"""Do residuals depend on the place in the picture? Along the radius, and as a quadratic map in u and v."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...results.refusal import ArgumentError
from ..picture_test import LEAST, ROUNDING, PictureTest, picture_test
from .pictures import RobotPictures


@dataclass(frozen=True, eq=False)
class PictureMap:
    """Of each camera (K,): probability by chance of what is left over the picture.

    `radius`: the part of residuals along the radius, as a polynomial 1, r, r^2, r^3 of it. `quadratic`: both
    components as polynomials 1, u, v, u^2, uv, v^2. `coefficients` (K, 6, 2): of the latter, u and v from -1 to 1
    over the corners [pixel]. A wrong principal point shows in the second and need not in the first.
    """

    cameras: tuple[str, ...]
    radius: np.ndarray
    quadratic: np.ndarray
    coefficients: np.ndarray

    def fires(self, quiet: float = 1e-3) -> tuple[str, ...]:
        """Cameras in whose residuals the quadratic map shows, with this probability of a false alarm over all."""
        return tuple(n for n, p in zip(self.cameras, self.quadratic, strict=True) if p < quiet / len(self.cameras))


def picture_map(pictures: RobotPictures, residuals: np.ndarray) -> PictureMap:
    """Tests residuals (n, 2) [pixel] of corners over each camera's picture by `gt.vision.picture_test`, in units of
    their sigma, the picture being what the corners cover, and the radius counted from their mean.

    Whitened residuals of a right model are white but for what the fit took, which makes both tests a little mild.
    Raises ArgumentError for fewer than 30 corners of a camera.

    >>> V = gt.vision.robot_cameras
    >>> pictures = V.made_pictures(V.SyntheticRobotCameras(counts=[3, 3, 3])).pictures
    >>> rng = np.random.default_rng(1)
    >>> noise = 0.1 * rng.standard_normal(pictures.uv.shape)
    >>> V.picture_map(pictures, noise).fires(), V.picture_map(pictures, noise + 1e-6 * pictures.uv**2).fires()
    ((), ('left', 'right'))
    """
    tests, sigma = list[PictureTest](), list[float]()
    for k, name in enumerate(pictures.cameras):
        own = pictures.camera == k
        if own.sum() < LEAST:
            raise ArgumentError(f"{name} has {int(own.sum())} corners; a test of the picture needs {LEAST}", "corners")
        uv = pictures.uv[own] - pictures.uv[own].min(axis=0)
        width, height = np.ptp(uv, axis=0) + 1.0
        size = float(width), float(height)
        sigma.append(float(np.mean(pictures.sigma[own])))
        e, least = residuals[own] / pictures.sigma[own, None], ROUNDING / sigma[-1]
        tests.append(picture_test(uv, e, size, uv.mean(axis=0), least=least))
    return PictureMap(
        tuple(pictures.cameras), np.array([t.radius for t in tests]), np.array([t.quadratic for t in tests]),
        np.array([s * t.coefficients for s, t in zip(sigma, tests, strict=True)]),
    )  # fmt: skip
