"""An interior-point method for few unknowns and many inequality rows.

IPOPT factors step equations with two more unknowns for every row; for thousands of dense rows that takes most of its
time. Here rows and slacks are eliminated first, so that a step needs the eigenvalues of one dense matrix of the size of
the unknowns. The method follows Nocedal and Wright, Numerical Optimization (2006): the barrier falls when its
subproblem is solved (algorithm 19.1), with line search on a merit function. If the matrix of a step is indefinite, its
eigenvalues are replaced by their absolute values (section 3.4), so that steps leave saddle points and lower the merit
function.

SciPy's SLSQP is as fast with the same derivatives, but it moves along the limits at which excitations start, and ends
in higher local minima than an interior method. SciPy's trust-constr, like IPOPT, spends its time on the rows.
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

KEPT = 1e-4  # relative to a row's size: a smaller violation is tolerated
COMPLEMENTARY = 1e-4  # slack times multiplier of every row at a solution
LEAST_BARRIER = 1e-5  # final barrier
LESS, POWER = 0.2, 1.5  # the barrier falls to this factor of itself, or to this power if that is less
NEARLY = 10.0  # times the barrier: the error at which a subproblem counts as solved
LEAST_SLACK = 1e-2  # of rows that the start violates or barely satisfies
SHARE = 0.99  # of the step at which a slack or a multiplier becomes zero
LEAST_RESET = 5e-3  # of a slack: a satisfied row takes its distance as slack unless that is smaller
ARMIJO, HALVINGS = 1e-4, 25
PENALTY = 0.7  # the merit function falls by at least 1 minus this part of the weighted violation
ROUNDING = 1e-9  # relative to the merit function
LEAST_CURVATURE = 1e-6  # of the matrix of a step, for unknowns scaled so that each changes some row by 1

Derivatives = tuple[Array, Array, Callable[[Array], Array]]


class ManyRows(Protocol):
    """A cost of n unknowns, and rows h (R,) of size one, satisfied if h <= 0."""

    def value(self, x: Array) -> tuple[float, Array]:
        """Cost and rows; not finite outside their domain."""
        ...

    def derivatives(self, x: Array) -> Derivatives:
        """Gradient (n,) of the cost, Jacobian (R, n) of the rows, and H(y) (n, n): the Hessian of cost + y rows."""
        ...


@dataclass(frozen=True, eq=False)
class InteriorRun:
    """Result of a run.

    x: the last iterate if the problem is solved; else the feasible iterate of least cost, or the least infeasible one.
    """

    x: Array
    objective: float
    violation: float
    iterations: int
    status: SolveStatus
    message: str


@np.errstate(all="ignore")  # trial steps may be evaluated where numbers are not finite
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
    """Find a local minimum of the cost subject to all rows.

    Args:
        tolerance: largest slope of the Lagrangian along one unknown, for a step that changes no row by more than 1.
        progress: called with (iteration, cost, violation); True stops.
        barrier: the initial barrier; a small one, such as 1e-3, suits a start that is nearly a solution.

    Solved means: every row is satisfied to KEPT, slack times multiplier of each row is below COMPLEMENTARY, the
    gradient of the Lagrangian is within the tolerance, and no direction along the active rows has a negative curvature
    beyond it. The same input gives the same result.
    """
    stop_at = None if max_seconds is None else time.monotonic() + max_seconds
    iterate = _start(problem, np.array(x0, float), barrier)
    if iterate is None:
        f, h = problem.value(x0)
        return _run((x0, f, h), 0, SolveStatus.NOT_FINITE, "cost or rows at the start")
    best, weight, iteration = iterate, 1.0, 0
    while True:
        best = iterate if iterate.rank < best.rank else best
        if iterate.solves(tolerance):
            return _run((iterate.x, iterate.f, iterate.h), iteration, SolveStatus.SOLVED)
        stopped = progress is not None and progress(iteration, iterate.f, iterate.violation)
        late = stop_at is not None and time.monotonic() > stop_at
        result = best.x, best.f, best.h
        if stopped or late:
            word = "the run was stopped by the caller" if stopped else "the run reached its time limit"
            return _run(result, iteration, SolveStatus.INTERRUPTED, word)
        if iteration == max_iterations:
            return _run(result, iteration, SolveStatus.ITERATION_LIMIT)
        while barrier > LEAST_BARRIER and iterate.error(barrier) < NEARLY * barrier:
            barrier = max(LEAST_BARRIER, min(LESS * barrier, barrier**POWER))
        after, weight = _step(problem, iterate, barrier, weight)
        if after is None:
            word = "no step along the search direction lowers the cost"
            return _run(result, iteration, SolveStatus.FAILED, word)
        iterate, iteration = after, iteration + 1


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Unknowns x, cost f, rows h with slacks s and multipliers y, and the derivatives.

    size: (n,) step of each unknown that changes some row by 1 and none by more, here and at all earlier iterates: at a
    single iterate a column of the Jacobian may be zero.
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
        """Sort key: the violation; among feasible iterates the cost."""
        return max(self.violation, KEPT), self.f

    @cached_property
    def steepness(self) -> float:
        """Largest slope of the Lagrangian along any unknown."""
        return float(np.max(np.abs(self.gradient + self.y @ self.A) * self.size))

    @cached_property
    def H(self) -> Array:
        return self.hessian(self.y)

    @cached_property
    def curved(self) -> tuple[Array, Array]:
        """Eigenvalues (n,), ascending, and directions (n, n) of the matrix of a step, for unknowns scaled by `size`."""
        condensed = self.H + (self.A.T * (self.y / self.s)) @ self.A
        if not np.all(np.isfinite(condensed)):  # a slack has become zero
            return np.full(len(self.x), np.nan), condensed
        curvatures, directions = np.linalg.eigh(condensed * np.outer(self.size, self.size))
        return curvatures, self.size[:, None] * directions

    def solves(self, tolerance: float) -> bool:
        """Whether it is a local minimum by the conditions of first and second order."""
        return (
            self.violation <= KEPT
            and self.steepness <= tolerance
            and float(np.max(self.s * self.y, initial=0.0)) <= COMPLEMENTARY
            and self.curved[0][0] >= -tolerance
        )

    def error(self, barrier: float) -> float:
        """Error of the optimality conditions with a barrier."""
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
    """The iterate with its derivatives; `size` is that of the previous iterate."""
    gradient, A, hessian = problem.derivatives(x)
    most = np.max(np.abs(A), axis=0, initial=0.0)
    current = 1 / np.where(most > 0, most, 1.0)
    return _Iterate(x, f, h, s, y, gradient, A, hessian, current if size is None else np.minimum(size, current))


def _step(problem: ManyRows, iterate: _Iterate, barrier: float, weight: float) -> tuple[_Iterate | None, float]:
    """The next iterate, None if no step improves, and the weight of violations in the merit function."""
    r, s, y, A = iterate.h + iterate.s, iterate.s, iterate.y, iterate.A
    curvatures, along = iterate.curved
    if np.any(np.isnan(curvatures)):
        return None, weight
    downhill = -iterate.gradient - (barrier / s + y / s * r) @ A
    dx = along @ (along.T @ downhill / np.maximum(np.abs(curvatures), LEAST_CURVATURE))
    ds = -r - A @ dx
    dy = barrier / s - y - y / s * ds
    share = max(SHARE, 1 - barrier)
    length, infeasibility = _longest(s, ds, share), float(np.sum(np.abs(r)))
    slope = float(iterate.gradient @ dx - barrier * np.sum(ds / s))
    if infeasibility > 0:
        curved = max(0.0, float(dx @ iterate.H @ dx)) / 2
        weight = max(weight, (slope + curved) / (PENALTY * infeasibility), 2 * float(np.max(y)))

    def merit(f: float, s: Array, infeasibility: float) -> float:
        return f - barrier * float(np.sum(np.log(s))) + weight * infeasibility

    old, slope = merit(iterate.f, s, infeasibility), slope - weight * infeasibility
    y = y + _longest(y, dy, share) * dy
    for _ in range(HALVINGS):
        x = iterate.x + length * dx
        f, h = problem.value(x)
        if np.isfinite(f) and np.all(np.isfinite(h)):
            new = np.where(-h > LEAST_RESET * s, -h, s + length * ds)
            if merit(f, new, float(np.sum(np.abs(h + new)))) <= old + ARMIJO * length * slope + ROUNDING * abs(old):
                return _iterate(problem, x, f, h, new, y, iterate.size), weight
        length /= 2
    return None, weight


def _longest(values: Array, change: Array, share: float) -> float:
    """The fraction of a change, at most 1, that leaves positive values positive."""
    falls = change < 0
    return min(1.0, share * float(np.min(-values[falls] / change[falls], initial=1 / share)))


def _violation(h: Array) -> float:
    worst = float(np.max(h, initial=0.0))
    return np.inf if np.isnan(worst) else worst


def _run(result: tuple[Array, float, Array], iterations: int, status: SolveStatus, word: str = "") -> InteriorRun:
    """`result`: unknowns, cost and rows."""
    x, f, h = result
    violation = _violation(h)
    message = "solved" if status.ok else f"{status.message} ({word})" if word else status.message
    message = word if status is SolveStatus.INTERRUPTED else message
    if violation > KEPT and not status.ok:
        message += (
            f"; no feasible point was found, the least infeasible one violates a row by {violation:.2g} of its size"
        )
    return InteriorRun(x, f, violation, iterations, status, message)
