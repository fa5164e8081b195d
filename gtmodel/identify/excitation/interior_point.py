"""An interior-point method for few unknowns under many rows, all of them inequalities.

IPOPT factors the equations of a step with two unknowns more for every row, which for thousands of dense rows takes
most of its time. Here rows and slacks are eliminated first, so that a step is one dense factorisation of the size of
the unknowns. Nocedal and Wright, Numerical Optimization (2006), chapter 19: barrier that falls when its own problem is
solved (algorithm 19.1), line search on a merit function, limited-memory BFGS.
"""

from __future__ import annotations

import time
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy

from ...optimize.watch import Progress
from ...results import SolveStatus

Array = np.ndarray

KEPT = 1e-4  # of a row's size: a violation below is none
COMPLEMENTARY = 1e-4  # slack times multiplier of every row at a solution
BARRIER, LEAST_BARRIER = 0.1, 1e-5  # at a cold start, and in the end
LESS, POWER = 0.2, 1.5  # the barrier falls to this part of itself, or to this power where that is less
NEARLY = 10.0  # times the barrier: the error at which the problem with this barrier counts as solved
LEAST_SLACK = 1e-2  # of rows that the start violates or only just keeps
SHARE = 0.99  # of the way to where a slack or a multiplier vanishes
LEAST_RESET = 5e-3  # of a slack: unless it would fall below this, a row that is kept has its distance as slack
ARMIJO, HALVINGS = 1e-4, 25
PENALTY = 0.7  # the merit function falls at least by 1 minus this part of the weighed violation
ROUNDING = 1e-9  # of the merit function
MEMORY = 12  # steps that the Hessian is made of: more keep curvature that multipliers have left behind
FLAT = 1e-8  # cosine of a step and the change of the gradient: no curvature
FIRST = 0.1  # of the rows' size: how long the first step of a cold start is


class ManyRows(Protocol):
    """A cost of n unknowns, and rows h (R,) of size one that are kept where h <= 0."""

    def value(self, x: Array) -> tuple[float, Array]:
        """Cost and rows; not finite outside their domain."""
        ...

    def derivatives(self, x: Array) -> tuple[Array, Array]:
        """Gradient (n,) of the cost and Jacobian (R, n) of the rows."""
        ...


class Curvature:
    """The Lagrangian's Hessian H (n, n) by BFGS from the last steps: positive definite, and forgetful."""

    def __init__(self, H: Array) -> None:
        self.H = H
        self._steps: list[tuple[Array, Array]] = []

    def update(self, dx: Array, dg: Array) -> None:
        """Take in a step and the change of the gradient along it; a step of negative curvature is left out."""
        if dx @ dg <= FLAT * np.linalg.norm(dx) * np.linalg.norm(dg):
            return
        self._steps = [*self._steps[1 - MEMORY :], (dx, dg)]
        H = np.eye(len(dx)) * (dx @ dg) / (dx @ dx)
        for d, g in self._steps:
            Hd = H @ d
            H = H - np.outer(Hd, Hd) / (d @ Hd) + np.outer(g, g) / (d @ g)
        self.H = H


@dataclass(frozen=True, eq=False)
class InteriorRun:
    """How a run ended.

    x: the last iterate of a solved problem, else the best one: of those that keep all rows that of the least cost; if
        none does, the nearest. curvature: of the Lagrangian, for a warm start.
    """

    x: Array
    objective: float
    violation: float
    curvature: Curvature
    iterations: int
    status: SolveStatus
    message: str


