"""Exact Gaussian process regression over poses (Cvitanic 2021, eqs. (9)-(11)): covariance functions with one length per
input, hyperparameters by marginal likelihood from several starts, held-out errors and calibrated intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal

import numpy as np
import scipy

from ...results.estimate import half_width
from ...workers.mapped import mapped

Shape = Literal["squared_exponential", "matern_5_2"]


@dataclass(frozen=True)
class KernelInputs:
    """How a pose (d,) becomes coordinates (e,): each input is divided by its scale or mapped to a circle.

    scale (d,): typical lengths, in the units of the inputs. `periodic` (d,): angles [rad] of period 2 pi. Cosine and
    sine of an angle share one length (the scale divides the chord), so that the covariance is periodic too.

    >>> inputs = gt.vibration.KernelInputs(scale=(0.5, 1.0), periodic=(False, True))
    >>> inputs.coordinates(np.array([[1.0, np.pi]])).round(3)  # the angle becomes cosine and sine
    array([[ 2., -1., 0.]])
    """

    scale: tuple[float, ...]
    periodic: tuple[bool, ...]

    def __post_init__(self) -> None:
        if len(self.scale) != len(self.periodic) or not self.scale:
            raise ValueError(
                f"{len(self.scale)} scales and {len(self.periodic)} periods; expected one of each per input"
            )
        if not all(np.isfinite(s) and s > 0 for s in self.scale):
            raise ValueError(f"found the scales {self.scale}; expected finite numbers above zero")

    @property
    def owners(self) -> tuple[int, ...]:
        """Index of the input of each coordinate (e,)."""
        return tuple(i for i, round_ in enumerate(self.periodic) for _ in range(1 + round_))

    def coordinates(self, pose: np.ndarray) -> np.ndarray:
        """Coordinates (n, e) of poses (n, d)."""
        return np.stack([c for i in range(len(self.scale)) for c in self._of(pose[:, i], i, np)], axis=1)

    def symbols(self, pose: Any) -> list[Any]:
        """Coordinates of a CasADi vector (d,): a list of e expressions."""
        import casadi as ca

        return [c for i in range(len(self.scale)) for c in self._of(pose[i], i, ca)]

    def _of(self, x: Any, i: int, lib: Any) -> list[Any]:
        return [lib.cos(x) / self.scale[i], lib.sin(x) / self.scale[i]] if self.periodic[i] else [x / self.scale[i]]


def correlation(r2: np.ndarray, shape: Shape) -> np.ndarray:
    """Correlation at squared scaled distances r2: exp(-r2/2), or Matern 5/2."""
    if shape == "squared_exponential":
        return np.exp(-r2 / 2)
    t = np.sqrt(5 * r2)
    return (1 + t + t * t / 3) * np.exp(-t)


def slope(r2: np.ndarray, shape: Shape) -> np.ndarray:
    """Derivative of correlation() by r2."""
    if shape == "squared_exponential":
        return -np.exp(-r2 / 2) / 2
    t = np.sqrt(5 * r2)
    return -(5 / 6) * (1 + t) * np.exp(-t)


def square_distances(a: np.ndarray, b: np.ndarray, owners: tuple[int, ...]) -> np.ndarray:
    """Squared distances (d, n, m) between coordinates (n, e) and (m, e), summed by input."""
    squares = (a[:, None, :] - b[None, :, :]) ** 2
    return np.stack(
        [squares[:, :, [k for k, o in enumerate(owners) if o == i]].sum(axis=2) for i in range(max(owners) + 1)]
    )


VAGUE = 10.0  # prior standard deviation of the level about the mean, in standard deviations of the data


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """f(pose) with covariance level^2 + amplitude^2 correlation(r), measured at poses X (n, d) as y (n,) with noise.

    r^2 = sum((difference / length)^2) in coordinates of `inputs`; `lengths` (d,) are relative to its scales. `noise`:
    standard deviation of y; `mean`: subtracted first; `level`: of the vague constant. `inflation`: factor on all
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
        """Coordinates of the training poses (n, e), relative to the lengths."""
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
        """Return mean and inflated standard deviation (n,) at poses (n, d), eqs. (10), (11).

        `of`: "field", the process itself, or "measurement", a new measurement with its noise.
        """
        if of not in ("field", "measurement"):
            raise ValueError(f"found of='{of}'; expected 'field' or 'measurement'")
        k = self._covariance(poses)
        v = scipy.linalg.solve_triangular(self.factor, k, lower=True)
        variance = self.level**2 + self.amplitude**2 - (v * v).sum(axis=0)
        variance = np.maximum(variance, 0.0) + (self.noise**2 if of == "measurement" else 0.0)
        return self.mean + k.T @ self.weights, self.inflation * np.sqrt(variance)

    def prediction_interval(self, poses: np.ndarray, level: float = 0.95, *, of: str = "field") -> np.ndarray:
        """Return limits (n, 2) that contain the field, or a measurement of it, with probability `level` in 0 .. 1."""
        mean, std = self.predict(poses, of=of)
        q = quantile(level)
        return np.stack([mean - q * std, mean + q * std], axis=1)

    def leave_one_out(self) -> tuple[np.ndarray, np.ndarray]:
        """Return errors y - prediction (n,) of each measurement from the others, and their inflated standard
        deviations.

        The hyperparameters are those of all data. Source: Rasmussen and Williams 2006, eqs. (5.10)-(5.12).
        """
        inverse = np.diag(scipy.linalg.cho_solve((self.factor, True), np.eye(len(self.y))))
        return self.weights / inverse, self.inflation / np.sqrt(inverse)

    def calibrated(self, errors: np.ndarray, stds: np.ndarray) -> GaussianProcess:
        """Return the process with standard deviations inflated to match held-out errors (n,) with `stds` (n,).

        The factor is the root mean square of errors / stds, at least one. Intervals of a new measurement then have
        their nominal coverage; those of the field have less if it is rougher than the covariance (91.7 % instead of 95
        % for a squared exponential of a Matern 5/2 field, 60 poses; `make proof` prints it).
        """
        size = float(np.sqrt(np.mean((errors / stds) ** 2)))
        return replace(self, inflation=max(1.0, self.inflation * size))

    def _scaled(self, poses: np.ndarray) -> np.ndarray:
        poses = np.asarray(poses, float)
        if poses.ndim != 2 or poses.shape[1] != len(self.inputs.scale):
            raise ValueError(f"poses have the shape {poses.shape}; expected (n, {len(self.inputs.scale)})")
        return self.inputs.coordinates(poses) / self.lengths[list(self.inputs.owners)]

    def _covariance(self, poses: np.ndarray) -> np.ndarray:
        """Covariance between the training poses and others (n, m)."""
        r2 = square_distances(self.coordinates, self._scaled(poses), (0,) * self.coordinates.shape[1])[0]
        return self.level**2 + self.amplitude**2 * correlation(r2, self.shape)


