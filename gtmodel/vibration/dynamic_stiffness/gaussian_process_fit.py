"""Hyperparameters by marginal likelihood from several starts, and errors of what was held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.optimize import minimize

from .gaussian_process import GaussianProcess, level_of
from .gaussian_process_kernel import KernelInputs, Shape, correlation, slope, square_distances

LENGTHS = (0.05, 20.0)  # in units of the inputs' scales: beyond, an input is noise or without effect
AMPLITUDES, NOISES = (0.03, 30.0), (1e-3, 3.0)  # in units of the standard deviation of the data
STARTS = 4
FOLDS = 6
SAME = 1e-6  # in units of the inputs' scales: poses nearer are one pose, measured again
STILL = 1e-7  # change of the log likelihood, relative: converged


@dataclass(frozen=True, eq=False)
class _Problem:
    """Distances (d, n, n), values (p, n) of unit spread, vague level."""

    D: np.ndarray
    Y: np.ndarray
    level: float
    shape: Shape

    def cost(self, theta: np.ndarray) -> tuple[float, np.ndarray]:
        """Negative log marginal likelihood of all values and its gradient by log (lengths, amplitudes, noises)."""
        d, p, n = len(self.D), *self.Y.shape
        inverse_square = np.exp(-2 * theta[:d])
        r2 = np.tensordot(inverse_square, self.D, 1)
        C, S = correlation(r2, self.shape), slope(r2, self.shape)
        total, gradient = 0.0, np.zeros_like(theta)
        eye = np.eye(n)
        for j, y in enumerate(self.Y):
            a2, s2 = np.exp(2 * theta[d + j]), np.exp(2 * theta[d + p + j])
            try:
                L = cho_factor(self.level**2 + a2 * C + s2 * eye, lower=True)
            except LinAlgError:
                return 1e25, np.zeros_like(theta)
            inverse = cho_solve(L, eye)
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
    """One process for each row of Y (p, n), measured at poses X (n, d); all of them share their lengths.

    Lengths, amplitudes and noises maximise the sum of the log marginal likelihoods, from `starts` starts of which the
    first has lengths of one scale; `start`: log of a known optimum instead, as parameters_of() gives it.
    Raises ValueError for wrong shapes, or fewer different poses than inputs and two more.

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
    different = len(np.unique(_places(X, inputs)))
    if different < d + 2:
        raise ValueError(f"{different} different poses for a process over {d} inputs; measure {d + 2} or more")
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
    """Log (lengths, amplitudes, noises) of processes with shared lengths, in units of their data: a start."""
    spread = np.array([g.level / _unit_level() for g in processes])
    sizes = [[g.amplitude for g in processes], [g.noise for g in processes]]
    return np.log(np.concatenate([processes[0].lengths, *(np.array(s) / spread for s in sizes)]))


def held_out(
    processes: Sequence[GaussianProcess], folds: int = FOLDS, *, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Errors and standard deviations (p, n) of measurements from processes fitted without them.

    Unlike leave_one_out() the hyperparameters have not seen them either: they are fitted anew, from those of all data.
    What was measured at one pose is held out together: a repetition would give the answer away. Raises ValueError where
    so few different poses were measured that none can be spared.

    >>> poses = np.linspace(0.0, 3.0, 12)[:, None]
    >>> inputs = gt.vibration.KernelInputs(scale=(1.0,), periodic=(False,))
    >>> (process,) = gt.vibration.fit_gaussian_processes(poses, np.sin(poses[:, 0]), inputs)
    >>> errors, stds = gt.vibration.held_out([process])
    >>> errors.shape, bool(np.abs(errors).max() < 0.01)
    ((1, 12), True)
    """
    first = processes[0]
    n = len(first.y)
    Y = np.stack([g.y for g in processes])
    errors, stds = np.zeros_like(Y), np.zeros_like(Y)
    places = _places(first.X, first.inputs)
    count, least = int(places.max()) + 1, len(first.inputs.scale) + 2
    if count <= least:
        raise ValueError(f"{count} different poses, and none to hold out; measure {least + 1} or more")
    order = np.random.default_rng(seed).permutation(count)
    start = parameters_of(processes)
    folds = max(min(folds, count), -(-count // (count - least)))
    for group in np.array_split(order, folds):
        part = np.concatenate([np.flatnonzero(places == g) for g in group])
        kept = np.setdiff1d(np.arange(n), part)
        fitted = fit_gaussian_processes(first.X[kept], Y[:, kept], first.inputs, shape=first.shape, start=start)
        for j, g in enumerate(fitted):
            mean, std = g.predict(first.X[part], of="measurement")
            errors[j, part], stds[j, part] = Y[j, part] - mean, std
    return errors, stds


def _places(X: np.ndarray, inputs: KernelInputs) -> np.ndarray:
    """Number (n,) of the different pose that each pose is, in the order in which they first stand there."""
    rounded = (inputs.coordinates(X) / SAME).round()
    first, own = np.unique(rounded, axis=0, return_index=True, return_inverse=True)[1:]
    rank = np.empty(len(first), int)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[own.ravel()]


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
        minimize(problem.cost, np.clip(start, low, high), jac=True, bounds=bounds, method="L-BFGS-B",
                 options={"maxiter": 200, "ftol": STILL})
        for start in starts
    ]  # fmt: skip
    return min(optima, key=lambda r: r.fun).x