def interior_point(
    problem: ManyRows,
    x0: Array,
    *,
    tolerance: float,
    max_iterations: int,
    max_seconds: float | None = None,
    progress: Progress | None = None,
    barrier: float = BARRIER,
    curvature: Curvature | None = None,
) -> InteriorRun:
    """A local minimum of the cost under all rows.

    Args:
        tolerance: what the Lagrangian may still change along one unknown, in a step that changes no row by more than 1.
        progress: called with (iteration, cost, violation); True stops.
        barrier, curvature: of a warm start: a smaller barrier, and the curvature of the run before.

    Solved means: every row is kept to KEPT, slack times multiplier of each is below COMPLEMENTARY, and the Lagrangian's
    gradient keeps the tolerance. The same input gives the same result.
    """
    stop_at = None if max_seconds is None else time.monotonic() + max_seconds
    at = _start(problem, np.array(x0, float), barrier)
    if at is None:
        f, h = problem.value(x0)
        return _run((x0, f, h), Curvature(np.eye(len(x0))), 0, SolveStatus.NOT_FINITE, "cost or rows at the start")
    cold = curvature is None
    curvature = copy(curvature) if curvature else Curvature(at.first_hessian())
    best, weight, iteration = at, 1.0, 0
    while True:
        best = at if at.rank < best.rank else best
        if at.violation <= KEPT and at.steepness <= tolerance and np.max(at.s * at.y, initial=0.0) <= COMPLEMENTARY:
            return _run((at.x, at.f, at.h), curvature, iteration, SolveStatus.SOLVED)
        asked = progress is not None and progress(iteration, at.f, at.violation)
        late = stop_at is not None and time.monotonic() > stop_at
        kept = best.x, best.f, best.h
        if asked or late:
            word = "it was asked to stop" if asked else "its time was over"
            return _run(kept, curvature, iteration, SolveStatus.INTERRUPTED, word)
        if iteration == max_iterations:
            return _run(kept, curvature, iteration, SolveStatus.ITERATION_LIMIT)
        while barrier > LEAST_BARRIER and at.error(barrier) < NEARLY * barrier:
            barrier = max(LEAST_BARRIER, min(LESS * barrier, barrier**POWER))
        after, weight = _step(problem, at, curvature.H, barrier, weight)
        if after is None:
            if cold:
                word = "no step along the search direction lowers the cost"
                return _run(kept, curvature, iteration, SolveStatus.FAILED, word)
            curvature, cold = Curvature(at.first_hessian()), True
            continue
        curvature.update(after.x - at.x, after.gradient - at.gradient + after.y @ after.A - after.y @ at.A)
        at, iteration, cold = after, iteration + 1, False


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Unknowns x, cost f, rows h with slacks s and multipliers y, and derivatives there."""

    x: Array
    f: float
    h: Array
    s: Array
    y: Array
    gradient: Array
    A: Array

    @cached_property
    def violation(self) -> float:
        return _violation(self.h)

    @cached_property
    def rank(self) -> tuple[float, float]:
        """By violation, and among those that keep their rows by the cost."""
        return max(self.violation, KEPT), self.f

    @cached_property
    def size(self) -> Array:
        """(n,) step of each unknown that changes some row by 1 and none by more."""
        most = np.max(np.abs(self.A), axis=0, initial=0.0)
        return 1 / np.where(most > 0, most, 1.0)

    @cached_property
    def steepness(self) -> float:
        """Of the Lagrangian, along any one unknown."""
        return float(np.max(np.abs(self.gradient + self.y @ self.A) * self.size))

    def error(self, barrier: float) -> float:
        """Of the conditions for a minimum with a barrier."""
        complementary = np.max(np.abs(self.s * self.y - barrier), initial=0.0)
        return max(self.steepness, float(complementary), float(np.max(np.abs(self.h + self.s), initial=0.0)))

    def first_hessian(self) -> Array:
        """Diagonal, such that the step without rows has the length FIRST in units of `size`."""
        steep = max(float(np.linalg.norm(self.gradient * self.size)), ROUNDING)
        return np.diag(steep / FIRST / self.size**2)


def _start(problem: ManyRows, x: Array, barrier: float) -> _Iterate | None:
    f, h = problem.value(x)
    if not (np.isfinite(f) and np.all(np.isfinite(h))):
        return None
    s = np.maximum(-h, LEAST_SLACK)
    return _Iterate(x, f, h, s, barrier / s, *problem.derivatives(x))


def _step(problem: ManyRows, at: _Iterate, H: Array, barrier: float, weight: float) -> tuple[_Iterate | None, float]:
    """The next iterate, None where none is better, and the weight of violations in the merit function."""
    r, s, y, A = at.h + at.s, at.s, at.y, at.A
    try:
        with np.errstate(all="ignore"):
            condensed = H + (A.T * (y / s)) @ A
        factor = scipy.linalg.cho_factor(condensed)
    except (np.linalg.LinAlgError, ValueError):  # not positive definite or no numbers, as of slacks that vanish
        return None, weight
    dx = scipy.linalg.cho_solve(factor, -at.gradient - (barrier / s + y / s * r) @ A)
    ds = -r - A @ dx
    dy = barrier / s - y - y / s * ds
    share = max(SHARE, 1 - barrier)
    length, missed = _longest(s, ds, share), float(np.sum(np.abs(r)))
    slope = float(at.gradient @ dx - barrier * np.sum(ds / s))
    if missed > 0:
        weight = max(weight, (slope + dx @ H @ dx / 2) / (PENALTY * missed), 2 * float(np.max(y)))

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
                return _Iterate(x, f, h, new, y, *problem.derivatives(x)), weight
        length /= 2
    return None, weight


def _longest(values: Array, change: Array, share: float) -> float:
    """The part of a change, at most 1, that leaves positive values positive."""
    falls = change < 0
    return min(1.0, share * float(np.min(-values[falls] / change[falls], initial=1 / share)))


def _violation(h: Array) -> float:
    worst = float(np.max(h, initial=0.0))
    return np.inf if np.isnan(worst) else worst


def _run(
    kept: tuple[Array, float, Array], curvature: Curvature, iterations: int, status: SolveStatus, word: str = ""
) -> InteriorRun:
    """`kept`: unknowns, cost and rows."""
    x, f, h = kept
    message = "solved" if status.ok else f"{status.message} ({word})" if word else status.message
    return InteriorRun(x, f, _violation(h), curvature, iterations, status, message)
