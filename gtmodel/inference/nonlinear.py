"""Nonlinear least squares: Gauss-Newton with the exact Jacobian and Levenberg-Marquardt damping, with rows in
pieces."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from ..results.estimate import Estimate
from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from .covariance import RANK, scales
from .descent import Descent, DescentStep, minimised
from .least_squares import AT_BOUND, fit_worth, limits
from .weighting import Loss, Prior, loss_named, prior_rows, weighting

# pieces (rows, n + 1) of whitened rows [J r] at x; called repeatedly, one piece in memory at a time
Pieces = Callable[[np.ndarray], Iterable[np.ndarray]]

# largest condition of a scaled Jacobian for normal equations, which leave eight digits of a step; beyond, QR in pieces
CONDITION = 1e4


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums over all rows A = [J r] at x, weighted by the loss: `cost`, and `matrix`, A'A (n + 1, n + 1) or R with
    R'R = A'A."""

    matrix: np.ndarray
    cost: float
    triangular: bool

    @property
    def finite(self) -> bool:
        return math.isfinite(self.cost) and math.isfinite(float(self.matrix.sum()))


@dataclass(frozen=True, eq=False)
class Directions:
    """Singular values (k,) of the scaled Jacobian, largest first, right vectors V (n, k), and U'r (k,), |r|."""

    singular: np.ndarray
    V: np.ndarray
    projected: np.ndarray
    size: float


def sums(pieces: Iterable[np.ndarray], loss: Loss, width: float, *, triangular: bool) -> Sums:
    """Sums over the pieces, by QR if `triangular`."""
    matrix, cost = np.zeros((0, 0)), 0.0
    with np.errstate(all="ignore"):  # values that are not finite show in the sums
        for A in pieces:
            rows = A
            if not loss.squares:
                cost += loss.cost(A[:, -1], width)
                rows = A * loss.weight(A[:, -1], width)[:, None]
            more = triangle(matrix, rows) if triangular else rows.T @ rows
            matrix = more if triangular or not len(matrix) else matrix + more
        if loss.squares and len(matrix):
            cost = 0.5 * float(matrix[:, -1] @ matrix[:, -1] if triangular else matrix[-1, -1])
    return Sums(matrix, cost, triangular)


