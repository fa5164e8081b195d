"""Exact Gaussian process regression (Cvitanic 2021, eqs. (9)-(11)), held-out errors and calibrated intervals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from ...results.estimate import half_width
from .gaussian_process_kernel import KernelInputs, Shape, correlation, square_distances

VAGUE = 10.0  # standard deviations of the data: how far the level of the process may lie from their mean


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """f(pose) with covariance level^2 + amplitude^2 correlation(r), seen at poses X (n, d) as y (n,) with noise.

    r^2 = sum((difference / length)^2) in coordinates of `inputs`; `lengths` (d,) in units of its scales. `noise`:
    standard deviation of y, `mean`: taken off beforehand, `level`: of the vague constant. `inflation`: factor on all
    standard deviations of predictions, see calibrated().
    """

    X: np.ndarray
    y: np.ndarray
    inputs: KernelInputs
    shape: Shape
    lengths: np.ndarray
    amplitude: float
    noise: float
    mean: float
    level: float
    inflation: float = 1.0

    @cached_property
    def coordinates(self) -> np.ndarray:
        """Of the training poses (n, e), in units of the lengths."""
        return self._scaled(self.X)

    @cached_property
    def factor(self) -> np.ndarray:
        """Lower Cholesky factor of the covariance of y (n, n)."""
        K = self._covariance(self.X) + self.noise**2 * np.eye(len(self.y))
        return np.tril(scipy.linalg.cho_factor(K, lower=True)[0])

    @cached_property
    def weights(self) -> np.ndarray:
        """alpha = K^-1 (y - mean) (n,): the prediction is mean + k(pose)' alpha."""
        return scipy.linalg.cho_solve((self.factor, True), self.y - self.mean)

    @property
    def likelihood(self) -> float:
        """Logarithm of the marginal likelihood of y."""
        r = self.y - self.mean
        return float(-r @ self.weights / 2 - np.log(np.diag(self.factor)).sum() - len(r) * np.log(2 * np.pi) / 2)

    def predict(self, poses: np.ndarray, *, of: str = "field") -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (n,) each at poses (n, d), eqs. (10), (11), inflated.

        `of`: "field", the process itself, or "measurement", a new one of it with its noise.
        """
        if of not in ("field", "measurement"):
            raise ValueError(f"found of='{of}'; expected 'field' or 'measurement'")
        k = self._covariance(poses)
        v = scipy.linalg.solve_triangular(self.factor, k, lower=True)
        variance = self.level**2 + self.amplitude**2 - (v * v).sum(axis=0)
        variance = np.maximum(variance, 0.0) + (self.noise**2 if of == "measurement" else 0.0)
        return self.mean + k.T @ self.weights, self.inflation * np.sqrt(variance)

    def prediction_interval(self, poses: np.ndarray, level: float = 0.95, *, of: str = "field") -> np.ndarray:
        """Limits (n, 2) that hold the field, or a measurement of it, with probability `level` in 0 .. 1."""
        mean, std = self.predict(poses, of=of)
        q = quantile(level)
        return np.stack([mean - q * std, mean + q * std], axis=1)

    def leave_one_out(self) -> tuple[np.ndarray, np.ndarray]:
        """Errors y - prediction (n,) of each measurement from the others, and their standard deviations, inflated.

        Hyperparameters stay those of all. Source: Rasmussen and Williams 2006, eqs. (5.10)-(5.12).
        """
        inverse = np.diag(scipy.linalg.cho_solve((self.factor, True), np.eye(len(self.y))))
        return self.weights / inverse, self.inflation / np.sqrt(inverse)

    def calibrated(self, errors: np.ndarray, stds: np.ndarray) -> GaussianProcess:
        """With standard deviations so much larger that held-out errors (n,) are as large as their `stds` say.

        The factor is the root mean square of errors / stds, never below one. Intervals of a new measurement then hold
        as often as they say; those of the field less often where it is rougher than the covariance (91.7 % instead of
        95 % for a squared exponential of a Matern 5/2 field, 60 poses; `make proof` prints it).
        """
        size = float(np.sqrt(np.mean((errors / stds) ** 2)))
        return replace(self, inflation=max(1.0, self.inflation * size))

    def _scaled(self, poses: np.ndarray) -> np.ndarray:
        poses = np.asarray(poses, float)
        if poses.ndim != 2 or poses.shape[1] != len(self.inputs.scale):
            raise ValueError(f"poses have the shape {poses.shape}; expected (n, {len(self.inputs.scale)})")
        return self.inputs.coordinates(poses) / self.lengths[list(self.inputs.owners)]

    def _covariance(self, poses: np.ndarray) -> np.ndarray:
        """Between the training poses and others (n, m)."""
        r2 = square_distances(self.coordinates, self._scaled(poses), (0,) * self.coordinates.shape[1])[0]
        return self.level**2 + self.amplitude**2 * correlation(r2, self.shape)


def quantile(level: float) -> float:
    """Standard deviations on either side of the mean that hold it with probability `level`. Raises ValueError."""
    if not 0 < level < 1:
        raise ValueError(f"the level is {level:g}; expected a probability between 0 and 1, such as 0.95")
    return half_width(level)


def level_of(y: np.ndarray) -> tuple[float, float]:
    """Mean and vague level of measured values: what every process of them starts from."""
    spread = float(np.std(y))
    return float(np.mean(y)), VAGUE * (spread if spread > 0 else 1.0)
