"""The optimum tried out: its input through an error-controlled integrator, from the same start."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .element import pointwise
from .nlp import Nlp
from .problem import DynamicProblem
from .solution import Solution, constants, horizon, named, states_and_controls

# far below the collocation error that is to be measured, far above round-off
INTEGRATOR_TOLERANCE = 1e-10
SUBSTEPS = 8  # reported points per element: overshoots of a cubic control are seen


@dataclass(frozen=True, eq=False)
class Resimulation:
    """What the input really does.

    end_error: by state name, integrated minus collocated value at the end (SI units).
    defect: largest difference at any mesh edge, in nominals.
    violation: largest excess over a bound or path constraint anywhere between the nodes (SI units), and
    `violated`, its name; cost_error: integrated minus collocated cost.
    """

    status: SolveStatus
    message: str
    trajectory: Trajectory | None
    end_error: dict[str, float]
    defect: float
    violation: float
    violated: str
    cost_error: float


def resimulate(solution: Solution, tolerance: float = INTEGRATOR_TOLERANCE) -> Resimulation:
    """Integrate the solution's input with CVODES and compare."""
    nlp, problem = solution.nlp, solution.problem
    t0, tf = horizon(nlp, solution.x)
    P = constants(nlp, solution.x)
    integrator = _integrator(nlp, tolerance)
    mesh, layout = nlp.mesh, nlp.element.layout
    edges, h = mesh.edges, mesh.h
    fine = np.linspace(0.0, 1.0, SUBSTEPS + 1)
    xs0, _, _, _ = states_and_controls(nlp, solution.x, np.array([0.0]))
    x = xs0[0]
    s_all, states, cost = [0.0], [x], 0.0
    for k in range(mesh.elements):
        y = solution.x[k * layout.size : (k + 1) * layout.size] * layout.scale
        u = y[layout.u].reshape(-1)
        p = np.concatenate([[t0 + edges[k] * (tf - t0), h[k] * (tf - t0)], u, P])
        try:
            result = integrator(x0=x, p=p)
        except RuntimeError:
            time = t0 + edges[k] * (tf - t0)
            return Resimulation(
                SolveStatus.FAILED,
                f"the integrator stopped after {time:.6g} s: the input leads out of the model's range",
                None, {}, np.inf, np.inf, "", np.inf,
            )  # fmt: skip
        grid = np.asarray(result["xf"].full())
        s_all += (edges[k] + h[k] * fine[1:]).tolist()
        states += list(grid.T)
        x = grid[:, -1]
        cost += float(np.sum(np.asarray(result["qf"].full())[:, -1]))
    s = np.array(s_all)
    s[-1] = 1.0
    xs = np.array(states)
    xs_c, _, us, times = states_and_controls(nlp, solution.x, s)
    rates = _rates(problem).map(len(s))(xs.T, us.T, ca.repmat(ca.DM(P), 1, len(s)), ca.DM(times).T).full().T
    end = dict(zip(problem.state_names, (xs[-1] - xs_c[-1]).tolist(), strict=True))
    edges_rows = np.arange(0, len(s), SUBSTEPS)
    defect = float(np.max(np.abs(xs - xs_c)[edges_rows] / problem.x_scale, initial=0.0))
    violation, name = _violation(problem, xs, rates, us, times, P)
    collocated = _collocated_integral(solution)
    trajectory = named(problem, xs, rates, us, times, P)
    return Resimulation(
        SolveStatus.SOLVED, "re-simulated", trajectory, end, defect, violation, name, cost - collocated
    )


def _rates(problem: DynamicProblem) -> ca.Function:
    own = problem.builder.explicit_rates()
    extra = [r for r in problem.rates[len(own) :] if r is not None]
    exprs = [*own, *extra]
    if own and extra:
        exprs = ca.substitute(exprs, [problem.xd[: len(own)]], [ca.vertcat(*own)])
    return ca.Function("rates", [problem.x, problem.u, problem.P, problem.t], [ca.vertcat(*exprs)])


def _integrator(nlp: Nlp, tolerance: float) -> ca.Function:
    problem, mesh = nlp.problem, nlp.mesh
    nu, k = problem.u.numel(), mesh.points
    s = ca.SX.sym("s")
    left, length = ca.SX.sym("left"), ca.SX.sym("length")
    U = ca.SX.sym("U", nu * k)
    if nu == 0:
        u = ca.SX(0, 1)
    elif mesh.control == "constant":
        u = U[:nu]
    else:
        # Lagrange polynomials of the collocation points in the symbol s
        c = mesh.table.points
        values = []
        for j in range(k):
            term = ca.SX(1)
            for i in range(k):
                if i != j:
                    term = term * (s - float(c[i])) / float(c[j] - c[i])
            values.append(term)
        u = sum((values[j] * U[j * nu : (j + 1) * nu] for j in range(k)), ca.SX.zeros(nu, 1))
    P = ca.SX.sym("P", problem.P.numel())
    t = left + s * length
    rates = _rates(problem)(problem.x, u, P, t)
    point = pointwise(problem)(problem.x, rates, u, P, t)
    weights = ca.DM([w for _, _, w in problem.integrals]) if problem.integrals else ca.DM(0, 1)
    quad = length * ca.dot(weights, point[3]) if problem.integrals else ca.SX(0)
    dae = {"x": problem.x, "p": ca.vertcat(left, length, U, P), "t": s, "ode": length * rates, "quad": quad}
    options = {"abstol": tolerance, "reltol": tolerance, "quad_err_con": True, "max_num_steps": 100000, "verbose": False}
    options["disable_internal_warnings"] = True
    grid = np.linspace(0.0, 1.0, SUBSTEPS + 1)[1:].tolist()
    return ca.integrator("resimulate", "cvodes", dae, 0.0, grid, options)


def _violation(
    problem: DynamicProblem, xs: np.ndarray, rates: np.ndarray, us: np.ndarray, times: np.ndarray, P: np.ndarray
) -> tuple[float, str]:
    n = len(times)
    path = pointwise(problem).map(n)(
        ca.DM(xs.T), ca.DM(rates.T), ca.DM(us.T), ca.repmat(ca.DM(P), 1, n), ca.DM(times).T
    )[2].full().T  # fmt: skip
    values = np.hstack([xs, us, path]) if path.size else np.hstack([xs, us])
    low = np.concatenate([problem.x_bounds.low, problem.u_bounds.low, [r.low for r in problem.path]])
    high = np.concatenate([problem.x_bounds.high, problem.u_bounds.high, [r.high for r in problem.path]])
    names = [*problem.state_names, *problem.control_names, *(r.label for r in problem.path)]
    if not names:
        return 0.0, ""
    excess = np.max(np.maximum(low - values, values - high), axis=0)
    worst = int(np.argmax(excess))
    return max(0.0, float(excess[worst])), names[worst]


def _collocated_integral(solution: Solution) -> float:
    nlp = solution.nlp
    layout, N = nlp.element.layout, nlp.mesh.elements
    f = ca.Function("cost", [nlp.element.y, nlp.element.P, nlp.element.d], [nlp.element.cost])
    P = constants(nlp, solution.x)
    Y = solution.x[: N * layout.size].reshape(N, layout.size).T
    D = np.vstack([nlp.mesh.h, nlp.mesh.edges[:-1]])
    return float(np.sum(f.map(N)(ca.DM(Y), ca.repmat(ca.DM(P), 1, N), ca.DM(D)).full()))



