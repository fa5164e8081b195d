"""Nonlinear least squares by Gauss-Newton steps on the exact Jacobian, damped as Levenberg and Marquardt did."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..results.estimate import Estimate
from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from .least_squares import fit_worth
from .losses import Loss, loss_named
from .make_estimate import RANK, scales
from .normal_equations import Pieces, Sums, directions, norm, sums
from .weighting import Prior, Weighting, prior_rows, weighting

Residuals = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

STEP = 1e-13  # the norm of a full step in units of the scales: the iteration has arrived
ROUNDING = 1e-8  # likewise: a step that the rounding of the residuals alone may ask for
LEVEL = 1e-5  # cosine of residuals and Jacobian: below, the cost is level to 1e-10 and cannot judge a step
# damping begins below the smallest singular value, or weak directions would creep; all relative to the largest
DAMPING, EASIER, HARDER, STUCK = 0.1, 0.1, 10.0, 1e16
LOOK_BACK, SETTLED = 10, 1e-9  # iterations that together lowered the cost by less than this share: it has settled
QUIET = 1e-3  # a full step that changes the cost by less than this part is taken undamped


@dataclass(frozen=True, eq=False)
class Descent:
    """Where the iteration ended: x (n,), and how it went."""

    x: np.ndarray
    cost: float
    status: SolveStatus
    message: str
    iterations: int
    evaluations: int


@dataclass(frozen=True, eq=False)
class NonlinearFit(Descent):
    """The iteration's end, whitened residuals `r` (rows,) and Jacobian `J` (rows, n) there, and the `estimate`; None
    unless solved."""

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
    r, J = (np.asarray(a, float) for a in residuals(x))
    if J.shape != (len(r), len(x)):
        raise ArgumentError(f"the derivatives have the shape {J.shape}; expected ({len(r)}, {len(x)})")
    w = weighting(len(r), sigma=sigma, weights=weights, covariance=covariance)
    if priors and not w.known:
        raise ArgumentError("priors need the size of the noise to be weighed against: give sigma or covariance")
    size = scales(None if scale is None else np.asarray(scale, float), len(x), w(J))
    P, p = prior_rows(priors, names)
    rows = _Dense(residuals, w, x, r, J)
    d = descend(rows, x, size, P=P, p=p, loss=loss_named(loss), width=width, rank_tolerance=rank_tolerance, limit=limit)
    (end,) = rows(d.x)
    r, J = end[:, -1], end[:, :-1]
    if not d.status.ok:
        return NonlinearFit(**vars(d), r=r, J=J)
    worth = fit_worth(
        J, names, size, np.ones(len(x), bool), P, w.known, units=tuple(units),
        hold_undetermined=hold_undetermined, rank_tolerance=rank_tolerance,
    )  # fmt: skip
    estimate = worth.estimate(d.x, r)
    if loss != "linear" and estimate.degrees_of_freedom:
        factor = loss_named(loss).variance_factor(r, width, estimate.degrees_of_freedom)
        if not np.isfinite(factor):
            said = f"next to all residuals lie beyond the width {width:g} of the {loss} loss, and nothing holds the fit"
            d = replace(d, status=SolveStatus.FAILED, message=f"{said}; take a larger width or a larger noise")
            return NonlinearFit(**vars(d), r=r, J=J)
        estimate = replace(estimate, covariance=estimate.covariance / (1.0 if w.known else estimate.noise**2) * factor)
    return NonlinearFit(**vars(d), r=r, J=J, estimate=estimate)


class _Dense:
    """Whitened rows [J r] of a function that gives them all at once; the last are kept, at first r and J at x."""

    def __init__(self, residuals: Residuals, w: Weighting, x: np.ndarray, r: np.ndarray, J: np.ndarray) -> None:
        self.residuals, self.w = residuals, w
        self.x, self.rows = x, self._whitened(r, J)

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray]:
        if not np.array_equal(self.x, x):
            self.x, self.rows = x.copy(), self._whitened(*self.residuals(x))
        return (self.rows,)

    def _whitened(self, r: np.ndarray, J: np.ndarray) -> np.ndarray:
        return np.column_stack([self.w(np.asarray(J, float)), self.w(np.asarray(r, float))])


def descend(
    rows: Pieces,
    x: np.ndarray,
    scale: np.ndarray,
    *,
    P: np.ndarray | None = None,
    p: np.ndarray | None = None,
    loss: Loss | None = None,
    width: float = 1.0,
    rank_tolerance: float = RANK,
    limit: int = 200,
    stop: Callable[[], bool] | None = None,
) -> Descent:
    """Gauss-Newton with damping only where a full step does not help; `rows` are passed through, never kept.

    Along null directions nothing moves: steps are of least norm in units of the scales. `stop` is asked before each
    iteration and ends it with the best x so far, status INTERRUPTED.
    """
    robust = loss or loss_named("linear")
    n = len(scale)
    P = np.zeros((0, n)) if P is None else P
    p = np.zeros(len(P)) if p is None else p
    size, no_prior = np.append(scale, 1.0), np.zeros((0, n + 1))
    triangular = False  # from the first ill-conditioned Jacobian on

    def prior_at(x: np.ndarray) -> np.ndarray:
        return np.column_stack([P, P @ x - p]) if len(P) else no_prior

    def at(x: np.ndarray) -> tuple[Sums, np.ndarray, float]:
        here, prior = sums(rows(x), robust, width, triangular=triangular), prior_at(x)
        return here, prior, here.cost + 0.5 * float(prior[:, -1] @ prior[:, -1])

    def ended(status: SolveStatus, message: str) -> Descent:
        return Descent(x, cost, status, message, iterations, evaluations)

    here, prior, cost = at(x)
    damping, before, iterations, evaluations = 0.0, np.inf, 0, 1
    earlier = deque([np.inf], maxlen=LOOK_BACK)
    if not here.finite:
        return ended(SolveStatus.NOT_FINITE, "the residuals or their derivatives are not finite at the start")
    while iterations < limit:
        if stop is not None and stop():
            return ended(SolveStatus.INTERRUPTED, f"stopped after {iterations} iterations; the best parameters so far")
        iterations += 1
        earlier.append(cost)
        d = directions(here, size, prior)
        if d is None:
            triangular = True
            here, prior, cost = at(x)
            d = directions(here, size, prior)
            assert d is not None, "a triangle has directions, whatever its condition"
        s = d.singular
        within = s > rank_tolerance * s.max(initial=0.0)
        if not within.any():
            return ended(SolveStatus.SOLVED, "nothing measured moves with the parameters")
        projected, V = d.projected[within], d.V[:, within]
        least = DAMPING * float(s[within][-1] / s[0]) ** 2
        full = norm(projected / s[within])  # of the undamped step, in units of the scales
        reach = 1 + norm(x / scale)
        flat = norm(projected) <= LEVEL * d.size
        if flat and full >= before:  # the last digits no longer settle
            return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations")
        if full <= STEP * reach:  # taken without a look at what it gains: that is below rounding
            x = x - V @ (projected / s[within]) * scale
            return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations")
        while True:
            step = -V @ (projected * s[within] / (s[within] ** 2 + damping * s[0] ** 2)) * scale
            trial = x + step
            there, prior_there, cost_new = at(trial)
            evaluations += 1
            finite = there.finite
            rounded = full <= ROUNDING * reach and full < before and cost_new - cost <= SETTLED * cost
            if finite and (cost_new <= cost or (damping == 0.0 and (flat or rounded))):
                quiet = cost - cost_new < QUIET * cost
                x, here, prior, cost, before = trial, there, prior_there, cost_new, full
                damping = 0.0 if quiet or damping <= least else damping * EASIER
                break
            if full <= ROUNDING * reach and finite:  # no better, but no further either
                return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations, at rounding")
            damping = max(damping * HARDER, least)
            if damping > STUCK:
                return ended(
                    SolveStatus.FAILED, "no step along the gradient lowers the residuals; are the derivatives right?"
                )
    if earlier[0] - cost <= SETTLED * cost:  # along a valley that is bent and all but level, steps never get short
        return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations, at what lowers the residuals no more")
    return ended(SolveStatus.ITERATION_LIMIT, f"no end after {limit} iterations; start nearer, or scale the parameters")
