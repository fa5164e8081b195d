"""Do residuals depend on the place in the picture? Along the radius, and as a quadratic map in u and v."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...results.refusal import ArgumentError
from .pictures import RobotPictures

LEAST = 30  # corners of a camera


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
    """Tests residuals (n, 2) [pixel] of corners over each camera's picture, by F against their own scatter.

    Whitened residuals of a right model are white but for what the fit took, which makes both tests a little mild.
    Raises ArgumentError for fewer than 30 corners of a camera.

    >>> V = gt.vision.robot_cameras
    >>> pictures = V.made_pictures(V.SyntheticRobotCameras(counts=[3, 3, 3])).pictures
    >>> rng = np.random.default_rng(1)
    >>> noise = 0.1 * rng.standard_normal(pictures.uv.shape)
    >>> V.picture_map(pictures, noise).fires(), V.picture_map(pictures, noise + 1e-6 * pictures.uv**2).fires()
    ((), ('left', 'right'))
    """
    from scipy import stats

    radius, quadratic, coefficients = [], [], []
    for k, name in enumerate(pictures.cameras):
        own = pictures.camera == k
        if own.sum() < LEAST:
            raise ArgumentError(f"{name} has {int(own.sum())} corners; a test of the picture needs {LEAST}", "corners")
        e, uv = residuals[own] / pictures.sigma[own, None], pictures.uv[own]
        s = 2 * (uv - uv.min(axis=0)) / np.ptp(uv, axis=0) - 1
        u, v = s.T
        d = uv - uv.mean(axis=0)
        r = np.linalg.norm(d, axis=1)
        along = (e * d).sum(axis=1) / np.maximum(r, 1e-9)
        r = r / r.max()
        radius.append(_chance(np.stack([np.ones_like(r), r, r**2, r**3], axis=1), along[:, None], stats)[0])
        p, c = _chance(np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1), e, stats)
        quadratic.append(p)
        coefficients.append(c * np.mean(pictures.sigma[own]))
    return PictureMap(tuple(pictures.cameras), np.array(radius), np.array(quadratic), np.array(coefficients))


def _chance(B: np.ndarray, e: np.ndarray, stats: object) -> tuple[float, np.ndarray]:
    """Probability of as much of e (n, c) in the columns of B (n, k) by chance, and the coefficients (k, c)."""
    c, *_ = np.linalg.lstsq(B, e, rcond=None)
    fitted = B @ c
    free = e.size - c.size
    F = (fitted**2).sum() / c.size / (((e - fitted) ** 2).sum() / free)
    return float(stats.f.sf(F, c.size, free)), c  # type: ignore[attr-defined]
