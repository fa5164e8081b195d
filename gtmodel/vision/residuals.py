"""What residuals of corners tell: wrong corners and wrong pictures, told from noise, and whether they depend on the
place in the picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..inference.chance import f_test
from ..measurements.inspection.residual_tests import Outliers, outliers
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


SETTLED = 0.01  # relative change of the noise between two robust fits
# median of the length of a pair of normal errors, in standard deviations: sqrt(2 ln 2)
MEDIAN = float(np.sqrt(2 * np.log(2)))
WRONG = 0.5  # a picture of which more corners than this are off by SPREAD times a gross error is wrong as a whole
SPREAD = 3.0  # pictures of a board that is far, tilted or out of focus have up to so many times the noise of the others
FEW = 10  # corners of a view: with fewer the noise of its camera is theirs


class Corners(Protocol):
    """n corners: camera and picture (n,) by number; sigma (n,) [pixel], None where the detector gives none."""

    @property
    def camera(self) -> np.ndarray: ...
    @property
    def picture(self) -> np.ndarray: ...
    @property
    def sigma(self) -> np.ndarray | None: ...


@dataclass(frozen=True, eq=False)
class GrossErrors:
    """corners (n,): a mask of gross errors; pictures: numbers of those that are wrong as a whole, whose corners are all
    in the mask; noise: standard deviation of the others' coordinates [pixel], or in units of their sigma; p: how often
    clean corners have one as far off as the worst of those that belong to no wrong picture."""

    corners: np.ndarray
    pictures: tuple[int, ...]
    noise: float
    p: float = 1.0


def gross_errors(table: Corners, residuals: np.ndarray, gross: float) -> GrossErrors:
    """Of residuals (n, 2) [pixel]. Pictures first, by the median of all lengths, which up to half of the corners may
    not spoil; then corners that are too far off for any view, and others by the noise of their own view, which tilt
    and distance make larger: those that clean corners hardly ever show in any, and that lie `gross` deviations off.

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
    own = np.bincount(table.picture)
    wrong = np.flatnonzero(np.bincount(table.picture, far) > WRONG * own)
    of_wrong = np.isin(table.picture, wrong)
    corners = of_wrong | far  # several far off in one view hide each other from what follows
    left = np.flatnonzero(~corners)
    view = table.camera * len(own) + table.picture
    seen = np.bincount(view[left], minlength=view.max(initial=0) + 1)[view[left]]
    single = outliers(e[left], groups=np.where(seen < FEW, -1 - table.camera[left], view[left]))
    odd = single.beyond()
    odd = odd[single.times[odd] > gross]
    corners[left[odd]] = True
    p = 0.0 if np.any(far & ~of_wrong) else float(np.min(single.p[odd], initial=1.0))
    return GrossErrors(corners, tuple(wrong.tolist()), noise, p)


def scaled(table: Corners, residuals: np.ndarray) -> np.ndarray:
    """Residuals (n, 2) in units of their sigma; in pixels where there is none."""
    return residuals if table.sigma is None else residuals / table.sigma[:, None]


def noise_of(scaled_residuals: np.ndarray) -> float:
    """Standard deviation of the coordinates of most residuals (n, 2), by the median of their lengths."""
    return float(np.median(np.linalg.norm(scaled_residuals, axis=1))) / MEDIAN


def picture_means(table: Corners, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The mean residual of each picture (k, 2) times the root of its corners, so that noise makes all alike; the number
    of the picture (k,) and of its camera."""
    e = scaled(table, residuals)
    which, first, back = np.unique(table.picture, return_index=True, return_inverse=True)
    sums = np.stack([np.bincount(back.reshape(-1), e[:, j]) for j in (0, 1)], axis=1)
    return sums / np.sqrt(np.bincount(back.reshape(-1)))[:, None], which, table.camera[first]


def shifted_pictures(table: Corners, residuals: np.ndarray) -> tuple[Outliers, np.ndarray]:
    """Which pictures of one camera lie beside the others as a whole, by however little their corners: shifted, of
    another pose, or of another moment. With the outliers come the numbers of the pictures they count.

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
