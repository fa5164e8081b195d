"""Estimated constants and initial states with their covariance, from a solved least-squares problem."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy

from ..lang.scope import Misfit
from ..lang.source import ModelError
from ..results.estimate import Estimate
from .formulation.scaling import objective_scale
from .linking import Joined
from .mesh import is_of
from .nlp import Nlp, instants, placed
from .phases import PhasesSolution
from .solution import Solution

# regularisation of the information matrix, relative to its largest diagonal entry
REGULAR = 1e-13
# a quantity is undetermined if the regularisation supplies at least this share of the information about it
UNDETERMINED = 1e-3
AT_BOUND = 1e-6  # a scaled unknown this close to its bound is active
LEAST_SQUARES = 1e-6  # relative tolerance for objective == misfit
ROUNDING = 1e-24  # of the sum of squared data: above the squared rounding error of a vanishing residual
# objective - misfit must have no derivatives beyond rounding, tested at random values
SAME, SEED, TRIALS = 1e-9, 0, 2


@dataclass(frozen=True, eq=False)
class _Fit:
    """The solved problem: one Optimization, or linked phases with the index of the first unknown of each."""

    title: str
    parts: tuple[tuple[str, Solution, int], ...]
    program: Nlp | Joined
    whole: Solution | PhasesSolution

    @classmethod
    def of(cls, solution: Solution | PhasesSolution) -> _Fit:
        if isinstance(solution, PhasesSolution):
            parts = [
                (f"{n}: ", s, int(k)) for (n, s), k in zip(solution.phases.items(), solution.joined.at, strict=False)
            ]
            title = " and ".join(s.problem.flat.title for s in solution.phases.values())
            return cls(title, tuple(parts), solution.joined, solution)
        title = solution.problem.flat.title
        if solution.linked:
            raise ModelError(
                f"{title} is one of several linked phases; its links and shared constants are missing here. Call "
                "gt.estimate(...) with the PhasesSolution from solve_phases()"
            )
        return cls(title, (("", solution, 0),), solution.nlp, solution)

    @property
    def misfits(self) -> list[Misfit]:
        return [m for _, s, _ in self.parts for m in s.problem.misfits]


def estimate(solution: Solution | PhasesSolution) -> Estimate:
    """Return the constants that an Optimization estimated, with their covariance.

    solution: the solution of an Optimization whose objective consists of gt.misfit(...) only, or the PhasesSolution of
    linked phases. With phases, names are "phase: name"; a shared constant is listed under its first phase.

    Raises ModelError if the solve failed, the objective contains no misfit or other terms as well, too few values were
    measured, the data do not determine some quantities (the message names them), or the solution is that of a single
    linked phase.

    >>> times = np.linspace(0.1, 1.0, 10)
    >>> rng = np.random.default_rng(3)
    >>> measured = np.exp(-2.0 * times) + 0.01 * rng.standard_normal(10)  # synthetic: seed 3
    >>> class Decay(gt.Optimization):
    ...     rate = gt.free(1.0, min=0.0, unit="1/s")
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     def equations(self):
    ...         yield gt.der(self.x) == -self.rate * self.x
    ...     def objective(self):
    ...         return gt.misfit(self.x, times, measured)
    >>> found = gt.estimate(gt.solve(Decay(), gt.Mesh(4)))
    >>> found.names, found.values.shape, found.covariance.shape
    (('rate',), (1,), (1, 1))
    >>> low, high = found.interval("rate")  # of 95 %
    >>> bool(low < 2.0 < high)
    True
    """
    fit = _Fit.of(solution)
    title = fit.title
    if not solution.status.ok:
        raise ModelError(f"{title} was not solved, so there is no estimate: {solution.message}")
    if not fit.misfits:
        raise ModelError(f"{title}: the objective contains no gt.misfit(...); add one to estimate constants")
    if len({m.known for m in fit.misfits}) > 1:
        raise ModelError(f"{title}: give sigma to all misfits, or to none")
    r, J = _residuals(fit)
    data = _data(fit.misfits)
    rounding = ROUNDING * float(data @ data)
    mismatch = abs(r @ r - solution.objective) > LEAST_SQUARES * (abs(solution.objective) + r @ r) + rounding
    if mismatch or any(_holds_more(s) for _, s, _ in fit.parts):
        raise ModelError(
            f"{title}: the objective contains terms other than misfits; the covariance holds for least squares only"
        )
    A, variables = _active(fit)
    J, n = scipy.sparse.csc_matrix(J[:, variables]), len(variables)
    held_rows = A.get_shape()[0]
    degrees_of_freedom = len(r) - (n - held_rows)
    known = fit.misfits[0].known
    if degrees_of_freedom < 0 or (degrees_of_freedom == 0 and not known):
        raise ModelError(f"{title}: {len(r)} measured values for {n - held_rows} unknowns; add data, or give sigma")
    names, columns, scale, values, at_bounds = _quantities(fit, variables)
    if not names:
        raise ModelError(f"{title} has no quantity to estimate; declare gt.free constants or leave a start value free")
    information = (J.T @ J).tocsc()
    small = REGULAR * float(information.diagonal().max(initial=0.0))
    kkt = scipy.sparse.bmat([[information + small * scipy.sparse.identity(n), A.T], [A, None]], format="csc")
    selection = np.zeros((n + held_rows, len(columns)))
    selection[columns, np.arange(len(columns))] = 1.0
    try:
        covariance = scipy.sparse.linalg.splu(kkt).solve(selection)[columns]
    except RuntimeError:
        raise ModelError(f"{title}: constraints are redundant at the solution; remove the dependent ones") from None
    _require_determined(title, covariance, small, names)
    noise = float(np.sqrt(r @ r / degrees_of_freedom)) if degrees_of_freedom else 1.0
    covariance = (covariance + covariance.T) / 2 * np.outer(scale, scale) * (1.0 if known else noise**2)
    return Estimate(tuple(names), values, covariance, degrees_of_freedom, noise, known, r, tuple(at_bounds))


def _data(misfits: list[Misfit]) -> np.ndarray:
    """Return the measured values in the units of the residuals."""
    r = ca.vertcat(*[m.residual for m in misfits])
    symbols = ca.symvar(r)
    return np.asarray(ca.Function("data", symbols, [r])(*[0.0] * len(symbols))).reshape(-1)


def _holds_more(solution: Solution) -> bool:
    """Return whether the objective has terms besides misfits, even ones that vanish at the optimum."""
    problem, mesh = solution.problem, solution.nlp.mesh
    if any(weight != 0.0 for _, _, weight in problem.integrals):
        return True
    if mesh.length_cost is not None or (mesh.blocks is not None and any(mesh.blocks.step_penalty.values())):
        return True
    if not problem.misfits:
        return bool(ca.symvar(problem.mayer))
    misfit = ca.sumsqr(ca.vertcat(*[m.residual for m in problem.misfits]))
    symbols = ca.vertcat(*ca.symvar(ca.vertcat(misfit, problem.mayer)))
    rest = problem.mayer - misfit
    derivatives = []
    for e in (rest, misfit):
        hessian, gradient = ca.hessian(e, symbols)
        derivatives += [ca.densify(ca.horzcat(hessian, gradient))]
    f = ca.Function("rest", [symbols], derivatives)
    rng = np.random.default_rng(SEED)
    for _ in range(TRIALS):
        excess, reference = (np.abs(v.full()) for v in f(rng.uniform(0.5, 1.5, symbols.numel())))
        if not np.all(excess <= SAME * reference):
            return True
    return False


def _residuals(fit: _Fit) -> tuple[np.ndarray, scipy.sparse.csc_matrix]:
    """Return the residuals and their Jacobian with respect to all unknowns."""
    values: list[np.ndarray] = []
    blocks: list[scipy.sparse.csc_matrix] = []
    for _, s, _ in fit.parts:
        nlp, problem = s.nlp, s.problem
        values_at = instants(problem, placed(nlp, s.x), nlp.element.layout, nlp.p_scale, [])
        r = ca.vertcat(*[m.residual for m in problem.misfits]) if problem.misfits else ca.SX(0, 1)
        if values_at.old.numel():
            r = ca.substitute([r], [values_at.old], [values_at.new])[0]
        columns = np.array(sorted(set(ca.jacobian_sparsity(r, values_at.z).get_triplet()[1])), int)
        f = ca.Function("residuals", [values_at.z], [r, ca.densify(ca.jacobian(r, values_at.z))])
        value, jacobian = (np.asarray(v.full()) for v in f(s.x[values_at.index]))
        values.append(value.reshape(-1))
        n = len(values[-1])
        row, column = np.repeat(np.arange(n), len(columns)), np.tile(values_at.index[columns], n)
        blocks.append(scipy.sparse.csc_matrix((jacobian[:, columns].ravel(), (row, column)), shape=(n, nlp.size)))
    return np.concatenate(values), scipy.sparse.csc_matrix(scipy.sparse.block_diag(blocks))


def _active(fit: _Fit) -> tuple[scipy.sparse.csc_matrix, np.ndarray]:
    """Return the Jacobian of all active rows with respect to the unknowns not at a bound, and those unknowns."""
    nlp, solution, x = fit.program, fit.whole, fit.whole.x
    g, jacobian = nlp.functions["jac_g"](x, [])
    g = np.asarray(g).reshape(-1)
    near = (np.abs(g - nlp.lbg) <= AT_BOUND) | (np.abs(g - nlp.ubg) <= AT_BOUND)
    slight = AT_BOUND / objective_scale(nlp, x, fit.misfits)  # multipliers are in the objective's units
    loaded = np.abs(solution.multipliers) > slight
    rows = np.flatnonzero((nlp.lbg == nlp.ubg) | (near & loaded))
    at_bound = (np.minimum(x - nlp.lbx, nlp.ubx - x) <= AT_BOUND) & (np.abs(solution.bound_multipliers) > slight)
    variables = np.flatnonzero(~((nlp.lbx == nlp.ubx) | at_bound))
    sparsity = jacobian.sparsity()
    matrix = scipy.sparse.csc_matrix(
        (np.array(jacobian.nonzeros()), np.array(sparsity.row()), np.array(sparsity.colind())), shape=sparsity.shape
    )
    return scipy.sparse.csc_matrix(matrix[rows][:, variables]), variables


def _quantities(fit: _Fit, variables: np.ndarray) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Return names, columns, scales and values of the estimated quantities, and names of those held at a bound.

    Start states that continue the previous phase are left out.
    """
    column = {int(v): n for n, v in enumerate(variables)}
    candidates: list[tuple[int, str, float]] = []
    names_so_far: set[str] = set()
    shared = fit.program.shared if isinstance(fit.program, Joined) else ()
    links = {r.label for r in fit.program.links} if isinstance(fit.program, Joined) else set()
    for prefix, s, offset in fit.parts:
        nlp, problem = s.nlp, s.problem
        for k, name in enumerate(problem.free_names):
            if name not in names_so_far or not any(is_of(c, name) for c in shared):
                candidates.append((offset + nlp.constants + k, f"{prefix}{name}", float(nlp.p_scale[k])))
            names_so_far.add(name)
        for k, name in enumerate(problem.state_names[: len(problem.state_pairs)]):
            if f"{name} continues into '{prefix.removesuffix(': ')}'" not in links:
                candidates.append((offset + k, f"{prefix}{name} at the start", float(problem.x_scale[k])))
    x, low, high = fit.whole.x, fit.program.lbx, fit.program.ubx
    rows = [(name, column[i], s, x[i] * s) for i, name, s in candidates if i in column]
    at_bounds = [name for i, name, _ in candidates if i not in column and low[i] != high[i]]
    columns, scales, values = (np.array([f[k] for f in rows]) for k in (1, 2, 3))
    return [f[0] for f in rows], columns.astype(int), scales, values, at_bounds


def _require_determined(title: str, covariance: np.ndarray, small: float, names: list[str]) -> None:
    """Raise ModelError naming the quantities whose variance comes from the regularisation."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    if small > 0 and values[-1] * small < UNDETERMINED:
        return
    weight = np.abs(vectors[:, -1])
    undetermined = [n for n, w in zip(names, weight, strict=True) if w > 0.05 * weight.max()]
    raise ModelError(
        f"{title}: the data do not determine {' and '.join(undetermined)}"
        f"{' separately' if len(undetermined) > 1 else ''}; fix one of them, or add other measurements"
    )
