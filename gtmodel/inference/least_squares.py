"""Linear weighted least squares with bounds and priors, and the covariance of the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..results.estimate import Estimate
from ..results.refusal import ArgumentError
from .covariance import RANK, freedom_left, moved_together, scales, spectrum
from .weighting import Prior, prior_rows, weighting

# with priors and unknown noise, the fit and the noise depend on each other: iterate until the noise changes by less
NOISE_STILL, NOISE_ROUNDS = 1e-10, 100
# a parameter is at a bound if it is no further from it than this share of its scale
AT_BOUND = 1e-9
PART = 1e-8  # of a null direction of length one in scaled units: smaller entries are round-off
BVLS = 1e-15  # tolerance of lsq_linear: its active set, not this, ends the iteration


def linear_fit(
    A: ArrayLike,
    b: ArrayLike,
    names: Sequence[str],
    *,
    scale: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Sequence[Prior] = (),
    units: Sequence[str] = (),
    hold_undetermined: bool = False,
    rank_tolerance: float = RANK,
) -> Estimate:
    """Solve the linear least-squares problem A x = b; return x as an Estimate with its covariance.

    A (rows, n), b (rows,), and n `names`. The noise is given by one of sigma, weights and covariance, see weighting();
    with weights, or none of the three, the residuals determine it. `scale` (n,) is the nominal or expected size of each
    parameter; it affects the rank, not the result (missing or zero: from the norm of the column). `bounds` maps name ->
    (low, high); a parameter at a bound is `held` there and not in the covariance. `priors` act as additional
    measurements. `units`, one per name, are for printing.

    Undetermined parameters raise an error that names them; with `hold_undetermined` they take the solution of least
    norm in units of the scales, and the Estimate has a note. Raises ArgumentError for undetermined parameters, wrong
    shapes, values that are not finite, or too few rows.

    >>> time, position = np.array([0.0, 1.0, 2.0, 3.0]), np.array([1.0, 3.0, 5.1, 6.9])
    >>> A = np.column_stack([np.ones(4), time])
    >>> e = gt.inference.linear_fit(A, position, ["start", "speed"], sigma=0.1, units=["m", "m/s"])
    >>> e.values.round(3), e.std.round(3)
    (array([1.03, 1.98]), array([0.084, 0.045]))
    >>> known = gt.inference.Prior("start", 1.0, std=0.01)
    >>> gt.inference.linear_fit(A, position, ["start", "speed"], sigma=0.1, priors=[known]).std.round(3)
    array([0.01 , 0.027])
    """
    A, b = np.asarray(A, float), np.asarray(b, float).reshape(-1)
    names, priors = tuple(names), tuple(priors)
    _check(A, b, names)
    w = weighting(len(b), sigma=sigma, weights=weights, covariance=covariance)
    Aw, bw = w(A), w(b)
    size = scales(None if scale is None else np.asarray(scale, float), len(names), Aw)
    low, high = limits(bounds or {}, names)
    P, p = prior_rows(priors, names)
    noise = 1.0
    for _ in range(NOISE_ROUNDS):
        x = _solve(np.vstack([Aw, noise * P]) * size, np.concatenate([bw, noise * p]), low / size, high / size,
                   rank_tolerance) * size  # fmt: skip
        near = AT_BOUND * size
        free = (x > low + near) & (x < high - near)
        before = noise
        worth = fit_worth(
            Aw, names, size, free, P, w.known, units=tuple(units), prior_noise=noise,
            hold_undetermined=hold_undetermined, rank_tolerance=rank_tolerance,
        )  # fmt: skip
        estimate = worth.estimate(x, bw - Aw @ x)
        noise = estimate.noise
        if w.known or not priors or abs(noise - before) <= NOISE_STILL * noise:
            break
    return estimate  # pyrefly: ignore[unbound-name]


def linear_fits(
    A: ArrayLike, b: ArrayLike, names: Sequence[str], *, scale: ArrayLike | None = None, rank_tolerance: float = RANK
) -> list[Estimate]:
    """Solve many linear fits with the same A; return the Estimates of `linear_fit(A, row, names, scale=scale)`.

    A (rows, n), b (fits, rows). A is factored once, so a fit costs little more than a product with it; this is for
    repeated synthetic experiments. The residuals of each fit determine its noise. Raises ArgumentError as linear_fit().

    >>> time = np.linspace(0.0, 3.0, 20)
    >>> A = np.column_stack([np.ones(20), time])
    >>> noisy = A @ [1.0, 2.0] + 0.1 * np.random.default_rng(1).normal(size=(50, 20))  # synthetic
    >>> fits = gt.inference.linear_fits(A, noisy, ["start", "speed"])
    >>> len(fits), np.mean([e.value("speed") for e in fits]).round(1)
    (50, np.float64(2.0))
    """
    A, b, names = np.asarray(A, float), np.asarray(b, float), tuple(names)
    if b.ndim != 2:
        raise ArgumentError(f"b has the shape {b.shape}; expected (fits, rows), a row per fit")
    if not len(b):
        return []
    _check(A, b.T, names)
    size = scales(None if scale is None else np.asarray(scale, float), len(names), A)
    x = np.linalg.lstsq(A * size, b.T, rcond=rank_tolerance)[0].T * size
    worth = fit_worth(A, names, size, np.ones(len(names), bool), np.zeros((0, len(names))), False,
                      rank_tolerance=rank_tolerance)  # fmt: skip
    residuals = b - x @ A.T
    return [worth.estimate(values, r) for values, r in zip(x, residuals, strict=True)]


@dataclass(frozen=True, eq=False)
class FitWorth:
    """Parts of an Estimate that depend only on the Jacobian, not on values and residuals.

    free: positions of the parameters that are not held. inverse: inverse of their information matrix from whitened rows
    (free, free). The other fields are as in Estimate.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    free: np.ndarray
    inverse: np.ndarray
    degrees_of_freedom: float
    known: bool
    notes: tuple[str, ...]
    null_space: np.ndarray

    def estimate(self, x: np.ndarray, r: np.ndarray) -> Estimate:
        """Return the Estimate at an optimum x (n,) with whitened residuals r (rows,)."""
        kept, dof = self.free, self.degrees_of_freedom
        held = np.setdiff1d(np.arange(len(self.names)), kept)
        noise = float(np.sqrt(r @ r / dof)) if dof else 1.0
        cov = self.inverse * (1.0 if self.known else noise**2)
        return Estimate(
            tuple(self.names[k] for k in kept), x[kept], (cov + cov.T) / 2, dof, noise, self.known, r,
            tuple(self.names[k] for k in held), held_values=tuple(float(x[k]) for k in held),
            units=tuple(self.units[k] for k in kept) if self.units else (), notes=self.notes,
            null_space=self.null_space,
        )  # fmt: skip


