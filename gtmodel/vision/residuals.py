"""Tests of corner residuals: wrong corners and wrong pictures against noise, and dependence on the place in the
picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..inference.chance import f_test
from ..measurements.inspection.residual_tests import Outliers, outliers
from ..results.refusal import ArgumentError

LEAST = 30  # observations that a test needs
ROUNDING = 1e-9  # pixel: residuals of a smaller rms are round-off


@dataclass(frozen=True, eq=False)
class PictureTest:
    """Result of a test whether the residuals of one camera depend on the place in its picture.

    radius, quadratic: p-values for residuals without a pattern; `radius` tests the radial component for a cubic in the
    radius, `quadratic` both components for quadratic polynomials in u and v. A wrong principal point shows in the
    second, but not always in the first. size: rms of the quadratic map [pixel]; coefficients (6, 2): of 1, u, v, u^2,
    u v, v^2 for both components [pixel], with u and v from -1 to 1 over the picture.
    """

    radius: float
    quadratic: float
    size: float
    coefficients: np.ndarray

    def fires(self, level: float = 1e-3) -> bool:
        """Return whether the quadratic map is significant at this level."""
        return self.quadratic < level

    def at(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the quadratic map (n, 2) [pixel] at u, v (n,) from -1 to 1."""
        return _quadratic(u, v) @ self.coefficients


def picture_test(
    uv: np.ndarray,
    residuals: np.ndarray,
    size: tuple[float, float],
    centre: np.ndarray | None = None,
    *,
    least: float = ROUNDING,
) -> PictureTest:
    """Test with F tests whether residuals (n, 2) [pixel] depend on the place uv (n, 2) [pixel] of their marks.

    `size` is the width and height of the picture. The radius is measured from `centre` (2,) [pixel], by default the
    middle of the picture. Residuals whose rms is below `least` are round-off and count as having no pattern.

    The fit has already absorbed a part of such patterns, so the tests fire a little less often than stated. Raises
    ArgumentError for fewer than 30 marks.

    >>> rng = np.random.default_rng(1)
    >>> uv, noise = rng.uniform(0, 480, (400, 2)), rng.normal(0, 0.1, (400, 2))
    >>> gt.vision.picture_test(uv, noise, (480, 480)).fires()
    False
    >>> gt.vision.picture_test(uv, noise + 0.1 * (uv / 240 - 1) ** 2, (480, 480)).fires()
    True
    """
    uv, e = np.asarray(uv, float), np.asarray(residuals, float)
    if len(uv) < LEAST or e.shape != uv.shape:
        raise ArgumentError(
            f"found {len(uv)} marks and residuals of the shape {e.shape}; expected at least {LEAST} rows, (n, 2)"
        )
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
    """Return the p-value of e (n, c) having no part in the columns of B, and the coefficients."""
    c = np.linalg.lstsq(B, e, rcond=None)[0]
    remaining = float(np.sum((e - B @ c) ** 2))
    return f_test(float(np.sum(e**2)), remaining, c.size, e.size - c.size)[1] if remaining > 0 else 1.0, c


SETTLED = 0.01  # relative change of the noise between two robust fits
# median length of a pair of normal errors, in standard deviations: sqrt(2 ln 2)
MEDIAN = float(np.sqrt(2 * np.log(2)))
WRONG = 0.5  # a picture is wrong as a whole if more than this share of its corners is off by SPREAD times a gross error
SPREAD = 3.0  # noise of a picture of a distant, tilted or defocused board, relative to the others, at most
FEW = 10  # corners of a view; with fewer, the noise of its camera is used


class Corners(Protocol):
    """n corners: indices camera and picture (n,); sigma (n,) [pixel], None if the detector states none."""

    @property
    def camera(self) -> np.ndarray: ...
    @property
    def picture(self) -> np.ndarray: ...
    @property
    def sigma(self) -> np.ndarray | None: ...


@dataclass(frozen=True, eq=False)
class GrossErrors:
    """Gross errors of corners.

    corners (n,): mask of gross errors. pictures: indices of pictures that are wrong as a whole; the mask covers all
    their corners. noise: standard deviation of the coordinates of the other corners [pixel], or in units of their
    sigma. p: probability that clean corners include one as far off as the worst single corner.
    """

    corners: np.ndarray
    pictures: tuple[int, ...]
    noise: float
    p: float = 1.0


