"""Do residuals depend on the place in the picture? Along the radius, and by a quadratic map in u and v."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..inference.chance import f_test
from ..results.refusal import ArgumentError

LEAST = 30  # observations: fewer say nothing
ROUNDING = 1e-9  # pixel: residuals of a smaller rms are where the fit ended


@dataclass(frozen=True, eq=False)
class PictureTest:
    """Residuals of one camera over its picture.

    radius, quadratic: probabilities that residuals without a pattern look so much like one by chance: the part along
    the radius as a cubic of it, and both parts as quadratic polynomials of u and v. A wrong principal point shows in
    the second and need not in the first. size: rms of the quadratic map [pixel]; coefficients (6, 2) of 1, u, v, u^2,
    u v, v^2 for the two parts [pixel], u and v from -1 to 1 over the picture.
    """

    radius: float
    quadratic: float
    size: float
    coefficients: np.ndarray

    def fires(self, level: float = 1e-3) -> bool:
        """Whether the quadratic map is more than chance makes at this level."""
        return self.quadratic < level

    def at(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The map (n, 2) [pixel] at u, v (n,) from -1 to 1."""
        return _quadratic(u, v) @ self.coefficients


def picture_test(
    uv: np.ndarray,
    residuals: np.ndarray,
    size: tuple[float, float],
    centre: np.ndarray | None = None,
    *,
    least: float = ROUNDING,
) -> PictureTest:
    """Tests residuals (n, 2) [pixel] of marks at uv (n, 2) in a picture of `size` (width, height) by F tests; the
    radius is counted from `centre` (2,) [pixel], by default the middle of the picture. Residuals whose rms is below
    `least` are rounding: they have no pattern.

    The fit itself has taken a part of such patterns away, which makes the tests a little mild. Raises ArgumentError for
    fewer than 30 marks.

    >>> rng = np.random.default_rng(1)
    >>> uv, noise = rng.uniform(0, 480, (400, 2)), rng.normal(0, 0.1, (400, 2))
    >>> gt.vision.picture_test(uv, noise, (480, 480)).fires()
    False
    >>> gt.vision.picture_test(uv, noise + 0.1 * (uv / 240 - 1) ** 2, (480, 480)).fires()
    True
    """
    uv, e = np.asarray(uv, float), np.asarray(residuals, float)
    if len(uv) < LEAST or e.shape != uv.shape:
        raise ArgumentError(f"{len(uv)} marks with residuals of the shape {e.shape}; expected at least {LEAST}, (n, 2)")
    half = np.array([size[0] - 1.0, size[1] - 1.0]) / 2
    u, v = ((uv - half) / half).T
    d = uv - (half if centre is None else np.asarray(centre, float))
    r = np.linalg.norm(d, axis=1)
    along = np.sum(e * d, axis=1) / np.maximum(r, 1e-9)
    r = r / np.linalg.norm(half)
    rounding = not float(np.mean(e**2)) > least**2
    radius, _ = _chance(np.column_stack([np.ones_like(r), r, r**2, r**3]), along[:, None])
    quadratic, c = _chance(_quadratic(u, v), e)
    if rounding:
        radius = quadratic = 1.0
    return PictureTest(radius, quadratic, float(np.sqrt(np.mean(np.sum((_quadratic(u, v) @ c) ** 2, axis=1)))), c)


def _quadratic(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])


def _chance(B: np.ndarray, e: np.ndarray) -> tuple[float, np.ndarray]:
    """Probability of as much of e (n, c) in the columns of B by chance, and the coefficients."""
    c = np.linalg.lstsq(B, e, rcond=None)[0]
    left = float(np.sum((e - B @ c) ** 2))
    return f_test(float(np.sum(e**2)), left, c.size, e.size - c.size)[1] if left > 0 else 1.0, c
