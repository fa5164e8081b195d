"""An interior-point method for few unknowns under many rows, all of them inequalities.

IPOPT factors the equations of a step with two unknowns more for every row, which for thousands of dense rows takes
most of its time. Here rows and slacks are eliminated first, so that a step takes the eigenvalues of one dense matrix
of the size of the unknowns. Nocedal and Wright, Numerical Optimization (2006): barrier that falls when its own problem
is solved (algorithm 19.1), line search on a merit function; where the matrix of a step is indefinite, its eigenvalues
by their size (section 3.4), so that steps leave saddle points and lower the merit function.

SciPy's SLSQP is as fast with the same derivatives, but walks along the limits at which excitations start, and ends in
higher local minima than a method that comes from within; its trust-constr, like IPOPT, spends its time on the rows.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ...optimize.watch import Progress
from ...results import SolveStatus

Array = np.ndarray

KEPT = 1e-4  # of a row's size: a violation below is none
COMPLEMENTARY = 1e-4  # slack times multiplier of every row at a solution
LEAST_BARRIER = 1e-5  # in the end
LESS, POWER = 0.2, 1.5  # the barrier falls to this part of itself, or to this power where that is less
NEARLY = 10.0  # times the barrier: the error at which the problem with this barrier counts as solved
LEAST_SLACK = 1e-2  # of rows that the start violates or only just keeps
SHARE = 0.99  # of the way to where a slack or a multiplier vanishes
LEAST_RESET = 5e-3  # of a slack: unless it would fall below this, a row that is kept has its distance as slack
ARMIJO, HALVINGS = 1e-4, 25
PENALTY = 0.7  # the merit function falls at least by 1 minus this part of the weighed violation
ROUNDING = 1e-9  # of the merit function
LEAST_CURVATURE = 1e-6  # of the matrix of a step, for unknowns that each change some row by 1

Derivatives = tuple[Array, Array, Callable[[Array], Array]]


class ManyRows(Protocol):
    """A cost of n unknowns, and rows h (R,) of size one that are kept where h <= 0."""

    def value(self, x: Array) -> tuple[float, Array]:
        """Cost and rows; not finite outside their domain."""
        ...

    def derivatives(self, x: Array) -> Derivatives:
        """Gradient (n,) of the cost, Jacobian (R, n) of the rows, and H(y) (n, n): the Hessian of cost + y rows."""
        ...


@dataclass(frozen=True, eq=False)
class InteriorRun:
    """How a run ended.

    x: the last iterate of a solved problem, else the best one: of those that keep all rows that of the least cost; if
        none does, the nearest.
    """

    x: Array
    objective: float
    violation: float
    iterations: int
    status: SolveStatus
    message: str


@np.errstate(all="ignore")  # numbers that are not finite are asked for where a step is taken
def interior_point(
    problem: ManyRows,
    x0: Array,
    *,
    tolerance: float,
    max_iterations: int,
    max_seconds: float | None = None,
    progress: Progress | None = None,
    barrier: float = 0.1,
) -> InteriorRun:
    """A local minimum of the cost under all rows.

    Args:
        tolerance: what the Lagrangian may still change along one unknown, in a step that changes no row by more than 1.
        progress: called with (iteration, cost, violation); True stops.
        barrier: the first; a small one, such as 1e-3, for a start that is nearly a solution.

    Solved means: every row is kept to KEPT, slack times multiplier of each is below COMPLEMENTARY, the Lagrangian's
    gradient keeps the tolerance, and no direction along the rows that hold curves downwards by more than it. The same
    input gives the same result.
    """
    stop_at = None if max_seconds is None else time.monotonic() + max_seconds
    at = _start(problem, np.array(x0, float), barrier)
    if at is None:
        f, h = problem.value(x0)
        return _run((x0, f, h), 0, SolveStatus.NOT_FINITE, "cost or rows at the start")
    best, weight, iteration = at, 1.0, 0
    while True:
        best = at if at.rank < best.rank else best
        if at.solves(tolerance):
            return _run((at.x, at.f, at.h), iteration, SolveStatus.SOLVED)
        asked = progress is not None and progress(iteration, at.f, at.violation)
        late = stop_at is not None and time.monotonic() > stop_at
        kept = best.x, best.f, best.h
        if asked or late:
            word = "it was asked to stop" if asked else "its time was over"
            return _run(kept, iteration, SolveStatus.INTERRUPTED, word)
        if iteration == max_iterations:
            return _run(kept, iteration, SolveStatus.ITERATION_LIMIT)
        while barrier > LEAST_BARRIER and at.error(barrier) < NEARLY * barrier:
            barrier = max(LEAST_BARRIER, min(LESS * barrier, barrier**POWER))
        after, weight = _step(problem, at, barrier, weight)
        if after is None:
            word = "no step along the search direction lowers the cost"
            return _run(kept, iteration, SolveStatus.FAILED, word)
        at, iteration = after, iteration + 1


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Unknowns x, cost f, rows h with slacks s and multipliers y, and derivatives there.

    size: (n,) step of each unknown that changes some row by 1 and none by more, here and at the iterates before: at a
    single one a column of the Jacobian may vanish.
    """

    x: Array
    f: float
    h: Array
    s: Array
    y: Array
    gradient: Array
    A: Array
    hessian: Callable[[Array], Array]
    size: Array

    @cached_property
    def violation(self) -> float:
        return _violation(self.h)

    @cached_property
    def rank(self) -> tuple[float, float]:
        """By violation, and among those that keep their rows by the cost."""
        return max(self.violation, KEPT), self.f

    @cached_property
    def steepness(self) -> float:
        """Of the Lagrangian, along any one unknown."""
        return float(np.max(np.abs(self.gradient + self.y @ self.A) * self.size))

    @cached_property
    def H(self) -> Array:
        return self.hessian(self.y)

    @cached_property
    def curved(self) -> tuple[Array, Array]:
        """Eigenvalues (n,), least first, and directions (n, n) of the matrix of a step, of unknowns over their size."""
        condensed = self.H + (self.A.T * (self.y / self.s)) @ self.A
        if not np.all(np.isfinite(condensed)):  # as of slacks that vanish
            return np.full(len(self.x), np.nan), condensed
        curvatures, directions = np.linalg.eigh(condensed * np.outer(self.size, self.size))
        return curvatures, self.size[:, None] * directions

    def solves(self, tolerance: float) -> bool:
        """Whether it is a local minimum: no direction of first or second order leads down."""
        return (
            self.violation <= KEPT
            and self.steepness <= tolerance
            and float(np.max(self.s * self.y, initial=0.0)) <= COMPLEMENTARY
            and self.curved[0][0] >= -tolerance
        )

    def error(self, barrier: float) -> float:
        """Of the conditions for a minimum with a barrier."""
        complementary = np.max(np.abs(self.s * self.y - barrier), initial=0.0)
        return max(self.steepness, float(complementary), float(np.max(np.abs(self.h + self.s), initial=0.0)))


