"""The optimum tried out: its input through an error-controlled integrator, from the same start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .element import pointwise
from .nlp import Nlp
from .overshoot import control_range, controls_of
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
    control_range: lowest and highest value of each control at any instant, by name; exact.
    """

    status: SolveStatus
    message: str
    trajectory: Trajectory | None
    end_error: dict[str, float]
    defect: float
    violation: float
    violated: str
    cost_error: float
    control_range: dict[str, tuple[float, float]]


def resimulate(solution: Solution, tolerance: float = INTEGRATOR_TOLERANCE) -> Resimulation:
    """Integrate the solution's input with CVODES and compare."""
    nlp, problem = solution.nlp, solution.problem
    t0, tf = horizon(nlp, solution.x)
    P = constants(nlp, solution.x)
    mesh = nlp.mesh
    edges, h = mesh.edges, mesh.h
    low, high = control_range(nlp, solution.x)
    ranges = dict(zip(problem.control_names, zip(low.tolist(), high.tolist(), strict=True), strict=True))
    fine = np.linspace(0.0, 1.0, SUBSTEPS + 1)
    states, cost = _integrate(solution, tolerance)
    if len(states) < mesh.elements:
        time = t0 + edges[len(states)] * (tf - t0)
        return Resimulation(
            SolveStatus.FAILED,
            f"the integrator stopped after {time:.6g} s: the input leads out of the model's range",
            None, {}, np.inf, np.inf, "", np.inf, ranges,
        )  # fmt: skip
    # both ends of every element: a control may jump at an edge
    s = (edges[:-1, None] + h[:, None] * fine).reshape(-1)
    s[-1] = 1.0
    xs, us = np.vstack(states), np.vstack([controls_of(nlp, solution.x, k, fine) for k in range(mesh.elements)])
    times = t0 + s * (tf - t0)
    rate = _rates(problem)
    rates = rate.map(len(s))(xs.T, us.T, ca.repmat(ca.DM(P), 1, len(s)), ca.DM(times).T).full().T
    rows = [slice(k * len(fine), (k + 1) * len(fine)) for k in range(mesh.elements)]
    paths = [CubicHermiteSpline(times[r], xs[r], rates[r]) for r in rows]

    def integrated(s: float) -> tuple[np.ndarray, ...]:
        """State, rate, control and time at a fraction of the horizon."""
        k, t = mesh.element_at(s), t0 + s * (tf - t0)
        x, u = paths[k](t), controls_of(nlp, solution.x, k, np.array([(s - edges[k]) / h[k]]))[0]
        return x, np.asarray(rate(x, u, P, t)).reshape(-1), u, np.array(t)

    violation, name = _violation(problem, xs, rates, us, times, P, low, high)
    # one row per instant from here on: at an edge that of the element on its left
    kept = np.delete(np.arange(len(s)), np.arange(1, mesh.elements) * len(fine))
    s, xs, us, times, rates = s[kept], xs[kept], us[kept], times[kept], rates[kept]
    at_edges = np.arange(0, len(s), SUBSTEPS)
    xs_c = states_and_controls(nlp, solution.x, s[at_edges])[0]
    end = dict(zip(problem.state_names, (xs[-1] - xs_c[-1]).tolist(), strict=True))
    defect = float(np.max(np.abs(xs[at_edges] - xs_c) / problem.x_scale, initial=0.0))
    trajectory = named(problem, xs, rates, us, times, P)
    cost_error = cost + _mayer(solution, integrated, P) - float(nlp.nlp(solution.x, [])[0])
    return Resimulation(
        SolveStatus.SOLVED, "re-simulated", trajectory, end, defect, violation, name, cost_error, ranges
    )


def _integrate(solution: Solution, tolerance: float) -> tuple[list[np.ndarray], float]:
    """States (SUBSTEPS + 1, nx) in each element, up to where the integrator stops, and the integral cost."""
    nlp = solution.nlp
    mesh, layout = nlp.mesh, nlp.element.layout
    t0, tf = horizon(nlp, solution.x)
    P = constants(nlp, solution.x)
    integrator = _integrator(nlp, tolerance)
    x = states_and_controls(nlp, solution.x, np.array([0.0]))[0][0]
    states, cost = [], 0.0
    for k in range(mesh.elements):
        y = solution.x[k * layout.size : (k + 1) * layout.size] * layout.scale
        p = np.concatenate([[t0 + mesh.edges[k] * (tf - t0), mesh.h[k] * (tf - t0)], y[layout.u].reshape(-1), P])
        try:
            result = integrator(x0=x if len(x) else 0.0, p=p)
        except RuntimeError:
            break
        states.append(np.vstack([x, np.asarray(result["xf"].full()).T[:, : len(x)]]))
        x = states[-1][-1]
        cost += float(np.sum(np.asarray(result["qf"].full())[:, -1]))
    return states, cost


def _mayer(solution: Solution, integrated: Callable[[float], tuple[np.ndarray, ...]], P: np.ndarray) -> float:
    """The cost that is no integral, from the values at the instants it needs."""
    problem = solution.problem
    inputs = [problem.x, problem.xd, problem.u, problem.P, problem.t]
    values = []
    for i in problem.instants:
        x, rate, u, t = integrated(i.s)
        values.append(float(ca.Function("instant", inputs, [i.expression])(x, rate, u, P, t)))
    symbols = ca.vertcat(*[i.symbol for i in problem.instants]) if values else ca.SX(0, 1)
    return float(ca.Function("mayer", [symbols, problem.P], [problem.mayer])(values, P))


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
    if not problem.x.numel():  # CVODES wants a state
        dae |= {"x": ca.SX.sym("nothing"), "ode": ca.SX(0)}
    options = {"abstol": tolerance, "reltol": tolerance, "quad_err_con": True, "max_num_steps": 100000}
    options |= {"verbose": False, "disable_internal_warnings": True, "show_eval_warnings": False}
    grid = np.linspace(0.0, 1.0, SUBSTEPS + 1)[1:].tolist()
    return ca.integrator("resimulate", "cvodes", dae, 0.0, grid, options)


def _violation(
    problem: DynamicProblem, xs: np.ndarray, rates: np.ndarray, us: np.ndarray, times: np.ndarray, P: np.ndarray,
    u_low: np.ndarray, u_high: np.ndarray,
) -> tuple[float, str]:  # fmt: skip
    n = len(times)
    path = pointwise(problem).map(n)(
        ca.DM(xs.T), ca.DM(rates.T), ca.DM(us.T), ca.repmat(ca.DM(P), 1, n), ca.DM(times).T
    )[2].full().T  # fmt: skip
    lowest, highest = (
        np.concatenate([f(xs, axis=0), u, f(path, axis=0) if path.size else []])
        for f, u in ((np.min, u_low), (np.max, u_high))
    )
    low = np.concatenate([problem.x_bounds.low, problem.u_bounds.low, [r.low for r in problem.path]])
    high = np.concatenate([problem.x_bounds.high, problem.u_bounds.high, [r.high for r in problem.path]])
    names = [*problem.state_names, *problem.control_names, *(r.label for r in problem.path)]
    if not names:
        return 0.0, ""
    excess = np.maximum(low - lowest, highest - high)
    worst = int(np.argmax(excess))
    return max(0.0, float(excess[worst])), names[worst]