def fit_worth(
    J: np.ndarray,
    names: tuple[str, ...],
    scale: np.ndarray,
    free: np.ndarray,
    P: np.ndarray,
    known: bool,
    *,
    units: tuple[str, ...] = (),
    prior_noise: float = 1.0,
    hold_undetermined: bool = False,
    rank_tolerance: float = RANK,
) -> FitWorth:
    """Information of the whitened Jacobian J (rows, n) at an optimum.

    free: mask (n,) of the parameters that are not held. P: whitened prior rows (k, n); times `prior_noise` they are in
    units of the residuals. Raises ArgumentError for too few rows, and for undetermined parameters unless
    `hold_undetermined`.
    """
    kept = np.flatnonzero(free)
    kept_names = tuple(names[k] for k in kept)
    data, size = J[:, kept] * scale[kept], scale[kept]
    s = spectrum(np.vstack([data, prior_noise * P[:, kept] * size]), rank_tolerance)
    null = moved_together(s.null, kept_names)
    if null and not hold_undetermined:
        raise ArgumentError("; ".join(null))
    degrees_of_freedom = freedom_left(len(J), data, s.inverse)
    if degrees_of_freedom < 0 or (degrees_of_freedom == 0 and not known):
        raise ArgumentError(f"{len(J)} measured values for {len(kept)} unknowns; measure more, or give sigma")
    null_space = np.where(np.abs(s.null) > PART, s.null, 0.0) * size[:, None] if null else np.zeros((0, 0))
    return FitWorth(
        names, units, kept, s.inverse * np.outer(size, size), degrees_of_freedom, known, tuple(null), null_space
    )


def _solve(A: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray, tolerance: float) -> np.ndarray:
    """Minimum-norm solution within the bounds; A has scaled columns."""
    x = np.linalg.lstsq(A, b, rcond=tolerance)[0]
    if np.all(x >= low) and np.all(x <= high):
        return x
    # lsq_linear refuses equal bounds: fix these parameters here
    fixed = low == high
    x = np.where(fixed, low, 0.0)
    if not fixed.all():
        rest = A[:, ~fixed]
        # bvls ends with the exact active set; it needs full rank, which a ridge of round-off size gives
        if np.linalg.matrix_rank(rest, tol=tolerance * np.linalg.norm(rest, 2)) < rest.shape[1]:
            ridge = tolerance * np.linalg.norm(rest, 2) * np.eye(rest.shape[1])
            rest, right = np.vstack([rest, ridge]), np.concatenate([b - A @ x, np.zeros(rest.shape[1])])
        else:
            right = b - A @ x
        if len(rest) > rest.shape[1]:
            Q, R = np.linalg.qr(rest)
            rest, right = R, Q.T @ right
        import scipy  # here, since readers of logs import this module without fitting

        x[~fixed] = scipy.optimize.lsq_linear(rest, right, (low[~fixed], high[~fixed]), method="bvls", tol=BVLS).x
    return x


def limits(bounds: Mapping[str, tuple[float, float]], names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds (n,) of the names, infinite without a bound. Raises ArgumentError."""
    unknown = [n for n in bounds if n not in names]
    if unknown:
        raise ArgumentError(f"bounds name '{unknown[0]}', which is not free; expected one of {', '.join(names)}")
    pairs = [bounds.get(n, (-np.inf, np.inf)) for n in names]
    for name, (low, high) in zip(names, pairs, strict=True):
        if not low <= high:
            raise ArgumentError(f"the bounds of '{name}' are {low:g} and {high:g}; expected low <= high")
    return np.array([p[0] for p in pairs], float), np.array([p[1] for p in pairs], float)


def _check(A: np.ndarray, b: np.ndarray, names: tuple[str, ...]) -> None:
    if A.shape != (len(b), len(names)):
        raise ArgumentError(f"A has the shape {A.shape}; expected ({len(b)}, {len(names)}), a row per measured value, "
                         "a column per name")  # fmt: skip
    if len(set(names)) < len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise ArgumentError(f"'{twice}' names two parameters; give each its own name")
    for what, values in (("A", A), ("b", b)):
        if not np.all(np.isfinite(values)):
            row = int(np.argwhere(~np.isfinite(values))[0, 0])
            raise ArgumentError(f"{what} is not finite in row {row}; remove the row or correct the data")