def _start(problem: ManyRows, x: Array, barrier: float) -> _Iterate | None:
    f, h = problem.value(x)
    if not (np.isfinite(f) and np.all(np.isfinite(h))):
        return None
    s = np.maximum(-h, LEAST_SLACK)
    return _iterate(problem, x, f, h, s, barrier / s)


def _iterate(
    problem: ManyRows, x: Array, f: float, h: Array, s: Array, y: Array, size: Array | None = None
) -> _Iterate:
    """With its derivatives; `size` is that of the iterate before."""
    gradient, A, hessian = problem.derivatives(x)
    most = np.max(np.abs(A), axis=0, initial=0.0)
    now = 1 / np.where(most > 0, most, 1.0)
    return _Iterate(x, f, h, s, y, gradient, A, hessian, now if size is None else np.minimum(size, now))


def _step(problem: ManyRows, at: _Iterate, barrier: float, weight: float) -> tuple[_Iterate | None, float]:
    """The next iterate, None where none is better, and the weight of violations in the merit function."""
    r, s, y, A = at.h + at.s, at.s, at.y, at.A
    curvatures, along = at.curved
    if np.any(np.isnan(curvatures)):
        return None, weight
    downhill = -at.gradient - (barrier / s + y / s * r) @ A
    dx = along @ (along.T @ downhill / np.maximum(np.abs(curvatures), LEAST_CURVATURE))
    ds = -r - A @ dx
    dy = barrier / s - y - y / s * ds
    share = max(SHARE, 1 - barrier)
    length, missed = _longest(s, ds, share), float(np.sum(np.abs(r)))
    slope = float(at.gradient @ dx - barrier * np.sum(ds / s))
    if missed > 0:
        weight = max(weight, (slope + max(0.0, float(dx @ at.H @ dx)) / 2) / (PENALTY * missed), 2 * float(np.max(y)))

    def merit(f: float, s: Array, missed: float) -> float:
        return f - barrier * float(np.sum(np.log(s))) + weight * missed

    now, slope = merit(at.f, s, missed), slope - weight * missed
    y = y + _longest(y, dy, share) * dy
    for _ in range(HALVINGS):
        x = at.x + length * dx
        f, h = problem.value(x)
        if np.isfinite(f) and np.all(np.isfinite(h)):
            new = np.where(-h > LEAST_RESET * s, -h, s + length * ds)
            if merit(f, new, float(np.sum(np.abs(h + new)))) <= now + ARMIJO * length * slope + ROUNDING * abs(now):
                return _iterate(problem, x, f, h, new, y, at.size), weight
        length /= 2
    return None, weight


def _longest(values: Array, change: Array, share: float) -> float:
    """The part of a change, at most 1, that leaves positive values positive."""
    falls = change < 0
    return min(1.0, share * float(np.min(-values[falls] / change[falls], initial=1 / share)))


def _violation(h: Array) -> float:
    worst = float(np.max(h, initial=0.0))
    return np.inf if np.isnan(worst) else worst


def _run(kept: tuple[Array, float, Array], iterations: int, status: SolveStatus, word: str = "") -> InteriorRun:
    """`kept`: unknowns, cost and rows."""
    x, f, h = kept
    violation = _violation(h)
    message = "solved" if status.ok else f"{status.message} ({word})" if word else status.message
    if violation > KEPT and not status.ok:
        message += (
            f"; no point was seen that keeps all rows, at the nearest one is broken by {violation:.2g} of its size"
        )
    return InteriorRun(x, f, violation, iterations, status, message)
