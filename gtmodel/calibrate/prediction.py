"""How well a calibrated model predicts poses: sizes of errors, the worst place, principal directions, outliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..inference.covariance import RANK
from ..measurements.inspection.residual_tests import Outliers, outliers as outlying
from ..results.suspicion import RUN_LEVEL

OF_POSES = 5  # tests: held-out poses, size of the noise, colour, recordings against each other, outliers
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
    """A residual far beyond the others of its link, or the largest of a pose that is far off as a whole: pose and link
    (from 0), residual [m], in its own deviations."""

    pose: int
    link: int
    residual: float
    times: float


def outliers(
    residuals: np.ndarray, basis: np.ndarray | None = None, noise: tuple[np.ndarray, np.ndarray] | None = None
) -> list[Outlier]:
    """Of residuals (N, m) per pose and link, the farthest first: those that normal ones of so many hardly show, each
    against its own deviation, see gtmodel.measurements.inspection.residual_tests. Links have a noise each.

    basis: (N, m, p), orthonormal columns of the residuals' Jacobian. noise: that Jacobian (N, m, n), without columns
    where outliers do not bend the fit, and the covariance (N, m, m) of a pose's lengths but for a factor. By it the
    lengths of a pose are judged together too: an error of its position is in all of them. Residuals that are not finite
    are none.
    """
    N, m = residuals.shape
    level = RUN_LEVEL / OF_POSES / (1 if noise is None else 2)
    judged = outlying(residuals.reshape(-1), None if basis is None else basis.reshape(N * m, -1), np.tile(range(m), N))
    far = {divmod(k, m): float(judged.times[k]) for k in judged.beyond(level).tolist()}
    if noise is not None:
        together = _of_poses(residuals, *noise)
        named = {pose for pose, _ in far}
        for pose in together.beyond(level).tolist():
            if pose not in named:
                far[pose, int(np.argmax(np.abs(residuals[pose])))] = float(together.times[pose])
    listed = [Outlier(pose, link, float(residuals[pose, link]), times) for (pose, link), times in far.items()]
    return sorted(listed, key=lambda o: (-o.times, o.pose, o.link))


def _of_poses(residuals: np.ndarray, jacobian: np.ndarray, covariance: np.ndarray) -> Outliers:
    """Each pose by all its lengths, in units of their noise, at the unknowns that are best by these units: one step."""
    root = np.linalg.cholesky(covariance)
    N, m = residuals.shape
    rows = np.linalg.solve(root, jacobian).reshape(N * m, -1)
    size = np.linalg.norm(rows, axis=0)
    U, s, _ = np.linalg.svd(rows / np.where(size > 0, size, 1.0), full_matrices=False)
    U = U[:, s > RANK * s.max(initial=0.0)]
    e = np.linalg.solve(root, residuals[:, :, None]).reshape(-1)
    return outlying((e - U @ (U.T @ e)).reshape(N, m), U.reshape(N, m, -1))
