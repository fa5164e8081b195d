"""Discretisation error of the collocated states, estimated for every solution, including narrow features of functions
of time that the collocation points miss."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from ...compiler.analysis.bounds import edges_of
from ...results.status import SolveStatus
from ..formulation.dynamic import DynamicProblem
from ..formulation.system import RateSystem, on_rows
from ..mesh import CollocationTable, Mesh, basis, basis_slope, table
from ..nlp import Nlp, placed
from ..shooting import TOLERANCE
from ..solution import Check, Solution, constants, horizon
from .checks import Remark, class_place, objective_place, variable_place

# of an element: shorter smooth segments may lie between two points of the rule
NARROW = 0.1
# limit on the number of segments; of a ripple with more, a part suffices
MOST = 20_000
# Gauss points of each segment
NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)

# (element, fractions of it (n,)) -> rates (n, nx) and integrands (n, q)
Along = Callable[[int, np.ndarray], tuple[np.ndarray, np.ndarray]]


def bends(
    system: RateSystem, integrands: ca.Function, P: np.ndarray, edges: np.ndarray, t0: float, duration: float
) -> dict[int, np.ndarray]:
    """Return, by element, the corners (fractions 0 to 1) of functions of time with segments shorter than NARROW.

    integrands: (x, rates, u, P, t) -> integrands of the objective; edges: (N + 1,) element edges, 0 to 1.
    """
    functions = [(f, f.n_in() - 2, f.n_in() - 1) for f in (system.values, integrands)]
    functions = [(f, p, t) for f, p, t in functions if any(f.jac_sparsity(k, t).nnz() for k in range(f.n_out()))]
    if not functions:
        return {}
    columns, time = [], ca.SX.sym("t")
    for f, p, _ in functions:
        arguments = [*f.sx_in()[:p], ca.SX(ca.DM(P)), time]
        columns += f.call(arguments)
    times = edges_of(ca.vertcat(*columns), time, t0, t0 + duration)
    if times.size > MOST:
        times = times[:MOST]
    places: dict[int, np.ndarray] = {}
    for k, (left, right) in enumerate(pairwise(edges.tolist())):
        inner = ((times - t0) / duration - left) / (right - left)
        inner = inner[(inner > 0) & (inner < 1)]
        if inner.size and np.min(np.diff(np.concatenate([[0.0], inner, [1.0]]))) < NARROW:
            places[k] = inner
    return places


def passed_over(
    places: np.ndarray, fine: CollocationTable, length: float, at_nodes: np.ndarray, element: int, along: Along
) -> tuple[np.ndarray, np.ndarray]:
    """Return what a rule on one element misses between its nodes: errors (M, nx) of the states at the nodes, and the
    integrals (q,) over the element.

    places: corners of functions of time; length: of the element [s]; at_nodes: rates (M, nx) at the nodes.
    """
    cuts = np.unique(np.concatenate([[0.0], places, fine.points, [1.0]]))
    half = 0.5 * np.diff(cuts)
    rates, integrands = along(element, (cuts[:-1, None] + half[:, None] * (1 + NODES)).ravel())
    weights = length * half[:, None] * WEIGHTS

    def sums(values: np.ndarray) -> np.ndarray:
        return np.einsum("ic,icx->ix", weights, values.reshape(*weights.shape, values.shape[-1]))

    exact = np.cumsum(sums(rates), axis=0)[np.searchsorted(cuts, fine.points) - 1]
    by_rule = np.linalg.solve(fine.derivative[1:].T, length * at_nodes)
    return exact - by_rule, sums(integrands).sum(axis=0)


NAME, COST = "discretisation_error", "integral_error"
# of a state's range: visible in a plot. Above it the trajectory does not satisfy the model; for smaller errors use
# refine()
BOUND = 1e-2
EXTRA = 2  # additional Radau points: four orders more at the element's end
# if the model amplifies the sum of the element errors by more than this it is unstable: its input does not determine
# the motion from the start, and the optimum solves a boundary value problem. The error is then the distance to the
# nearest motion from any start. On the tank and the van der Pol oscillator with 20, 50 and 100 elements this equals
# the error of the optimum
UNSTABLE = 30.0
ZERO_COST = 1e-6  # over the objective's scale: BOUND times this is the solver's tolerance
NOTHING = 1e-8  # of its nominal, the solver's tolerance: a state with a smaller range is constant


@dataclass(frozen=True, eq=False)
class Discretisation:
    """Estimated errors of the states at the mesh edges and collocation points, relative to each state's range.

    Args:
        error: the largest error.
        state: the state with this error; `time` [s]: its instant.
        elements: (elements,) the error that each element contributes.
        missed: (elements,) the quadrature error of the integrals in the objective on each element; `integral` is its
            sum relative to the integral of their absolute values.
        shadow: whether the error is the distance to the nearest motion of the model under the same input from any
            start (for unstable models), not to the motion from the solution's start.
    """

    error: float
    state: str
    time: float
    elements: np.ndarray
    missed: np.ndarray
    integral: float
    shadow: bool = False


def judged(solution: Solution, bound: float | None, exact: bool = False, scale: float = 1.0) -> Solution:
    """Add the error estimates to the checks; a solved solution above the bound gets status check_failed.

    exact: states and cost come from an error-controlled integrator, so there is nothing to estimate. scale: the
    solver's factor of the objective.
    """
    if exact:
        return solution.with_checks(**{NAME: Check(TOLERANCE, bound), COST: Check(TOLERANCE, bound)})
    estimate = discretisation(solution.nlp, solution.x, scale)
    solution = solution.with_checks(**{NAME: Check(estimate.error, bound), COST: Check(estimate.integral, bound)})
    if not solution.status.ok or (solution.checks[NAME].passed and solution.checks[COST].passed):
        return solution
    remark = coarse(estimate, bound, solution.nlp)
    return replace(
        solution, status=SolveStatus.CHECK_FAILED, message=f"{solution.message}, but {remark}", where=remark.where
    )


def coarse(estimate: Discretisation, bound: float | None, nlp: Nlp) -> Remark:
    """Return the remark on a mesh that is too coarse."""
    problem = nlp.problem
    advice = f"use more elements (mesh.elements is {nlp.mesh.elements}), or gt.optimize.refine"
    if not np.isfinite(estimate.error + estimate.integral):
        return Remark(
            f"the model's equations are not finite between the collocation points, so the error is unknown; {advice}",
            class_place(problem),
        )
    if bound is not None and estimate.error <= bound:
        return Remark(
            f"the mesh does not resolve the integral in the objective: its error is {estimate.missed.sum():.4g}, "
            f"{estimate.integral:.2g} of the integral of its absolute value (bound {bound:g}); {advice}",
            objective_place(problem),
        )
    than = "the nearest motion of the model" if estimate.shadow else "the model's response to the input"
    return Remark(
        f"the mesh does not resolve the model: '{estimate.state}' deviates by {estimate.error:.2g} of its range from "
        f"{than} at {estimate.time:.4g} s (bound {bound:g}); {advice}",
        variable_place(problem, estimate.state),
    )


class _Grid(NamedTuple):
    """Errors on each element at the finer rule's nodes: own (N, M, nx), and the sensitivity to an error at its left end
    (N, M, nx, nx)."""

    own: np.ndarray
    carried: np.ndarray


def discretisation(nlp: Nlp, x: np.ndarray, scale: float = 1.0) -> Discretisation:
    """Estimate the error of the scaled unknowns x of a collocation NLP; infinite if the equations are not finite.

    scale: the solver's factor of the objective.
    """
    mesh = placed(nlp, x)
    none, (t0, tf) = np.full(mesh.elements, np.inf), horizon(nlp, x)
    if not np.all(np.isfinite(x)) or not tf > t0:
        return Discretisation(np.inf, "", np.nan, none, none, np.inf)
    with np.errstate(all="ignore"):
        along = _along(nlp, x, mesh, t0, tf - t0)
        missed, part = _integrals(along, mesh, nlp.problem, scale)
        if not nlp.problem.state_names:
            return Discretisation(0.0, "", np.nan, 0.0 * mesh.h, missed, part)
        estimate = _estimate(along, nlp.problem, mesh, t0, tf - t0)
        estimate = estimate or Discretisation(np.inf, "", np.nan, none, missed, part)
        return replace(estimate, missed=missed, integral=part)


def _estimate(along: _Along, problem: DynamicProblem, mesh: Mesh, t0: float, duration: float) -> Discretisation | None:
    fine, length, rule, K = along.fine, along.length, mesh.table, mesh.points
    scale, (xs, rates, jacobian) = problem.x_scale, (along.states, along.rates, along.jacobian)
    size = np.maximum(ranges(problem, xs.reshape(-1, len(scale))), NOTHING * scale)
    # the solver's residuals at the collocation points are not errors of the mesh
    at_points = np.einsum("nix,ij->njx", xs[:, [K, *range(K)]], rule.derivative)
    noise = np.einsum("c,ncx->x", rule.weights, np.abs(at_points - length[:, None, None] * rates[:, :K])) / size
    defects = np.einsum("nix,ij->njx", xs[:, K:], fine.derivative) - length[:, None, None] * rates[:, K + 1 :]
    defects, jacobian = defects / scale, jacobian * (scale / scale[:, None]) * length[:, None, None, None]
    for k, (unseen, _) in along.unseen.items():  # its effect within the same element
        defects[k] -= np.einsum("jxy,jy->jx", jacobian[k], unseen / scale)
    grid = _errors(fine, defects, jacobian)
    if grid is None:
        return None
    for k, (unseen, _) in along.unseen.items():
        grid.own[k] += unseen / scale
    if not np.all(np.isfinite(grid.own)):
        return None
    parts, e = scale / size, _from_start(grid)
    added = np.max(np.abs(grid.own[:, -1]) * parts, axis=1).sum()
    shadow = not np.max(np.abs(e) * parts) <= UNSTABLE * added
    if shadow:
        e = _nearest(grid, parts)
    places = np.append(rule.points, 1.0)
    values = basis(fine.nodes, places)
    own_errors = np.einsum("pm,nmx->npx", values[:, 1:], grid.own)
    carried = np.einsum("pm,nmxy->npxy", values[:, 1:], grid.carried) + values[:, 0, None, None] * np.eye(len(scale))
    each = np.maximum(np.abs(own_errors) * parts - noise, 0.0).max(axis=(1, 2))
    errors = np.maximum(np.abs(own_errors + np.einsum("npxy,ny->npx", carried, e[:-1])) * parts - noise, 0.0)
    errors = np.where(np.isfinite(errors), errors, np.inf)
    k, p, n = (int(i) for i in np.unravel_index(int(np.argmax(errors)), errors.shape))
    time = float(t0 + (mesh.edges[k] + mesh.h[k] * places[p]) * duration)
    return Discretisation(float(errors[k, p, n]), problem.state_names[n], time, each, 0.0 * each, np.inf, shadow)


def _integrals(along: _Along, mesh: Mesh, problem: DynamicProblem, scale: float) -> tuple[np.ndarray, float]:
    """Return the quadrature error of the objective's integrals on each element, and the sum relative to the integral of
    their absolute values."""
    if not problem.integrals:
        return 0.0 * mesh.h, 0.0
    coefficients, K = np.array([w for _, _, w in problem.integrals]), mesh.points
    values = along.integrands * coefficients
    fine = np.einsum("c,ncq->n", along.fine.weights, values[:, K + 1 :])
    errors = along.length * (fine - np.einsum("c,ncq->n", mesh.table.weights, values[:, :K]))
    for k, (_, whole) in along.unseen.items():
        # the larger of both: the difference of the two rules may also reveal a control that is too coarse
        errors[k] = max(errors[k], errors[k] + whole @ coefficients - along.length[k] * fine[k], key=abs)
    size = np.einsum("c,n,ncq->", along.fine.weights, along.length, np.abs(values[:, K + 1 :]))
    if not np.all(np.isfinite(errors)):
        return errors, np.inf
    return errors, float(abs(errors.sum()) / max(float(size), ZERO_COST / scale))


def ranges(problem: DynamicProblem, xs: np.ndarray) -> np.ndarray:
    """Return the range (nx,) of each state in rows xs; entries of a vector share their largest range."""
    ranges = np.ptp(xs, axis=0)
    entries: dict[tuple[int, int], list[int]] = {}
    group = {i: n for n, (_, indices) in enumerate(problem.flat.groups.values()) for i in indices}
    for n, (index, order) in enumerate(problem.state_pairs):
        entries.setdefault((group.get(index, -1 - index), order), []).append(n)
    for columns in entries.values():
        ranges[columns] = ranges[columns].max()
    return ranges


@dataclass(frozen=True, eq=False)
class _Along:
    """The model along a solution, at P = K + 1 + M points of each element: the mesh's points, the left end and the
    nodes of the finer rule.

    states, rates: (N, P, nx); integrands: (N, P, integrals); jacobian: of the rates at the nodes (N, M, nx, nx);
    length: of the elements [s]; unseen: by element, errors (M, nx) at the nodes from features of functions of time that
    the finer rule misses, and the exact integrals (q,).
    """

    fine: CollocationTable
    length: np.ndarray
    states: np.ndarray
    rates: np.ndarray
    integrands: np.ndarray
    jacobian: np.ndarray
    unseen: dict[int, tuple[np.ndarray, np.ndarray]]


def _along(nlp: Nlp, x: np.ndarray, mesh: Mesh, t0: float, duration: float) -> _Along:
    problem, layout = nlp.problem, nlp.element.layout
    fine = table("radau", mesh.points + EXTRA)
    places = np.concatenate([mesh.table.points, fine.nodes])
    N, n, nx, first = mesh.elements, len(places), layout.nx, mesh.points + 1
    y = x[: nlp.end].reshape(N, layout.size) * layout.scale
    nodes = layout.nodes
    xs = np.einsum("pi,nix->npx", basis(mesh.table.nodes, places), y[:, nodes])
    inputs = layout.inputs(y, places).reshape(N * n, -1)
    given_inputs, P = inputs[:, : layout.nu + len(problem.delayed)], constants(nlp, x)
    times = t0 + (mesh.edges[:-1, None] + mesh.h[:, None] * places).ravel() * duration
    system, rows = RateSystem.of(problem), xs.reshape(N * n, nx)
    # unknowns from the nearest collocation point: their polynomials overshoot
    nearest = np.abs(places[:, None] - mesh.table.points).argmin(axis=1)
    begin = inputs.reshape(N, n, -1)[:, nearest].reshape(N * n, -1)
    slope = np.einsum("pi,nix->npx", basis_slope(mesh.table.nodes, mesh.table.points), y[:, nodes])
    slope /= (mesh.h * duration)[:, None, None]
    z = system.solved(rows, given_inputs, system.near(problem, begin, slope[:, nearest].reshape(N * n, nx)), P, times)
    rates, whole = system.at(rows, given_inputs, z, P, times)
    f = _integrands(problem)

    def integrated(*rows: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return integrands (rows, q) for rows of states, rates and inputs."""
        return on_rows(f, rows, P, times)[0].T

    integrands = integrated(rows, rates, whole, times=times) if problem.integrals else np.zeros((N * n, 0))
    at_nodes = (np.arange(N)[:, None] * n + np.arange(first, n)).ravel()
    jacobian = np.zeros((0, nx, nx))
    if nx:
        jacobian = system.jacobian(rows[at_nodes], given_inputs[at_nodes], z[at_nodes], P, times[at_nodes])
    rates, length = rates.reshape(N, n, nx), mesh.h * duration

    def rates_at(element: int, where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rates and integrands at fractions of one element."""
        states = basis(mesh.table.nodes, where) @ y[element, nodes]
        inputs = layout.inputs(y[element], where)[:, : given_inputs.shape[1]]
        near = np.abs(where[:, None] - places).argmin(axis=1)
        instants = t0 + (mesh.edges[element] + mesh.h[element] * where) * duration
        unknowns = system.solved(states, inputs, z.reshape(N, n, -1)[element, near], P, instants)
        r, everything = system.at(states, inputs, unknowns, P, instants)
        return r, integrated(states, r, everything, times=instants) if problem.integrals else np.zeros((len(where), 0))

    unseen = {
        k: passed_over(bent, fine, float(length[k]), rates[k, first:], k, rates_at)
        for k, bent in bends(system, f, P, mesh.edges, t0, duration).items()
    }
    return _Along(fine, length, xs, rates, integrands.reshape(N, n, -1), jacobian.reshape(N, n - first, nx, nx), unseen)


def _integrands(problem: DynamicProblem) -> ca.Function:
    return ca.Function("integrals", problem.arguments, [ca.vertcat(ca.SX(0, 1), *[e for _, e, _ in problem.integrals])])


def _errors(fine: CollocationTable, defects: np.ndarray, jacobian: np.ndarray) -> _Grid | None:
    """Take one Newton step of the finer rule from the defects (N, M, nx), with Jacobians (N, M, nx, nx)."""
    N, M, nx = defects.shape
    matrix = np.einsum("ji,xy->ixjy", fine.derivative[1:], np.eye(nx))[None].repeat(N, 0)
    for j in range(M):
        matrix[:, j, :, j] -= jacobian[:, j]
    right = np.concatenate(
        [-defects[..., None], np.broadcast_to(-fine.derivative[0][:, None, None] * np.eye(nx), (N, M, nx, nx))], axis=-1
    )
    try:
        errors = np.linalg.solve(matrix.reshape(N, M * nx, M * nx), right.reshape(N, M * nx, nx + 1))
    except np.linalg.LinAlgError:
        return None
    errors = errors.reshape(N, M, nx, nx + 1)
    return _Grid(errors[..., 0], errors[..., 1:])


def _from_start(grid: _Grid) -> np.ndarray:
    """Return errors (N + 1, nx) at the edges relative to the motion from the solution's start."""
    e = np.zeros((len(grid.own) + 1, grid.own.shape[2]))
    for k, (own, carried) in enumerate(zip(grid.own[:, -1], grid.carried[:, -1], strict=True)):
        e[k + 1] = own + carried @ e[k]
    return e


def _nearest(grid: _Grid, parts: np.ndarray) -> np.ndarray:
    """Return the errors (N + 1, nx) at the edges relative to the nearest motion of the model: least squares of the
    errors in units of the ranges."""
    local, carried = grid.own[:, -1] * parts, grid.carried[:, -1] * (parts[:, None] / parts)
    eye = np.eye(local.shape[1])
    # least norm subject to e[k + 1] - carried[k] e[k] = own[k]: block tridiagonal elimination from the start
    upper: list[np.ndarray] = []
    pivots: list[np.ndarray] = []
    right: list[np.ndarray] = []
    for k, phi in enumerate(carried):
        pivot, r = phi @ phi.T + eye, local[k]
        if k:
            factor = np.linalg.solve(pivots[-1], upper[-1]).T
            pivot, r = pivot - factor @ upper[-1], r - factor @ right[-1]
        pivots.append(pivot)
        right.append(r)
        upper.append(-carried[k + 1].T if k + 1 < len(carried) else eye)
    multipliers = np.zeros((len(local) + 1, local.shape[1]))
    for k in range(len(local) - 1, -1, -1):
        multipliers[k] = np.linalg.solve(pivots[k], right[k] - upper[k] @ multipliers[k + 1] * (k + 1 < len(local)))
    e = np.zeros_like(multipliers)
    e[1:] = multipliers[:-1]
    e[:-1] -= np.einsum("nyx,ny->nx", carried, multipliers[:-1])
    return e / parts
