"""One damped least-squares descent: Gauss-Newton, damped as Levenberg and Marquardt did where a step does not help.

How a step follows from the residuals differs: dense in `nonlinear.py`, by blocks in `bundle/fit.py`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..results.status import SolveStatus

STEP = 1e-13  # the norm of a full step in units of the scales: the iteration has arrived
ROUNDING = 1e-8  # likewise: a step that the rounding of the residuals alone may ask for
LEVEL = 1e-5  # cosine of residuals and Jacobian: below, the cost is level to 1e-10 and cannot judge a step
EASIER, HARDER, STUCK = 0.1, 10.0, 1e16
LOOK_BACK, SETTLED = 10, 1e-9  # iterations that together lowered the cost by less than this share: it has settled
QUIET = 1e-3  # a full step that changes the cost by less than this part is taken undamped


class DescentStep(NamedTuple):
    """A step, and the `end` where it leads. In units of the scales `full` is its norm, `reach` that of the unknowns;
    `change` is the length of J step beside that of the residuals, `length`.

    `falls`: what gets smaller from step to step until rounding; `least`: the damping to begin with. `undamped`: the
    lengths are those of the step without damping.
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
    """Where the iteration ended: x, and how it went."""

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
    """The descent from x; `at(x)` is a point with its `cost`, half the sum of squares, whether it is `finite`, and the
    `step(damping)` from there, None where nothing measured moves.

    It ends with a step that changes the residuals by less than `tolerance` of their length, or
    where rounding hides what a step gains; `stop` is asked before each iteration and ends it with the best x so far,
    status INTERRUPTED. `stuck` and `unended` advise where it does not arrive.
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
            return ended(SolveStatus.INTERRUPTED, f"stopped after {iterations} iterations; the best parameters so far")
        iterations += 1
        earlier.append(here.cost)
        step = here.step(damping)
        if step is None:
            return ended(SolveStatus.SOLVED, "nothing measured moves with the parameters")
        flat, near = step.change <= LEVEL * step.length, step.full <= ROUNDING * step.reach
        if flat and step.undamped and step.falls >= before:  # the last digits no longer settle
            return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations")
        if step.undamped and (step.change <= tolerance * step.length or step.full <= STEP * step.reach):
            # taken without a look at what it gains: that is below rounding
            last = here.step(0.0) if damping else step
            x = x if last is None else last.end
            return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations")
        while True:
            there = at(step.end)
            evaluations += 1
            rounded = near and step.falls < before and there.cost - here.cost <= SETTLED * here.cost
            if (there.cost <= here.cost or (damping == 0.0 and (flat or rounded))) and there.finite:
                quiet = here.cost - there.cost < QUIET * here.cost
                x, here, before = step.end, there, step.falls if step.undamped else np.inf
                damping = 0.0 if quiet or damping <= step.least else damping * EASIER
                break
            if near and there.finite:  # no better, but no further either
                return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations, at rounding")
            damping = max(damping * HARDER, step.least)
            again = here.step(damping) if damping <= STUCK else None
            if again is None:
                return ended(SolveStatus.FAILED, f"no step along the gradient lowers the residuals; {stuck}")
            step = again
    if earlier[0] - here.cost <= SETTLED * here.cost:
        return ended(SolveStatus.SOLVED, f"arrived after {iterations} iterations, at what lowers the residuals no more")
    return ended(SolveStatus.ITERATION_LIMIT, f"no end after {limit} iterations; start nearer, or {unended}")
