"""Mesh refinement: split elements with a large error, merge elements with a small one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from ..._pickling import Portable
from ...lang.optimization import Delayed, Optimization
from ...lang.source import ModelError
from ..collocation import of_states
from ..formulation.system import RateSystem, on_rows
from ..mesh import Mesh, given_mesh
from ..nlp import placed
from ..solution import Solution, constants, states_and_controls
from ..solve import NotSolved, solve
from .discretisation import COST, NAME, discretisation

EXTRA = 2  # quadrature points per element beyond the collocation points: none of them is a collocation point
MOST_PIECES = 4
# two elements are merged if the expected error stays below this share of the tolerance
SPARE = 0.1
ALIKE = 3.0  # and if the ratio of their lengths is smaller than this
BETWEEN = 1e-4  # permitted violation of a limit on states between the points, relative to its range
INSIDE = np.linspace(0.0, 1.0, 9)  # fractions of an element at which limits are evaluated


@dataclass(frozen=True)
class Pass:
    """One solve of a refinement: elements, largest error in nominals, and elements split and pairs merged after it."""

    elements: int
    error: float
    objective: float
    iterations: int
    split: int = 0
    merged: int = 0


@dataclass(frozen=True, eq=False)
class Refinement(Portable):
    """Result of `refine`: the last solution with its error estimate per element, and the passes.

    errors: (elements,), in nominals. passes: one per solve; printing the object shows their table.
    excess: (elements,) largest violation of a limit on states between the points, relative to its range.
    """

    solution: Solution
    errors: np.ndarray
    passes: tuple[Pass, ...]
    tolerance: float
    excess: np.ndarray

    @property
    def reached(self) -> bool:
        """Whether it was solved, with errors below the tolerance and limits on states kept to 1e-4 of their range."""
        close = self.errors.max() <= self.tolerance and self.excess.max() <= BETWEEN
        return self.solution.status.ok and bool(close)

    def __str__(self) -> str:
        lines = ["pass  elements       error  split  merged  iterations  objective"]
        lines += [
            f"{n:4d}  {p.elements:8d}  {p.error:10.2e}  {p.split:5d}  {p.merged:6d}  {p.iterations:10d}  "
            f"{p.objective:.10g}"
            for n, p in enumerate(self.passes, 1)
        ]
        return "\n".join(lines)


def element_errors(solution: Solution) -> np.ndarray:
    """Return the error estimate (elements,): int |x' - f(x, u)| dt over each element for the worst state, in nominals.

    The quadrature points are not collocation points; algebraic unknowns without a closed form are solved at each.
    """
    nlp, problem = solution.nlp, solution.problem
    if not np.all(np.isfinite(solution.x)):  # after a failed solve
        return np.full(nlp.mesh.elements, np.inf)
    mesh = placed(nlp, solution.x)
    points, weights = legendre.leggauss(mesh.points + EXTRA)
    points, weights = (points + 1) / 2, weights / 2
    s = (mesh.edges[:-1, None] + mesh.h[:, None] * points).ravel()
    xs, xd, us, times = states_and_controls(nlp, solution.x, s)
    system, P = RateSystem.of(problem), constants(nlp, solution.x)
    inputs_given = us[:, : nlp.element.layout.nu + len(problem.delayed)]
    z = np.zeros((len(s), system.count))
    if system.count:
        # start from the nearest collocation point, since the polynomials overshoot
        nearest = np.abs(points[:, None] - mesh.table.points).argmin(axis=1)
        s_points = (mesh.edges[:-1, None] + mesh.h[:, None] * mesh.table.points[nearest]).ravel()
        _, slope, inputs, _ = states_and_controls(nlp, solution.x, s_points)
        z = system.near(problem, inputs, slope)
        z = system.solved(xs, inputs_given, z, P, times)
    rates, _ = system.at(xs, inputs_given, z, P, times)
    defect = np.abs(xd - rates) / problem.x_scale
    horizon = times[-1] - times[0] if len(times) > 1 else 0.0
    horizon /= s[-1] - s[0]
    defect = np.where(np.isfinite(defect), defect, np.inf)  # outside the range of the model between the points
    each = defect.reshape(mesh.elements, len(points), -1) * weights[None, :, None]
    return np.max(each.sum(axis=1), axis=1, initial=0.0) * mesh.h * horizon


def element_excess(solution: Solution) -> np.ndarray:
    """Return the largest violation (elements,) of a bound of a state or a path row of states anywhere in an element.

    It is relative to the range between the limits, or to the range of the values if there is one limit only.
    """
    nlp, problem = solution.nlp, solution.problem
    mesh = placed(nlp, solution.x)
    rows = [r for r in problem.path if of_states(problem, r)]
    if not np.all(np.isfinite(solution.x)):
        return np.full(mesh.elements, np.inf)
    s = (mesh.edges[:-1, None] + mesh.h[:, None] * INSIDE).ravel()
    xs, _, _, times = states_and_controls(nlp, solution.x, s)
    arguments = [problem.x, problem.P, problem.t]
    f = ca.Function("limited", arguments, [ca.vertcat(problem.x, *[r.expression for r in rows])])
    (values,) = on_rows(f, (xs,), constants(nlp, solution.x), times)
    low = np.concatenate([problem.x_bounds.low, [r.low for r in rows]])[:, None]
    high = np.concatenate([problem.x_bounds.high, [r.high for r in rows]])[:, None]
    span = np.where(np.isfinite(high - low) & (high > low), high - low, np.ptp(values, axis=1)[:, None])
    violation = np.maximum(np.maximum(low - values, values - high), 0.0)
    relative = np.divide(violation, span, out=np.zeros_like(violation), where=span > 0)
    return np.max(relative.reshape(len(values), mesh.elements, -1), axis=(0, 2), initial=0.0)


def refine(
    model: Optimization,
    mesh: Mesh | None = None,
    *,
    tolerance: float,
    passes: int = 8,
    most_elements: int = 1000,
    merge: bool = True,
    **options: Any,
) -> Refinement:
    """Refine the mesh from error estimates until the solution is accurate everywhere.

    The solution is accurate if the estimated error of each element is below the tolerance, limits on states are
    violated between the points by at most 1e-4 of their range, and the solution's checks of its mesh pass.

    Args:
        tolerance: bound of the error estimate, in nominals.
        passes: largest number of solves.
        most_elements: largest number of elements; see `reached` of the result.
        merge: merge neighbours whose estimate is far below the tolerance, in the first half of the passes.
        options: options of `solve`.

    Each pass starts from the last solution and splits elements into up to four. With throw=False, a failed pass ends
    the refinement: `solution` of the result is that pass's, and `solution.message` names the pass. Models
    with delayed inputs are rejected, since their mesh edges must follow the delay. Raises what solve() raises, and
    ValueError for a tolerance that is not positive or a mesh with blocks.

    >>> class Stiff(gt.Optimization):  # a fast decay, then hardly anything
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     u = gt.input(min=-1.0, max=1.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == -50.0 * self.x + self.u
    ...     def objective(self):
    ...         return gt.integral(self.x**2 + self.u**2)
    >>> found = gt.refine(Stiff(), gt.Mesh(4), tolerance=1e-4)
    >>> found.reached, bool(found.errors.max() < 1e-4)
    (True, True)
    """
    if not tolerance > 0:
        raise ValueError(f"the tolerance of refine() must be positive; found {tolerance:g}")
    mesh = Mesh(10) if mesh is None else given_mesh(mesh)
    if mesh.blocks is not None:
        raise ValueError("refine() changes the number of elements, which blocks fix; remove blocks")
    _refuse_delays(model)
    throw = bool(options.pop("throw", True))
    solution = solve(model, mesh, throw=throw, **options)
    history: list[Pass] = []
    while True:
        errors, excess = element_errors(solution), element_excess(solution)
        last = Pass(len(errors), float(errors.max()), solution.objective, solution.iterations)
        if not solution.status.converged:
            return Refinement(solution, errors, (*history, last), tolerance, excess)
        worse = np.maximum(errors, tolerance * np.maximum(excess / BETWEEN, _unresolved(solution)))
        # a merged pair may violate a limit and be split again: the second half of the passes only splits
        merging = merge and len(history) < passes // 2
        lengths, split, merged = _next_lengths(placed(solution.nlp, solution.x), worse, tolerance, merging)
        done = worse.max() <= tolerance or len(history) + 1 >= passes or len(lengths) > most_elements
        history.append(last if done else replace(last, split=split, merged=merged))
        if done:
            return Refinement(solution, errors, tuple(history), tolerance, excess)
        options["guess"] = solution
        finer = replace(mesh, elements=len(lengths), lengths=tuple(lengths))
        solution = solve(model, finer, throw=False, **options)
        if not solution.status.converged:
            message = f"pass {len(history) + 1} of refine(): {solution.message}"
            solution = replace(solution, message=message)
            if throw:
                raise NotSolved(solution)


def _unresolved(solution: Solution) -> np.ndarray:
    """Return each element's contribution to failed checks, relative to its share of their bounds; else zeros."""
    estimate = discretisation(solution.nlp, solution.x)
    worse = np.zeros(len(estimate.elements))
    for name, added in ((NAME, estimate.elements), (COST, np.abs(estimate.missed))):
        check = solution.checks[name]
        if not check.passed and check.bound is not None and 0 < added.sum() < np.inf:
            worse = np.maximum(worse, added * len(added) / added.sum() * (check.value / check.bound))
    return worse


def _refuse_delays(model: Optimization) -> None:
    """Raise ModelError for a model with delayed inputs."""
    delayed = [n for n, item in getattr(type(model), "_declared", {}).items() if isinstance(item, Delayed)]
    if delayed:
        raise ModelError(
            f"{type(model).__name__}: refine() moves mesh edges, but the delay of '{delayed[0]}' fixes them; use "
            "gt.solve on a finer mesh"
        )


def _next_lengths(mesh: Mesh, errors: np.ndarray, tolerance: float, merge: bool) -> tuple[list[float], int, int]:
    """Return the next mesh's lengths and the numbers of elements split and pairs merged.

    The error of an element is assumed proportional to h^(points + 1).
    """
    order, h = mesh.points + 1, mesh.h
    lengths: list[float] = []
    split = merged = k = 0
    while k < len(h):
        if errors[k] > tolerance:
            pieces = int(max(2, np.ceil(min(MOST_PIECES, (errors[k] / tolerance) ** (1 / order)))))
            lengths += [h[k] / pieces] * pieces
            split += 1
        elif merge and k + 1 < len(h) and _mergeable(errors[k : k + 2], h[k : k + 2], order, tolerance):
            lengths.append(h[k] + h[k + 1])
            merged += 1
            k += 1
        else:
            lengths.append(float(h[k]))
        k += 1
    return lengths, split, merged


def _mergeable(errors: np.ndarray, h: np.ndarray, order: int, tolerance: float) -> bool:
    expected = np.max(errors * (h.sum() / h) ** order)
    return bool(expected < SPARE * tolerance and h.max() < ALIKE * h.min())
