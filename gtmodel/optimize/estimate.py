"""Estimated constants and initial states with their covariance, from the least-squares problem that was solved."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import stats
from scipy.sparse import bmat, csc_matrix, identity
from scipy.sparse.linalg import splu

from ..lang.source import ModelError
from .dynamic import DynamicProblem
from .nlp import instants, placed
from .solution import Solution

# added to the information, relative to its largest entry: what the data do not determine shows as this alone
REGULAR = 1e-13
# variances that this part of the regularisation makes up are not told by the data
UNTOLD = 1e-3
AT_BOUND = 1e-6  # of a scaled unknown: it stands at its bound, where it is held
LEAST_SQUARES = 1e-6  # relative: the objective is the misfit and nothing else
ROUNDING = 1e-24  # of the data's squares: more than the squared rounding of a residual that vanishes
# at random values of all that the objective holds, the rest besides misfits has no slopes beyond rounding
SAME, SEED, TRIALS = 1e-9, 0, 2


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated quantities with their covariance, in SI units.

    `names`: free constants, and states at the start as "x at the start". `covariance` (n, n) is that of linearised
    least squares (Gauss-Newton), `freedom` the number of measured values beyond the estimated quantities, `noise` the
    standard deviation of the residuals (1 expected where sigma was given). `held` stand at a bound: no covariance.
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    freedom: int
    noise: float
    known_noise: bool
    residuals: np.ndarray
    held: tuple[str, ...]

    @property
    def std(self) -> np.ndarray:
        """Standard deviations (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        return self.covariance / np.outer(self.std, self.std)

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval: normal where sigma was given, else Student's t with `freedom`. Raises ValueError."""
        if name not in self.names:
            raise ValueError(f"'{name}' was not estimated; these were: {', '.join(self.names)}")
        if not 0 < level < 1:
            raise ValueError(f"a confidence level lies between 0 and 1; found {level:g}")
        k = self.names.index(name)
        q = stats.norm.ppf((1 + level) / 2) if self.known_noise else stats.t.ppf((1 + level) / 2, self.freedom)
        return float(self.values[k] - q * self.std[k]), float(self.values[k] + q * self.std[k])

    def __str__(self) -> str:
        width = max(len(n) for n in self.names)
        lines = [f"{'':{width}s}  {'value':>14s}  {'std':>10s}  95 % interval"]
        for k, name in enumerate(self.names):
            low, high = self.interval(name)
            lines.append(f"{name:{width}s}  {self.values[k]:14.7g}  {self.std[k]:10.3g}  {low:.7g} .. {high:.7g}")
        lines += [f"{name} is held at its bound" for name in self.held]
        return "\n".join([*lines, f"{len(self.residuals)} measured values, residual noise {self.noise:.4g}"])


def estimate(solution: Solution) -> Estimate:
    """Covariance of what an Optimization with gt.misfit(...) as its objective has estimated.

    Raises ModelError if the solve failed, the objective is no misfit or holds more, too few values were measured, or
    the data do not determine some of the quantities; these are named.
    """
    nlp, problem = solution.nlp, solution.problem
    title = problem.flat.title
    if not solution.status.ok:
        raise ModelError(f"{title}: there is no estimate without a solution: {solution.message}")
    if not problem.misfits:
        raise ModelError(f"{title}: the objective holds no gt.misfit(...), so there is nothing to estimate from")
    if len({m.known for m in problem.misfits}) > 1:
        raise ModelError(f"{title}: give sigma to all misfits, or to none")
    residual, index, places = _residuals(solution)
    r, slope = (np.asarray(v.full()) for v in residual(solution.x[index]))
    r = r.reshape(-1)
    data = _data(problem)
    rounding = ROUNDING * float(data @ data)
    beside = abs(r @ r - solution.objective) > LEAST_SQUARES * (abs(solution.objective) + r @ r) + rounding
    if beside or _holds_more(solution):
        raise ModelError(
            f"{title}: the objective holds more than misfits; the covariance is that of least squares only"
        )
    row, column = np.repeat(np.arange(len(r)), len(places)), np.tile(index[places], len(r))
    J = csc_matrix((slope[:, places].ravel(), (row, column)),
                   shape=(len(r), nlp.size))  # fmt: skip
    A, variables = _active(solution)
    J, n = csc_matrix(J[:, variables]), len(variables)
    held_rows = A.get_shape()[0]
    freedom = len(r) - (n - held_rows)
    known = problem.misfits[0].known
    if freedom < 0 or (freedom == 0 and not known):
        raise ModelError(f"{title}: {len(r)} measured values for {n - held_rows} unknowns; measure more, or give sigma")
    names, columns, scale, values, held = _quantities(solution, variables)
    if not names:
        raise ModelError(f"{title}: nothing is free to be estimated; declare gt.free constants or leave a start free")
    information = (J.T @ J).tocsc()
    small = REGULAR * float(information.diagonal().max(initial=0.0))
    kkt = bmat([[information + small * identity(n), A.T], [A, None]], format="csc")
    chosen = np.zeros((n + held_rows, len(columns)))
    chosen[columns, np.arange(len(columns))] = 1.0
    try:
        covariance = splu(kkt).solve(chosen)[columns]
    except RuntimeError:
        raise ModelError(
            f"{title}: the constraints are redundant at the solution; remove those that repeat others"
        ) from None
    _require_told(title, covariance, small, names)
    noise = float(np.sqrt(r @ r / freedom)) if freedom else 1.0
    covariance = (covariance + covariance.T) / 2 * np.outer(scale, scale) * (1.0 if known else noise**2)
    return Estimate(tuple(names), values, covariance, freedom, noise, known, r, tuple(held))


def _data(problem: DynamicProblem) -> np.ndarray:
    """The measured values in units of the residuals."""
    r = ca.vertcat(*[m.residual for m in problem.misfits])
    symbols = ca.symvar(r)
    return np.asarray(ca.Function("data", symbols, [r])(*[0.0] * len(symbols))).reshape(-1)


def _holds_more(solution: Solution) -> bool:
    """Does the objective bend or slope otherwise than the misfits anywhere, though it may be theirs at the optimum?"""
    problem, blocks = solution.problem, solution.nlp.mesh.blocks
    if any(weight != 0.0 for _, _, weight in problem.integrals):
        return True
    if blocks is not None and any(blocks.step_penalty.values()):
        return True
    misfit = ca.sumsqr(ca.vertcat(*[m.residual for m in problem.misfits]))
    symbols = ca.vertcat(*ca.symvar(ca.vertcat(misfit, problem.mayer)))
    rest = problem.mayer - misfit
    derivatives = []
    for e in (rest, misfit):
        bend, slope = ca.hessian(e, symbols)
        derivatives += [ca.densify(ca.horzcat(bend, slope))]
    f = ca.Function("rest", [symbols], derivatives)
    rng = np.random.default_rng(SEED)
    for _ in range(TRIALS):
        more, own = (np.abs(v.full()) for v in f(rng.uniform(0.5, 1.5, symbols.numel())))
        if not np.all(more <= SAME * own):
            return True
    return False


def _residuals(solution: Solution) -> tuple[ca.Function, np.ndarray, np.ndarray]:
    """z -> residuals and their slopes, where z stands among the unknowns, and which of z matter."""
    nlp, problem = solution.nlp, solution.problem
    held = instants(problem, placed(nlp, solution.x), nlp.element.layout, nlp.p_scale, [])
    r = ca.substitute([ca.vertcat(*[m.residual for m in problem.misfits])], [held.old], [held.new])[0]
    touched = np.array(sorted(set(ca.jacobian_sparsity(r, held.z).get_triplet()[1])), int)
    return ca.Function("residuals", [held.z], [r, ca.densify(ca.jacobian(r, held.z))]), held.index, touched


def _active(solution: Solution) -> tuple[csc_matrix, np.ndarray]:
    """Slopes of all rows that hold with equality, in the unknowns that are free to move."""
    nlp, x = solution.nlp, solution.x
    g, jacobian = nlp.functions["jac_g"](x, [])
    g = np.asarray(g).reshape(-1)
    near = (np.abs(g - nlp.lbg) <= AT_BOUND) | (np.abs(g - nlp.ubg) <= AT_BOUND)
    pressed = np.abs(solution.multipliers) > AT_BOUND
    rows = np.flatnonzero((nlp.lbg == nlp.ubg) | (near & pressed))
    at_bound = (np.minimum(x - nlp.lbx, nlp.ubx - x) <= AT_BOUND) & (np.abs(solution.bound_multipliers) > AT_BOUND)
    variables = np.flatnonzero(~((nlp.lbx == nlp.ubx) | at_bound))
    sparsity = jacobian.sparsity()
    matrix = csc_matrix(
        (np.array(jacobian.nonzeros()), np.array(sparsity.row()), np.array(sparsity.colind())), shape=sparsity.shape
    )
    return csc_matrix(matrix[rows][:, variables]), variables


def _quantities(
    solution: Solution, variables: np.ndarray
) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Names, columns among the free unknowns, scales and values of what is estimated; names of what is held."""
    nlp, problem = solution.nlp, solution.problem
    column = {int(v): n for n, v in enumerate(variables)}
    free = problem.free_names
    asked = [(nlp.constants + n, name, nlp.p_scale[n]) for n, name in enumerate(free)]
    states = [name for name in problem.state_names[: len(problem.state_pairs)]]
    asked += [(n, f"{name} at the start", problem.x_scale[n]) for n, name in enumerate(states)]
    found = [(name, column[i], s, solution.x[i] * s) for i, name, s in asked if i in column]
    held = [name for i, name, _ in asked if i not in column and nlp.lbx[i] != nlp.ubx[i]]
    columns, scales, values = (np.array([f[k] for f in found]) for k in (1, 2, 3))
    return [f[0] for f in found], columns.astype(int), scales, values, held


def _require_told(title: str, covariance: np.ndarray, small: float, names: list[str]) -> None:
    """Raises ModelError naming the quantities whose variance is the regularisation's."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    if small > 0 and values[-1] * small < UNTOLD:
        return
    weight = np.abs(vectors[:, -1])
    shown = [n for n, w in zip(names, weight, strict=True) if w > 0.05 * weight.max()]
    raise ModelError(
        f"{title}: the data do not determine {' and '.join(shown)}"
        f"{' apart from each other' if len(shown) > 1 else ''}; fix one of them, or measure something else"
    )
