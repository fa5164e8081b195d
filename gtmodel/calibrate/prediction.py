"""How well a calibrated model predicts poses: sizes of errors, the worst place, principal directions, outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# probability that a set of poses with normal errors has any residual called an outlier
FALSE_ALARM = 0.01
MAD = 1.4826022185  # standard deviation of a normal variable over its median absolute deviation


@dataclass(frozen=True, eq=False)
class Prediction:
    """Errors (N, 3) of a predicted position [m] or, as small turns, orientation [rad]; rows of NaN do not count.

    A planar mechanism has errors (N, 2).
    """

    errors: np.ndarray

    @property
    def sizes(self) -> np.ndarray:
        """|e_k| (N,) (Dressler 2012, eq. (5.5))."""
        return np.linalg.norm(self.errors, axis=1)

    @property
    def lost(self) -> int:
        """How many poses do not close, and so are in none of the numbers."""
        return int(np.count_nonzero(np.isnan(self.sizes)))

    @property
    def mean(self) -> float:
        return float(np.nanmean(self.sizes))

    @property
    def greatest(self) -> float:
        return float(np.nanmax(self.sizes))

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.nanmean(self.sizes**2)))

    @property
    def worst(self) -> int:
        """The pose with the greatest error."""
        return int(np.nanargmax(self.sizes))

    def principal(self) -> tuple[np.ndarray, np.ndarray]:
        """Rms errors (k,) along the principal directions (k, k) of errors (N, k), one per row, the least first.

        Of E'E / N with the errors as they are, their mean not removed, as below eq. (5.13) of Dressler 2012. The
        largest component of a direction is positive.
        """
        good = self.errors[np.all(np.isfinite(self.errors), axis=1)]
        values, vectors = np.linalg.eigh(good.T @ good / len(good))
        rows = vectors.T
        rows = rows * np.sign(rows[np.arange(len(rows)), np.argmax(np.abs(rows), axis=1)])[:, None]
        return np.sqrt(np.maximum(values, 0.0)), rows


@dataclass(frozen=True)
class Outlier:
    """A residual far beyond the others of its link: pose and link (from 0), residual [m], in robust deviations."""

    pose: int
    link: int
    residual: float
    times: float


def outliers(residuals: np.ndarray) -> list[Outlier]:
    """Of residuals (N, m) per pose and link, the farthest first.

    Against the median of the link, in units of its median absolute deviation; the bound is the one that all N m normal
    residuals together pass with a probability of 1 %.
    """
    from scipy import stats  # here: it alone takes as long to import as all of gtmodel

    r = residuals - np.median(residuals, axis=0)
    scale = MAD * np.median(np.abs(r), axis=0)
    bound = float(stats.norm.isf(FALSE_ALARM / 2 / r.size))
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where(scale > 0, np.abs(r) / scale, 0.0)
    outlying = [
        Outlier(int(k), int(j), float(residuals[k, j]), float(times[k, j])) for k, j in np.argwhere(times > bound)
    ]
    return sorted(outlying, key=lambda o: (-o.times, o.pose, o.link))