def gross_errors(table: Corners, residuals: np.ndarray, gross: float) -> GrossErrors:
    """Find gross errors in residuals (n, 2) [pixel].

    Wrong pictures are found first, with the noise from the median of all lengths, which tolerates up to half of the
    corners being wrong. Then come corners that are too far off for any view. Other corners are compared with the noise
    of their own view, which grows with tilt and distance: an outlier is improbable among clean corners and at least
    `gross` standard deviations off.

    >>> board = gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6)
    >>> table, lenses, cameras = gt.vision.stereo.made_corners(gt.vision.stereo.SyntheticBoards(), board)
    >>> residuals = 0.1 * np.random.default_rng(1).standard_normal((table.n, 2))
    >>> residuals[7] = 2.0
    >>> bad = gt.vision.stereo.gross_errors(table, residuals, 5.0)
    >>> np.flatnonzero(bad.corners), bad.pictures, round(bad.noise, 2)
    (array([7]), (), 0.1)
    """
    e = scaled(table, residuals)
    length, noise = np.linalg.norm(e, axis=1), noise_of(e)
    far = length > SPREAD * gross * max(noise, 1e-12)
    count = np.bincount(table.picture)
    wrong = np.flatnonzero(np.bincount(table.picture, far) > WRONG * count)
    in_wrong = np.isin(table.picture, wrong)
    corners = in_wrong | far  # several large errors in one view would mask each other in the test below
    rest = np.flatnonzero(~corners)
    view = table.camera * len(count) + table.picture
    size = np.bincount(view[rest], minlength=view.max(initial=0) + 1)[view[rest]]
    single = outliers(e[rest], groups=np.where(size < FEW, -1 - table.camera[rest], view[rest]))
    odd = single.beyond()
    odd = odd[single.times[odd] > gross]
    corners[rest[odd]] = True
    p = 0.0 if np.any(far & ~in_wrong) else float(np.min(single.p[odd], initial=1.0))
    return GrossErrors(corners, tuple(wrong.tolist()), noise, p)


def scaled(table: Corners, residuals: np.ndarray) -> np.ndarray:
    """Return residuals (n, 2) in units of their sigma, or in pixels without sigma."""
    return residuals if table.sigma is None else residuals / table.sigma[:, None]


def noise_of(scaled_residuals: np.ndarray) -> float:
    """Return the standard deviation of the coordinates of residuals (n, 2), estimated from their median length."""
    return float(np.median(np.linalg.norm(scaled_residuals, axis=1))) / MEDIAN


def picture_means(table: Corners, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the mean residual of each picture (k, 2) times the square root of its number of corners, so that all have
    the same noise, and the indices of the picture (k,) and of its camera (k,)."""
    e = scaled(table, residuals)
    which, first, back = np.unique(table.picture, return_index=True, return_inverse=True)
    sums = np.stack([np.bincount(back.reshape(-1), e[:, j]) for j in (0, 1)], axis=1)
    return sums / np.sqrt(np.bincount(back.reshape(-1)))[:, None], which, table.camera[first]


def shifted_pictures(table: Corners, residuals: np.ndarray) -> tuple[Outliers, np.ndarray]:
    """Test whether single pictures of a camera are offset as a whole (shifted, or of another pose or time), even if
    each of their corners is only a little off. Return the outliers and the indices of the pictures they refer to.

    >>> V = gt.vision.robot_cameras
    >>> p = V.made_pictures(V.SyntheticRobotCameras(counts=[3, 3, 3])).pictures
    >>> residuals = 0.1 * np.random.default_rng(1).standard_normal((len(p), 2))
    >>> residuals[p.picture == 4] += 0.2  # pixel
    >>> from gtmodel.vision.residuals import shifted_pictures
    >>> found, pictures = shifted_pictures(p, residuals)
    >>> pictures[found.beyond(0.01)]
    array([4])
    """
    means, which, camera = picture_means(table, residuals)
    return outliers(means, groups=camera), which