def triangle(R: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """QR factor of R (empty at first) with further rows below it; over all pieces this is the factor of all rows."""
    return np.asarray(np.linalg.qr(np.vstack([R, rows]) if len(R) else rows, mode="r"))


def directions(s: Sums, size: np.ndarray, prior: np.ndarray) -> Directions | None:
    """Directions from sums and prior rows (k, n + 1), with columns in units of `size` (n + 1,), whose last entry is 1.

    None if the normal equations are not accurate enough.
    """
    if s.triangular:
        R = s.matrix * size
        R = np.vstack([R, prior * size]) if len(prior) else R
        U, singular, Vt = np.linalg.svd(R[:, :-1], full_matrices=False)
        return Directions(singular, Vt.T, U.T @ R[:, -1], norm(R[:, -1]))
    G = s.matrix + prior.T @ prior if len(prior) else s.matrix
    G = G * size * size[:, None]
    values, V = np.linalg.eigh(G[:-1, :-1])
    if not values[0] * CONDITION**2 > values[-1]:
        return None
    singular, V = np.sqrt(values[::-1]), V[:, ::-1]
    return Directions(singular, V, V.T @ G[:-1, -1] / singular, math.sqrt(G[-1, -1]))


def norm(v: np.ndarray) -> float:
    """Euclidean norm of a vector; three times as fast as NumPy's general function."""
    return math.sqrt(float(v @ v))


Residuals = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

SLOPE = 1e-6  # relative step of central differences: errors of 1e-12 by truncation, 1e-10 by round-off
# first damping over the squared smallest singular value, both relative to the largest; more would slow weak directions
DAMPING = 0.1


@dataclass(frozen=True, eq=False)
class NonlinearFit(Descent):
    """Result of the iteration with whitened residuals `r` (rows,) and Jacobian `J` (rows, n), and the `estimate`; None
    unless solved."""

    x: np.ndarray
    r: np.ndarray
    J: np.ndarray
    estimate: Estimate | None = None


def nonlinear_fit(
    residuals: Residuals,
    start: ArrayLike,
    names: Sequence[str],
    *,
    scale: ArrayLike | None = None,
    sigma: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Sequence[Prior] = (),
    loss: str = "linear",
    width: float = 1.0,
    units: Sequence[str] = (),
    hold_undetermined: bool = False,
    rank_tolerance: float = RANK,
    limit: int = 200,
) -> NonlinearFit:
    """Find the x (n,) that minimises half the sum of squares of the whitened residuals.

    `residuals(x)` returns r (rows,), in their own unit and not whitened, and the Jacobian dr/dx (rows, n). `start` (n,)
    is the initial guess, `limit` the largest number of steps. Noise, bounds, priors, scales and undetermined parameters
    are treated as in linear_fit(); priors need a known noise (sigma or covariance). `loss` of the whitened residuals is
    linear, huber, soft_l1 or cauchy as in scipy, with its `width`; the covariance is then Huber's.

    The sign of r does not matter if its Jacobian has the same sign. Raises ArgumentError for shapes that do not match;
    a failed iteration has its `status`, and `estimate` is then None.

    >>> time = np.linspace(0.0, 1.0, 50)
    >>> measured = 2.0 * np.exp(-3.0 * time)
    >>> def residuals(x):
    ...     decay = np.exp(-x[1] * time)
    ...     return x[0] * decay - measured, np.column_stack([decay, -x[0] * time * decay])
    >>> fit = gt.inference.nonlinear_fit(residuals, [1.0, 1.0], ["size", "rate"], sigma=0.05)
    >>> fit.status.ok, fit.estimate.values.round(6), fit.estimate.std.round(2)
    (True, array([2., 3.]), array([0.02, 0.05]))
    """
    x, names, priors = np.asarray(start, float).reshape(-1), tuple(names), tuple(priors)
    if len(names) != len(x):
        raise ArgumentError(f"expected as many names as starting values, {len(x)}; found {len(names)}")
    r, J = (np.asarray(a, float) for a in residuals(x))
    if J.shape != (len(r), len(x)):
        raise ArgumentError(f"the derivatives have the shape {J.shape}; expected ({len(r)}, {len(x)})")
    w = weighting(len(r), sigma=sigma, weights=weights, covariance=covariance)
    if priors and not w.known:
        raise ArgumentError("priors need a known noise for their weight: give sigma or covariance")
    size = scales(None if scale is None else np.asarray(scale, float), len(x), w(J))
    P, p = prior_rows(priors, names)
    last = [x, np.column_stack([w(J), w(r)])]

    def rows(x: np.ndarray) -> tuple[np.ndarray]:
        """All rows [J r]; the last result is cached."""
        if not np.array_equal(last[0], x):
            r, J = (np.asarray(a, float) for a in residuals(x))
            last[:] = x.copy(), np.column_stack([w(J), w(r)])
        return (last[1],)

    ends = limits(bounds, names) if bounds else None
    d = descend(
        rows, x, size, P=P, p=p, bounds=ends, loss=loss_named(loss), width=width,
        rank_tolerance=rank_tolerance, limit=limit,
    )  # fmt: skip
    (end,) = rows(d.x)
    r, J = end[:, -1], end[:, :-1]
    if not d.status.ok:
        return NonlinearFit(**vars(d), r=r, J=J)
    near = AT_BOUND * size
    free = np.ones(len(x), bool) if ends is None else (d.x > ends[0] + near) & (d.x < ends[1] - near)
    worth = fit_worth(
        J, names, size, free, P, w.known, units=tuple(units),
        hold_undetermined=hold_undetermined, rank_tolerance=rank_tolerance,
    )  # fmt: skip
    estimate = worth.estimate(d.x, r)
    if loss != "linear" and estimate.degrees_of_freedom:
        factor = loss_named(loss).variance_factor(r, width, estimate.degrees_of_freedom)
        if not np.isfinite(factor):
            reason = (
                f"almost all residuals are beyond the width {width:g} of the {loss} loss, so none determine the fit"
            )
            d = replace(d, status=SolveStatus.FAILED, message=f"{reason}; use a larger width or a larger noise")
            return NonlinearFit(**vars(d), r=r, J=J)
        estimate = replace(estimate, covariance=estimate.covariance / (1.0 if w.known else estimate.noise**2) * factor)
    return NonlinearFit(**vars(d), r=r, J=J, estimate=estimate)


def central(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """Jacobian (rows, n) of a function of x (n,) by central differences, with a step relative to max(|x|, 1)."""
    steps = np.diag(SLOPE * np.maximum(np.abs(x), 1.0))
    return np.column_stack([(function(x + e) - function(x - e)) / (2 * e[k]) for k, e in enumerate(steps)])


def by_differences(misfit: Callable[[np.ndarray], np.ndarray], rows: int) -> Residuals:
    """Residuals (rows,) for nonlinear_fit() with derivatives by central differences; if `misfit` raises ValueError or
    LinAlgError, x is too far off, and the iteration takes a shorter step."""

    def residuals(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        try:
            return misfit(x), central(misfit, x)
        except (np.linalg.LinAlgError, ValueError):
            return np.full(rows, np.inf), np.full((rows, len(x)), np.inf)

    return residuals


def descend(
    rows: Pieces,
    x: np.ndarray,
    scale: np.ndarray,
    *,
    P: np.ndarray | None = None,
    p: np.ndarray | None = None,
    bounds: tuple[np.ndarray, np.ndarray] | None = None,
    loss: Loss | None = None,
    width: float = 1.0,
    rank_tolerance: float = RANK,
    limit: int = 200,
    tolerance: float = 0.0,
    stop: Callable[[], bool] | None = None,
) -> Descent:
    """Minimise over all of x (n,); `rows` are processed in pieces and not stored.

    Steps have least norm in units of the scales, so nothing moves along null directions. A parameter at one of its
    `bounds`, lower and upper ones (n,), stays there if its step would leave them.
    """
    P = np.zeros((0, len(scale))) if P is None else P
    p = np.zeros(len(P)) if p is None else p
    problem = _AtOnce(rows, np.append(scale, 1.0), P, p, bounds, loss or loss_named("linear"), width, rank_tolerance)
    return minimised(partial(_Here, problem), x, limit=limit, tolerance=tolerance, stop=stop)


@dataclass(eq=False)
class _AtOnce:
    """Problem of rows [J r], with columns in units of `size` (n + 1,), and prior rows P x - p; `triangular` becomes
    true at the first ill-conditioned Jacobian."""

    rows: Pieces
    size: np.ndarray
    P: np.ndarray
    p: np.ndarray
    bounds: tuple[np.ndarray, np.ndarray] | None
    loss: Loss
    width: float
    rank_tolerance: float
    triangular: bool = False


class _Here:
    """Sums of all rows at x, and the steps from there."""

    def __init__(self, problem: _AtOnce, x: np.ndarray) -> None:
        self.problem, self.x = problem, x
        P, p = problem.P, problem.p
        self.prior = np.column_stack([P, P @ x - p]) if len(P) else np.zeros((0, len(problem.size)))
        self._sum()

    def _sum(self) -> None:
        q = self.problem
        self.sums = sums(q.rows(self.x), q.loss, q.width, triangular=q.triangular)
        self.cost = self.sums.cost + 0.5 * float(self.prior[:, -1] @ self.prior[:, -1])

    @property
    def finite(self) -> bool:
        return self.sums.finite

    @cached_property
    def directions(self) -> Directions:
        free = self._directions(self.problem.size)
        if self.problem.bounds is None:
            return free
        slope, (low, high) = free.V @ (free.singular * free.projected), self.problem.bounds
        held = ((self.x <= low) & (slope > 0)) | ((self.x >= high) & (slope < 0))
        return self._directions(np.where(np.append(held, False), 0.0, self.problem.size)) if held.any() else free

    def _directions(self, size: np.ndarray) -> Directions:
        d = directions(self.sums, size, self.prior)
        if d is None:
            self.problem.triangular = True
            self._sum()
            d = directions(self.sums, size, self.prior)
            assert d is not None, "a triangle has directions for any condition"
        return d

    def step(self, damping: float) -> DescentStep | None:
        d, scale = self.directions, self.problem.size[:-1]
        s = d.singular
        within = s > self.problem.rank_tolerance * s.max(initial=0.0)
        if not within.any():
            return None
        part, V, s = d.projected[within], d.V[:, within], s[within]
        end = self.x - V @ (part * s / (s**2 + damping * s[0] ** 2)) * scale
        if self.problem.bounds is not None:
            end = np.clip(end, *self.problem.bounds)
        full = norm(part / s)
        least = DAMPING * float(s[-1] / s[0]) ** 2
        return DescentStep(end, full, 1 + norm(self.x / scale), norm(part), d.size, full, least, True)
