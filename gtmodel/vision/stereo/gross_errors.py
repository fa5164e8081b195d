"""Wrong corners and wrong pictures: told from noise, and left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..corner_table import CornerTable
from .calibrated import CameraStarts, calibrated, started_at
from .options import CameraFit

ROUNDS = 8
# iterations of a first fit of all corners alike, by a noise [pixel] that no error reaches
ROUGH, PLAIN = 6, 1e3
SETTLED = 0.01  # relative change of the noise between two robust fits
# median of the length of a pair of normal errors, in standard deviations: sqrt(2 ln 2)
MEDIAN = float(np.sqrt(2 * np.log(2)))
WRONG = 0.5  # a picture of which more corners than this are gross errors is wrong as a whole


@dataclass(frozen=True, eq=False)
class GrossErrors:
    """corners (n,): a mask of gross errors; pictures: numbers of those that are wrong as a whole, whose corners are all
    in the mask; noise: standard deviation of the others' coordinates [pixel], or in units of their sigma."""

    corners: np.ndarray
    pictures: tuple[int, ...]
    noise: float


def gross_errors(table: CornerTable, residuals: np.ndarray, gross: float) -> GrossErrors:
    """Of residuals (n, 2) [pixel], by the median of their lengths, which up to half of the corners may not spoil; from
    `gross` standard deviations on.

    >>> board = gt.vision.BoardPictures(width_pixel=640, height_pixel=480, columns=9, rows=6)
    >>> table, lenses, cameras = gt.vision.stereo.made_corners(gt.vision.stereo.SyntheticBoards(), board)
    >>> residuals = 0.1 * np.random.default_rng(1).standard_normal((table.n, 2))
    >>> residuals[7] = 2.0
    >>> bad = gt.vision.stereo.gross_errors(table, residuals, 5.0)
    >>> np.flatnonzero(bad.corners), bad.pictures, round(bad.noise, 2)
    (array([7]), (), 0.1)
    """
    length = np.linalg.norm(residuals, axis=1)
    if table.sigma is not None:
        length = length / table.sigma
    noise = float(np.median(length)) / MEDIAN
    corners = length > gross * max(noise, 1e-12)
    wrong = []
    for p in range(len(table.pictures)):
        own = table.picture == p
        if own.any() and np.mean(corners[own]) > WRONG:
            wrong.append(p)
            corners = corners | own
    return GrossErrors(corners, tuple(wrong), noise)


def without_gross_errors(
    table: CornerTable, start: CameraStarts, fit: CameraFit, stop: Callable[[], bool] | None
) -> tuple[CameraStarts, GrossErrors]:
    """Robust fits until the noise settles: where they end, and what is left out after them."""
    plain = calibrated(table, start, replace(fit, limit=ROUGH), loss_sigma=PLAIN, stop=stop)
    noise = 0.0
    for _ in range(ROUNDS):
        start = started_at(plain)
        bad = gross_errors(table, plain.residuals["corners"], fit.gross)
        if abs(bad.noise - noise) <= SETTLED * bad.noise:
            break
        noise = max(bad.noise, 1e-9)
        plain = calibrated(table, start, fit, loss_sigma=noise, stop=stop)
    return started_at(plain), gross_errors(table, plain.residuals["corners"], fit.gross)
