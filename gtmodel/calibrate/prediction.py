"""How well a calibrated model predicts poses: size of errors, worst place, principal directions, outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..inference.covariance import RANK
from ..measurements.inspection.residual_tests import Outliers, outliers as outlying
from ..results.suspicion import RUN_LEVEL

OF_POSES = 5  # number of tests: held-out poses, size of the noise, colour, comparison of recordings, outliers
MAD = 1.4826022185  # standard deviation of a normal variable over its median absolute deviation


@dataclass(frozen=True, eq=False)
class Prediction:
    """Errors (N, 3) of a predicted position [m] or orientation [rad, small rotations]; rows of NaN are left out.

    Planar mechanisms have errors (N, 2).
    """

    errors: np.ndarray

    @property
    def sizes(self) -> np.ndarray:
        """|e_k| (N,) (Dressler 2012, eq. (5.5))."""
        return np.linalg.norm(self.errors, axis=1)

    @property
    def lost(self) -> int:
        """Number of poses that do not close; no other number includes them."""
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
        """The pose with the largest error."""
        return int(np.nanargmax(self.sizes))

    def principal(self) -> tuple[np.ndarray, np.ndarray]:
        """Return rms errors (k,) and principal directions (k, k) of errors (N, k), one per row, the smallest first.

        From E'E / N with the mean of the errors not removed, as below eq. (5.13) of Dressler 2012. The largest
        component of a direction is positive.
        """
        good = self.errors[np.all(np.isfinite(self.errors), axis=1)]
        values, vectors = np.linalg.eigh(good.T @ good / len(good))
        rows = vectors.T
        rows = rows * np.sign(rows[np.arange(len(rows)), np.argmax(np.abs(rows), axis=1)])[:, None]
        return np.sqrt(np.maximum(values, 0.0)), rows


@dataclass(frozen=True)
class Outlier:
    """A residual far beyond the others of its link, or the largest of a pose that is off as a whole.

    Pose and link count from 0; `residual` [m]; `times`: residual in its standard deviations."""

    pose: int
    link: int
    residual: float
    times: float


def outliers(
    residuals: np.ndarray, basis: np.ndarray | None = None, noise: tuple[np.ndarray, np.ndarray] | None = None
) -> list[Outlier]:
    """Return outliers of residuals (N, m) per pose and link, the farthest first; each link has its own noise.

    Outliers are residuals that are improbable for this number of normal ones, each in its own standard deviations; see
    gtmodel.measurements.inspection.residual_tests. basis: (N, m, p), orthonormal columns of the residuals' Jacobian.
    noise: that Jacobian (N, m, n), without columns if outliers do not influence the fit, and the covariance (N, m, m)
    of a pose's lengths up to a factor; with it poses are also tested as a whole, since an error of the position is in
    all lengths. Residuals that are not finite are ignored.
    """
    N, m = residuals.shape
    level = RUN_LEVEL / OF_POSES / (1 if noise is None else 2)
    judged = outlying(residuals.reshape(-1), None if basis is None else basis.reshape(N * m, -1), np.tile(range(m), N))
    extreme = {divmod(k, m): float(judged.times[k]) for k in judged.beyond(level).tolist()}
    if noise is not None:
        together = _of_poses(residuals, *noise)
        named = {pose for pose, _ in extreme}
        for pose in together.beyond(level).tolist():
            if pose not in named:
                extreme[pose, int(np.argmax(np.abs(residuals[pose])))] = float(together.times[pose])
    listed = [Outlier(pose, link, float(residuals[pose, link]), times) for (pose, link), times in extreme.items()]
    return sorted(listed, key=lambda o: (-o.times, o.pose, o.link))


def _of_poses(residuals: np.ndarray, jacobian: np.ndarray, covariance: np.ndarray) -> Outliers:
    """Test each pose by all its lengths in units of their noise, after one step to the best unknowns in these units."""
    root = np.linalg.cholesky(covariance)
    N, m = residuals.shape
    rows = np.linalg.solve(root, jacobian).reshape(N * m, -1)
    size = np.linalg.norm(rows, axis=0)
    U, s, _ = np.linalg.svd(rows / np.where(size > 0, size, 1.0), full_matrices=False)
    U = U[:, s > RANK * s.max(initial=0.0)]
    e = np.linalg.solve(root, residuals[:, :, None]).reshape(-1)
    return outlying((e - U @ (U.T @ e)).reshape(N, m), U.reshape(N, m, -1))
