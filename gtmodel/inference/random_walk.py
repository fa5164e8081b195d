"""Linear least squares of readings whose bias performs a random walk, with its size estimated from the readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..results.estimate import Estimate
from ..results.refusal import ArgumentError

POINTS, ZOOMS = 9, 3  # sizes of the walk over the noise, per channel, and refinements of this grid
TAIL = 1.0  # of the prior: 1 for a half-Cauchy distribution; with 0, intervals of the last bias are too narrow
NEGLIGIBLE = 1e-4  # weight of a size that a refinement leaves out
SLOWEST, FASTEST = 0.1, 1e3  # variance of the whole walk over that of a mean; of a step over that of a reading


@dataclass(frozen=True, eq=False)
class RandomWalkFit:
    """A fit of readings (n, c) whose biases perform random walks, independent in each channel.

    estimate: of the parameters. A bias is that at the last reading. density: of the walks (c,), in the readings' unit
    over the root of the unit of time, and noise: standard deviation of a reading, both where the likelihood is largest.
    time (n,).
    """

    estimate: Estimate
    density: np.ndarray
    noise: float
    time: np.ndarray

    def covariance(self) -> np.ndarray:
        """Return the covariance (c, n, n) of the readings of each channel, relative to the last one."""
        return self.density[:, None, None] ** 2 * _walk(self.time) + self.noise**2 * np.eye(len(self.time))

    def white(self, rows: np.ndarray) -> np.ndarray:
        """Return rows (n, c) or (n, c, k) whitened in the order of time: independent, with variance 1."""
        roots = np.linalg.cholesky(self.covariance())
        parts = [scipy.linalg.solve_triangular(L, rows[:, c], lower=True) for c, L in enumerate(roots)]
        return np.stack(parts, axis=1)

    def bound(self, J: np.ndarray) -> np.ndarray:
        """Return the least standard deviations (p,) of any unbiased estimate with regressor J (n, c, p) (Cramer and
        Rao), for the estimated walk and noise."""
        A = self.white(J).reshape(-1, J.shape[2])
        return np.sqrt(np.diag(np.linalg.inv(A.T @ A)))


def random_walk_fit(
    J: np.ndarray, values: np.ndarray, time: np.ndarray, names: Sequence[str], *, sigma: float | None = None,
    units: Sequence[str] = (),
) -> RandomWalkFit:  # fmt: skip
    """Fit values (n, c) = J x + walk + white noise, by generalised least squares.

    Args:
        J: (n, c, p), with a column for the bias of each channel. time: (n,), increasing.
        sigma: standard deviation of the noise; by default from the readings.

    The ratio of the walk to the noise is not known. The estimate is the mean over a grid of ratios, one for each
    channel, each weighted by its restricted likelihood (Patterson and Thompson 1971, Biometrika 58) and by a prior that
    is flat in its logarithm up to steps as large as the noise, and falls beyond as that of a half-Cauchy distribution
    of the step (Gelman 2006, Bayesian Analysis 1); the covariance includes the scatter of the estimates over
    the grid. Intervals are those of
    Student's t with the variance and the kurtosis of this mixture. Raises
    ArgumentError if there are too few readings, or if they do not determine a parameter.

    >>> rng = np.random.default_rng(1)  # synthetic: seed 1
    >>> time, x = np.arange(200.0), rng.normal(size=200)
    >>> walk = 0.05 * np.cumsum(rng.normal(size=200))
    >>> y = 3.0 * x + walk + 0.1 * rng.normal(size=200)
    >>> J = np.column_stack([np.ones(200), x])[:, None, :]
    >>> fit = gt.inference.random_walk_fit(J, y[:, None], time, ["bias", "slope"])
    >>> fit.estimate.values[1].round(2), fit.density.round(2), round(fit.noise, 2)
    (np.float64(3.01), array([0.04]), 0.1)
    """
    n, channels, p = J.shape
    count = values.size
    if count <= p + channels:
        raise ArgumentError(f"{count} readings are too few for {p} parameters and a random walk", "values")
    step = float(np.median(np.diff(time)))
    level, U = np.linalg.eigh(_walk(time) / step)
    level = np.maximum(level, 0.0)
    rows = np.einsum("tm,tck->mck", U, np.concatenate([J, values[:, :, None]], axis=2))
    scale = np.linalg.norm(rows[:, :, :p], axis=(0, 1))
    if not np.all(scale > 0) or np.linalg.matrix_rank(rows[:, :, :p].reshape(count, p) / scale) < p:
        raise ArgumentError("the readings do not determine all parameters", "J")
    rows = rows / np.append(scale, 1.0)
    low, high = np.full(channels, np.log(SLOWEST / n**2)), np.full(channels, np.log(FASTEST))
    weight, axes = np.ones(1), np.zeros((channels, 1))
    g = _Grid.over(rows, level, axes, sigma)
    for _ in range(ZOOMS):
        axes = np.linspace(low, high, POINTS, axis=1)  # (c, points)
        g = _Grid.over(rows, level, axes, sigma)
        weight = np.exp(g.likelihood - g.likelihood.max())
        weight /= weight.sum()
        for c in range(channels):
            each = np.bincount(g.place[c], weight, POINTS)
            used = np.flatnonzero(each > NEGLIGIBLE)
            low[c], high[c] = axes[c, max(used[0] - 1, 0)], axes[c, min(used[-1] + 1, POINTS - 1)]
    mean = weight @ g.x
    apart = g.x - mean
    own = np.einsum("g,gij->ij", weight, g.covariance)
    covariance = own + np.einsum("g,gi,gj->ij", weight, apart, apart)
    variances = np.einsum("gii->gi", g.covariance) / np.diag(own)
    spread = float(np.max(weight @ (variances - 1) ** 2)) + (0.0 if sigma is not None else 2.0 / (count - p))
    degrees_of_freedom = min(4.0 + 2.0 / spread, float(count - p)) if spread > 0 else float(count - p)
    covariance = covariance * (degrees_of_freedom - 2) / degrees_of_freedom / np.outer(scale, scale)
    best = int(np.argmax(weight))
    noise = float(np.sqrt(g.noise[best]))
    ratio = np.exp([axes[c, k] for c, k in enumerate(g.place[:, best])])
    mean = mean / scale
    estimate = Estimate(
        tuple(names), mean, (covariance + covariance.T) / 2, degrees_of_freedom, noise, False,
        (values - J @ mean).reshape(-1),
        (), units=tuple(units),
    )  # fmt: skip
    return RandomWalkFit(estimate, noise * np.sqrt(ratio / step), noise, np.asarray(time, float))


@dataclass(frozen=True, eq=False)
class _Grid:
    """Fits for all combinations of ratios (g): `place` (c, g) of the ratio of each channel, logarithm of the restricted
    `likelihood` (g,), estimate `x` (g, p), its `covariance` (g, p, p), and variance of the `noise` (g,)."""

    place: np.ndarray
    likelihood: np.ndarray
    x: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray

    @classmethod
    def over(cls, rows: np.ndarray, level: np.ndarray, logs: np.ndarray, sigma: float | None) -> _Grid:
        """rows (n, c, p + 1): regressor and values in the axes of the eigenvalues `level` (n,) of the walk."""
        channels, points = logs.shape
        p = rows.shape[2] - 1
        variance = 1 + np.exp(logs)[:, :, None] * level  # (c, points, n)
        grams = np.einsum("mci,cgm,mcj->cgij", rows, 1 / variance, rows, optimize=True)
        place = np.indices((points,) * channels).reshape(channels, -1)
        gram = np.sum([grams[c][place[c]] for c in range(channels)], axis=0)
        inverse = np.linalg.inv(gram[:, :p, :p])
        x = np.einsum("gij,gj->gi", inverse, gram[:, :p, p])
        squares = np.maximum(gram[:, p, p] - np.einsum("gi,gi->g", x, gram[:, :p, p]), np.finfo(float).tiny)
        lost = np.log(variance).sum(axis=2)[np.arange(channels)[:, None], place].sum(axis=0)
        lost = lost + TAIL * np.log1p(np.exp(logs))[np.arange(channels)[:, None], place].sum(axis=0)
        likelihood = -0.5 * (lost + np.linalg.slogdet(gram[:, :p, :p])[1])
        spare = rows.shape[0] * channels - p
        noise = squares / spare if sigma is None else np.full(len(squares), sigma**2)
        likelihood = likelihood - (0.5 * spare * np.log(squares) if sigma is None else 0.5 * squares / sigma**2)
        return cls(place, likelihood, x, noise[:, None, None] * inverse, noise)


def _walk(time: np.ndarray) -> np.ndarray:
    """Covariance (n, n) of a random walk relative to its value at the last time, for unit density."""
    back = time[-1] - time
    return np.minimum(back[:, None], back)
