"""Damped least-squares descent: Gauss-Newton, with Levenberg-Marquardt damping if a step does not lower the cost.

The linear algebra of a step is elsewhere: dense in `nonlinear.py`, by blocks in `bundle/fit.py`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..results.status import SolveStatus

STEP = 1e-13  # norm of a full step in units of the scales below which the iteration has converged
NEXT = 1e-2  # likewise: share of that norm below which the next step would stay
ROUNDING = 1e-8  # likewise: norm of a step that may be due to round-off of the residuals alone
LEVEL = 1e-5  # cosine of residuals and Jacobian: below, the cost is flat to 1e-10 and cannot judge a step
EASIER, HARDER, STUCK = 0.1, 10.0, 1e16
LOOK_BACK, SETTLED = 10, 1e-9  # if so many iterations lower the cost by less than this share, it has converged
QUIET = 1e-3  # after a step that changes the cost by less than this share, damping ends


class DescentStep(NamedTuple):
    """A step to the point `end`.

    full, reach: norms of the step and of the unknowns, in units of the scales. change, length: norms of J step and of
    the residuals. falls: quantity that decreases from step to step until round-off. least: smallest damping. undamped:
    whether these norms are those of the step without damping.
    """

    end: Any
    full: float
    reach: float
    change: float
    length: float
    falls: float
    least: float
    undamped: bool


@dataclass(frozen=True, eq=False)
class Descent:
    """Result of the iteration: x, and how it ended."""

    x: Any
    cost: float
    status: SolveStatus
    message: str
    iterations: int
    evaluations: int


def minimised(
    at: Callable[[Any], Any],
    x: Any,
    *,
    limit: int,
    tolerance: float = 0.0,
    stop: Callable[[], bool] | None = None,
    stuck: str = "are the derivatives right?",
    unended: str = "scale the parameters",
) -> Descent:
    """Minimise from x; `at(x)` is a point with its `cost`, half the sum of squares, whether it is `finite`, and its
    `step(damping)`, None if no residual depends on the unknowns.

    The iteration ends with a step that changes the residuals by less than `tolerance` of their length, or if round-off
    hides the gain of a step. `stop` is called before each iteration; if it returns True, the iteration ends with the
    best x so far, status INTERRUPTED. `stuck` and `unended` are advice for a failed iteration.
    """
    here = at(x)
    damping, before, iterations, evaluations = 0.0, np.inf, 0, 1
    earlier = deque([np.inf], maxlen=LOOK_BACK)

    def ended(status: SolveStatus, message: str) -> Descent:
        return Descent(x, here.cost, status, message, iterations, evaluations)

    if not here.finite:
        return ended(SolveStatus.NOT_FINITE, "the residuals or their derivatives are not finite at the start")
    while iterations < limit:
        if stop is not None and stop():
            return ended(SolveStatus.INTERRUPTED, f"stopped after {iterations} iterations; best parameters so far")
        iterations += 1
        earlier.append(here.cost)
        step = here.step(damping)
        if step is None:
            return ended(SolveStatus.SOLVED, "no measurement depends on the parameters")
        flat, near = step.change <= LEVEL * step.length, step.full <= ROUNDING * step.reach
        if flat and step.undamped and step.falls >= before:  # only round-off remains
            return ended(SolveStatus.SOLVED, f"converged after {_times(iterations)}")
        short = step.full <= STEP * step.reach
        if flat and 0.0 < before < np.inf:  # the next step will be shorter by at least the same ratio
            short |= step.full * (step.falls / before) <= NEXT * STEP * step.reach
        if step.undamped and (short or step.change <= tolerance * step.length):
            # taken without evaluating its gain, which is below round-off
            last = here.step(0.0) if damping else step
            x = x if last is None else last.end
            return ended(SolveStatus.SOLVED, f"converged after {_times(iterations)}")
        while True:
            trial = at(step.end)
            evaluations += 1
            rounded = near and step.falls < before and trial.cost - here.cost <= SETTLED * here.cost
            if (trial.cost <= here.cost or (damping == 0.0 and (flat or rounded))) and trial.finite:
                quiet = here.cost - trial.cost < QUIET * here.cost
                x, here, before = step.end, trial, step.falls if step.undamped else np.inf
                damping = 0.0 if quiet or damping <= step.least else damping * EASIER
                break
            if near and trial.finite:  # the step is round-off
                return ended(SolveStatus.SOLVED, f"converged to round-off after {_times(iterations)}")
            damping = max(damping * HARDER, step.least)
            shorter = here.step(damping) if damping <= STUCK else None
            if shorter is None:
                return ended(SolveStatus.FAILED, f"no step along the gradient lowers the residuals; {stuck}")
            step = shorter
    if earlier[0] - here.cost <= SETTLED * here.cost:
        return ended(SolveStatus.SOLVED, f"converged after {_times(iterations)}: the residuals no longer decrease")
    return ended(SolveStatus.ITERATION_LIMIT, f"not converged after {limit} iterations; start nearer, or {unended}")


def _times(iterations: int) -> str:
    return f"{iterations} iteration{'s' * (iterations != 1)}"