def quantile(level: float) -> float:
    """Standard deviations on either side of the mean that contain probability `level`. Raises ValueError."""
    if not 0 < level < 1:
        raise ValueError(f"the level is {level:g}; expected a probability between 0 and 1, such as 0.95")
    return half_width(level)


def level_of(y: np.ndarray) -> tuple[float, float]:
    """Mean and vague level of measured values, the prior of their process."""
    spread = float(np.std(y))
    return float(np.mean(y)), VAGUE * (spread if spread > 0 else 1.0)


LENGTHS = (0.05, 20.0)  # relative to the scales of the inputs: beyond, an input is noise or has no effect
AMPLITUDES, NOISES = (0.03, 30.0), (1e-3, 3.0)  # relative to the standard deviation of the data
STARTS = 4
FOLDS = 6
SAME = 1e-6  # relative to the scales of the inputs: nearer poses count as one pose
STILL = 1e-7  # relative change of the log likelihood at convergence


@dataclass(frozen=True, eq=False)
class _Problem:
    """Distances (d, n, n), values (p, n) of unit spread, vague level."""

    D: np.ndarray
    Y: np.ndarray
    level: float
    shape: Shape

    def cost(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Negative log marginal likelihood of all values, and its gradient by log (lengths, amplitudes, noises)."""
        d, p, n = len(self.D), *self.Y.shape
        inverse_square = np.exp(-2 * theta[:d])
        r2 = np.tensordot(inverse_square, self.D, 1)
        C, S = correlation(r2, self.shape), slope(r2, self.shape)
        total, gradient = 0.0, np.zeros_like(theta)
        eye = np.eye(n)
        for j, y in enumerate(self.Y):
            a2, s2 = np.exp(2 * theta[d + j]), np.exp(2 * theta[d + p + j])
            try:
                L = scipy.linalg.cho_factor(self.level**2 + a2 * C + s2 * eye, lower=True)
            except scipy.linalg.LinAlgError:
                return 1e25, np.zeros_like(theta)
            inverse = scipy.linalg.cho_solve(L, eye)
            alpha = inverse @ y
            total += y @ alpha / 2 + np.log(np.diag(L[0])).sum() + n * np.log(2 * np.pi) / 2
            W = (inverse - np.outer(alpha, alpha)) / 2  # d cost / dK
            gradient[:d] -= 2 * a2 * inverse_square * np.tensordot(self.D, W * S, 2)
            gradient[d + j] += 2 * a2 * np.sum(W * C)
            gradient[d + p + j] += 2 * s2 * np.trace(W)
        return float(total), gradient


def fit_gaussian_processes(
    X: np.ndarray,
    Y: np.ndarray,
    inputs: KernelInputs,
    *,
    shape: Shape = "squared_exponential",
    starts: int = STARTS,
    seed: int = 0,
    start: np.ndarray | None = None,
) -> tuple[GaussianProcess, ...]:
    """Fit one process for each row of Y (p, n), measured at poses X (n, d); all processes share their lengths.

    Lengths, amplitudes and noises maximise the sum of the log marginal likelihoods. The first of `starts` starts has
    the scales as lengths. `start`: a known optimum from parameters_of() to start from instead. Raises ValueError for
    wrong shapes, or if there are fewer different poses than inputs plus two.

    >>> poses = np.linspace(0.0, 3.0, 12)[:, None]
    >>> inputs = gt.vibration.KernelInputs(scale=(1.0,), periodic=(False,))
    >>> (process,) = gt.vibration.fit_gaussian_processes(poses, np.sin(poses[:, 0]), inputs)
    >>> mean, std = process.predict(np.array([[1.6]]))
    >>> round(float(mean[0]), 2)  # sin(1.6)
    1.0
    """
    X, Y = np.asarray(X, float), np.atleast_2d(np.asarray(Y, float))
    d = len(inputs.scale)
    if X.ndim != 2 or X.shape[1] != d or Y.shape[1] != len(X):
        raise ValueError(f"poses {X.shape} and values {Y.shape} do not fit; expected (n, {d}) and (p, n)")
    if not (np.all(np.isfinite(X)) and np.all(np.isfinite(Y))):
        raise ValueError("a pose or a value is not finite; leave it out")
    count = len(np.unique(_places(X, inputs)))
    if count < d + 2:
        raise ValueError(f"{count} different poses for a process over {d} inputs; measure {d + 2} or more")
    p = len(Y)
    levels = [level_of(y) for y in Y]
    spread = np.array([level / _unit_level() for _, level in levels])
    coordinates = inputs.coordinates(X)
    problem = _Problem(
        square_distances(coordinates, coordinates, inputs.owners),
        (Y - np.array([[mean] for mean, _ in levels])) / spread[:, None],
        _unit_level(),
        shape,
    )
    bounds = [tuple(np.log(b)) for b in [LENGTHS] * d + [AMPLITUDES] * p + [NOISES] * p]
    theta = _best(problem, _starts(d, p, starts, seed) if start is None else [start], bounds)
    lengths = np.exp(theta[:d])
    return tuple(
        GaussianProcess(
            X, y, inputs, shape, lengths, float(spread[j] * np.exp(theta[d + j])),
            float(spread[j] * np.exp(theta[d + p + j])), levels[j][0], levels[j][1],
        )
        for j, y in enumerate(Y)
    )  # fmt: skip


def parameters_of(processes: Sequence[GaussianProcess]) -> np.ndarray:
    """Log (lengths, amplitudes, noises) of processes with shared lengths, relative to their data: a start."""
    spread = np.array([g.level / _unit_level() for g in processes])
    sizes = [[g.amplitude for g in processes], [g.noise for g in processes]]
    return np.log(np.concatenate([processes[0].lengths, *(np.array(s) / spread for s in sizes)]))


def held_out(
    processes: Sequence[GaussianProcess], folds: int = FOLDS, *, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return errors and standard deviations (p, n) of measurements from processes fitted without them.

    Unlike leave_one_out(), hyperparameters are fitted without the held-out data too, starting from those of all data.
    All measurements at one pose are held out together, because a repetition would leak the answer. Folds run in the
    workers of the study or of `gt.workers.using`. Raises ValueError if too few different poses were measured to hold
    out one.

    >>> poses = np.linspace(0.0, 3.0, 12)[:, None]
    >>> inputs = gt.vibration.KernelInputs(scale=(1.0,), periodic=(False,))
    >>> (process,) = gt.vibration.fit_gaussian_processes(poses, np.sin(poses[:, 0]), inputs)
    >>> errors, stds = gt.vibration.held_out([process])
    >>> errors.shape, bool(np.abs(errors).max() < 0.01)
    ((1, 12), True)
    """
    first = processes[0]
    Y = np.stack([g.y for g in processes])
    errors, stds = np.zeros_like(Y), np.zeros_like(Y)
    places = _places(first.X, first.inputs)
    count, least = int(places.max()) + 1, len(first.inputs.scale) + 2
    if count <= least:
        raise ValueError(f"{count} different poses are too few to hold out one; measure {least + 1} or more")
    order = np.random.default_rng(seed).permutation(count)
    start = parameters_of(processes)
    folds = max(min(folds, count), -(-count // (count - least)))
    groups = np.array_split(order, folds)
    parts = [np.concatenate([np.flatnonzero(places == g) for g in group]) for group in groups]
    fold = partial(_predicted_without, first.X, Y, first.inputs, first.shape, start)
    for part, (means, deviations) in zip(parts, mapped(fold, parts), strict=True):
        stds[:, part] = deviations
        errors[:, part] = Y[:, part] - means
    return errors, stds


def _predicted_without(
    X: np.ndarray, Y: np.ndarray, inputs: KernelInputs, shape: Shape, start: np.ndarray, part: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Means and standard deviations (p, k) of the measurements `part` (k,) from processes fitted without them."""
    training = np.setdiff1d(np.arange(len(X)), part)
    fitted = fit_gaussian_processes(X[training], Y[:, training], inputs, shape=shape, start=start)
    predicted = [g.predict(X[part], of="measurement") for g in fitted]
    return np.array([mean for mean, _ in predicted]), np.array([std for _, std in predicted])


def _places(X: np.ndarray, inputs: KernelInputs) -> np.ndarray:
    """Index (n,) of the different pose that each row is, in order of first occurrence."""
    rounded = (inputs.coordinates(X) / SAME).round()
    first, inverse = np.unique(rounded, axis=0, return_index=True, return_inverse=True)[1:]
    rank = np.empty(len(first), int)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse.ravel()]


def _unit_level() -> float:
    return level_of(np.array([-1.0, 1.0]))[1]


def _starts(d: int, p: int, count: int, seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    first = np.concatenate([np.zeros(d), np.zeros(p), np.full(p, np.log(0.2))])
    others = [
        np.concatenate([rng.uniform(-1.5, 1.5, d), np.zeros(p), np.log(rng.uniform(0.05, 0.7, p))])
        for _ in range(count - 1)
    ]
    return [first, *others]


def _best(problem: _Problem, starts: Sequence[np.ndarray], bounds: list[tuple[float, float]]) -> np.ndarray:
    low, high = np.array(bounds).T
    optima = [
        scipy.optimize.minimize(problem.cost, np.clip(start, low, high), jac=True, bounds=bounds, method="L-BFGS-B",
                 options={"maxiter": 200, "ftol": STILL})
        for start in starts
    ]  # fmt: skip
    return min(optima, key=lambda r: r.fun).x
