"""Nonlinear least squares by Gauss-Newton steps on the exact Jacobian, damped as Levenberg and Marquardt did."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..results.estimate import Estimate
from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from .least_squares import make_estimate
from .losses import Loss, loss_named
from .make_estimate import RANK, scales
from .weighting import Prior, Weighting, prior_rows, weighting

Residuals = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

STEP = 1e-13  # the norm of a full step in units of the scales: the iteration has arrived
ROUNDING = 1e-8  # likewise: a step that the rounding of the residuals alone may ask for
LEVEL = 1e-5  # cosine of residuals and Jacobian: below, the cost is level to 1e-10 and cannot judge a step
# damping begins below the smallest singular value, or weak directions would creep; all relative to the largest
DAMPING, EASIER, HARDER, STUCK = 0.1, 0.1, 10.0, 1e16
QUIET = 1e-3  # a full step that changes the cost by less than this part is taken undamped


@dataclass(frozen=True, eq=False)
class Descent:
    """Where the iteration ended: x (n,), whitened residuals `r` and Jacobian `J` there, and how it went."""

    x: np.ndarray
    r: np.ndarray
    J: np.ndarray
    cost: float
    status: SolveStatus
    message: str
    iterations: int
    evaluations: int


@dataclass(frozen=True, eq=False)
class NonlinearFit(Descent):
    """The iteration's end, and the `estimate` there; None unless solved."""

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
    priors: Sequence[Prior] = (),
    loss: str = "linear",
    width: float = 1.0,
    units: Sequence[str] = (),
    hold_undetermined: bool = False,
    rank_tolerance: float = RANK,
    limit: int = 200,
) -> NonlinearFit:
    """Nonlinear least squares: the x (n,) that minimises half the sum of squares of the whitened residuals.

    `residuals(x)` returns r (rows,), in their own unit and not whitened, and the Jacobian dr/dx (rows, n). `start` (n,)
    is where the iteration begins, `limit` how many steps it may take. Noise, priors, scales and what is not determined
    are treated as in linear_fit(); priors need a known noise (sigma or covariance). `loss` of the whitened residuals is
    linear, huber, soft_l1 or cauchy as in scipy, with its `width`; the covariance is then Huber's.

    The sign of r does not matter as long as its Jacobian has the same. Raises ArgumentError for shapes that do not fit;
    an iteration that fails is a `status`, and `estimate` is then None.

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
        raise ArgumentError(f"{len(names)} names for {len(x)} starting values; give one each")
    r, J = residuals(x)
    if J.shape != (len(r), len(x)):
        raise ArgumentError(f"the derivatives have the shape {J.shape}; expected ({len(r)}, {len(x)})")
    w = weighting(len(r), sigma=sigma, weights=weights, covariance=covariance)
    if priors and not w.known:
        raise ArgumentError("priors need the size of the noise to be weighed against: give sigma or covariance")
    size = scales(None if scale is None else np.asarray(scale, float), len(x), w(J))
    P, p = prior_rows(priors, names)
    d = descend(residuals, x, size, w, P=P, p=p, loss=loss_named(loss), width=width, rank_tolerance=rank_tolerance,
                limit=limit)  # fmt: skip
    if not d.status.ok:
        return NonlinearFit(**vars(d))
    estimate = make_estimate(
        d.x, d.r, d.J, names, size, np.ones(len(x), bool), P, w.known, units=tuple(units),
        hold_undetermined=hold_undetermined, rank_tolerance=rank_tolerance,
    )  # fmt: skip
    if loss != "linear" and estimate.degrees_of_freedom:
        factor = loss_named(loss).variance_factor(d.r, width, estimate.degrees_of_freedom)
        estimate = replace(estimate, covariance=estimate.covariance / (1.0 if w.known else estimate.noise**2) * factor)
    return NonlinearFit(**vars(d), estimate=estimate)


def descend(
    residuals: Residuals,
    x: np.ndarray,
    scale: np.ndarray,
    w: Weighting,
    *,
    P: np.ndarray | None = None,
    p: np.ndarray | None = None,
    loss: Loss | None = None,
    width: float = 1.0,
    rank_tolerance: float = RANK,
    limit: int = 200,
    stop: Callable[[], bool] | None = None,
) -> Descent:
    """Gauss-Newton with damping only where a full step does not help.

    Along null directions nothing moves: steps are of least norm in units of the scales. `stop` is asked before each
    iteration and ends it with the best x so far, status INTERRUPTED.
    """
    robust = loss or loss_named("linear")
    n = len(scale)
    P = np.zeros((0, n)) if P is None else P
    p = np.zeros(len(P)) if p is None else p

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        r, J = residuals(x)
        r, J = w(np.asarray(r, float)), w(np.asarray(J, float))
        prior = P @ x - p if len(P) else np.zeros(0)
        return r, J, robust.cost(r, width) + 0.5 * float(prior @ prior)

    def ended(status: SolveStatus, message: str) -> Descent:
        return Descent(x, r, J, cost, status, message, iterations, evaluations)

    r, J, cost = at(x)
    damping, before, iterations, evaluations = 0.0, np.inf, 0, 1
    if not (np.isfinite(cost) and np.all(np.isfinite(J))):
        return ended(SolveStatus.NOT_FINITE, "the residuals or their derivatives are not finite at the start")
    while iterations < limit:
        if stop is not None and stop():
            return ended(SolveStatus.INTERRUPTED, f"stopped after {iterations} iterations; the best parameters so far")
        iterations += 1
        # the normal equations by QR and SVD: the condition number is not squared
        weight = robust.weight(r, width)
        rows = np.vstack([J * weight[:, None], P]) * scale
        right = np.concatenate([r * weight, P @ x - p if len(P) else np.zeros(0)])
        Q, R = np.linalg.qr(rows) if len(rows) > n else (np.eye(len(rows)), rows)
        U, s, Vt = np.linalg.svd(R, full_matrices=False)
        within = s > rank_tolerance * s[0]
        projected = (U.T @ (Q.T @ right))[within]
        if not within.any():
            return ended(SolveStatus.SOLVED, "nothing measured moves with the parameters")
        least = DAMPING * float(s[within][-1] / s[0]) ** 2
        full = float(np.linalg.norm(projected / s[within]))  # of the undamped step, in units of the scales
        reach = 1 + float(np.linalg.norm(x / scale)) if len(x) == n else 1.0
        flat = float(np.linalg.norm(projected)) <= LEVEL * np.linalg.norm(right)
        if flat and full >= before:  # the last digits no longer settle
            return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations")
        while True:
            step = -Vt[within].T @ (projected * s[within] / (s[within] ** 2 + damping * s[0] ** 2)) * scale
            trial = x + step
            r_new, J_new, cost_new = at(trial)
            evaluations += 1
            finite = np.isfinite(cost_new) and np.all(np.isfinite(J_new))
            if finite and (cost_new <= cost or (flat and damping == 0.0)):
                quiet = cost - cost_new < QUIET * cost
                x, r, J, cost, before = trial, r_new, J_new, cost_new, full
                damping = 0.0 if quiet or damping <= least else damping * EASIER
                if full <= STEP * reach:
                    return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations")
                break
            if full <= ROUNDING * reach and finite:  # no better, but no further either
                return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations, at rounding")
            damping = max(damping * HARDER, least)
            if damping > STUCK:
                return ended(
                    SolveStatus.FAILED, "no step along the gradient lowers the residuals; are the derivatives right?"
                )
    return ended(SolveStatus.ITERATION_LIMIT, f"no end after {limit} iterations; start nearer, or scale the parameters")
