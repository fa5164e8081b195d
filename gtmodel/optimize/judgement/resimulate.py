"""Re-simulation of the optimal input with an error-controlled integrator, and control polynomials between points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.polynomial import polynomial

from ...results.interpolation import CubicHermite
from ...results.status import SolveStatus
from ...results.trajectory import Trajectory
from ..collocation import pointwise
from ..formulation.dynamic import DynamicProblem
from ..formulation.system import RateSystem, on_rows
from ..mesh import Mesh, coefficients, control_basis
from ..nlp import Nlp, mesh_cost, placed
from ..solution import Solution, constants, horizon, named, states_and_controls, totals


def control_range(nlp: Nlp, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest values (controls,) of the control polynomials anywhere in their elements.

    A polynomial bounded at its points only may overshoot between them, most at an element's ends.
    """
    mesh, u = nlp.mesh, nlp.physical(x)[:, nlp.element.layout.u]  # (elements, coefficients, controls)

    def basis_at(s: np.ndarray) -> np.ndarray:
        return control_basis(mesh.control, mesh.table, s)

    values = basis_at(np.concatenate([[0.0, 1.0], mesh.table.points])) @ u
    low, high = values.min((0, 1), initial=np.inf), values.max((0, 1), initial=-np.inf)
    degree = coefficients(mesh.control, mesh.table) - 1
    if degree > 1 and u.size:
        fitted = np.linspace(0.0, 1.0, degree + 1) if mesh.control != "polynomial" else mesh.table.points
        columns = (basis_at(fitted) @ u).transpose(1, 0, 2).reshape(degree + 1, -1)
        slopes = polynomial.polyder(polynomial.polyfit(fitted, columns, degree))
        extrema = [polynomial.polyroots(slope) for slope in slopes.T]
        indices = np.repeat(np.arange(len(extrema)), [len(points) for points in extrema])
        roots = np.concatenate(extrema)
        s = np.real(roots)
        inside = np.isreal(roots) & (s > 0) & (s < 1)
        element, control = np.divmod(indices[inside], u.shape[2])
        extremes = np.sum(basis_at(s[inside]) * u[element, :, control], axis=1)
        np.minimum.at(low, control, extremes)
        np.maximum.at(high, control, extremes)
    return low, high


def control_curves(nlp: Nlp, x: np.ndarray, per_element: int = 15) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) [s] and values (n, controls) of the controls in every element, for plots.

    Each edge occurs twice, with the values of both neighbours, since a control may jump there.
    """
    t0, tf = horizon(nlp, x)
    local = np.linspace(0.0, 1.0, per_element)
    mesh = placed(nlp, x)
    s = (mesh.edges[:-1, None] + mesh.h[:, None] * local).ravel()
    return t0 + s * (tf - t0), np.concatenate(nlp.inputs(x, local)[..., : nlp.element.layout.nu])


# far below the collocation error to be measured, far above rounding
INTEGRATOR_TOLERANCE = 1e-10
SUBSTEPS = 8  # reported points per element: enough to resolve overshoots of a cubic control


@dataclass(frozen=True, eq=False)
class Resimulation:
    """Result of `resimulate`: the response of the model to the solution's input.

    trajectory: from the integrator; None if it did not reach the end.
    end_error: integrated minus collocated value at the end (SI units), by state name.
    defect: largest difference at any mesh edge, in nominals.
    violation: the excess over a bound or path constraint, also between the nodes (SI units), that is largest relative
        to the row's range; `violated`: the row's name.
    cost_error: integrated minus collocated cost.
    control_range: exact lowest and highest value of each control over all instants, by name.
    violation_unit, violation_time: unit of the row ("" if unknown) and instant of its excess [s].
    violation_share: the excess over the row's range: the distance of its bounds; with one bound only, the bound's size
        or the nominal, whichever is larger.
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
    violation_unit: str = ""
    violation_time: float = np.nan
    violation_share: float = 0.0


def resimulate(solution: Solution, tolerance: float = INTEGRATOR_TOLERANCE) -> Resimulation:
    """Integrate the solution's input with CVODES from the solution's start and compare: a cross-check of the mesh.

    tolerance: of the integrator, relative and absolute, in nominals. If the integrator fails, the status of the result
    is failed and the message gives the time.

    >>> class Move(gt.Optimization):
    ...     x = gt.variable(start=0.0, fixed=True)
    ...     u = gt.input(min=-2.0, max=2.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.u - self.x**3
    ...     def objective(self):
    ...         return gt.integral((self.x - 1.0) ** 2 + self.u**2)
    >>> found = gt.resimulate(gt.solve(Move(), gt.Mesh(10)))
    >>> abs(found.end_error["x"]) < 1e-6
    True
    """
    nlp, problem = solution.nlp, solution.problem
    t0, tf = horizon(nlp, solution.x)
    P = constants(nlp, solution.x)
    mesh = placed(nlp, solution.x)
    edges, h = mesh.edges, mesh.h
    low, high = control_range(nlp, solution.x)
    ranges = dict(zip(problem.control_names, zip(low.tolist(), high.tolist(), strict=True), strict=True))
    fine = np.linspace(0.0, 1.0, SUBSTEPS + 1)
    states, unknowns, cost, sums = _integrate(solution, tolerance, mesh)
    if len(states) < mesh.elements:
        time = t0 + edges[len(states)] * (tf - t0)
        return Resimulation(
            SolveStatus.FAILED,
            f"the integrator stopped at {time:.6g} s: the input drives the model out of its range",
            None, {}, np.inf, np.inf, "", np.inf, ranges,
        )  # fmt: skip
    # both ends of every element: a control may jump at an edge
    s = (edges[:-1, None] + h[:, None] * fine).reshape(-1)
    s[-1] = 1.0
    xs, us = np.vstack(states), np.concatenate(_external_inputs(nlp, solution.x, fine))
    times = t0 + s * (tf - t0)
    system, zs = RateSystem.of(problem), np.vstack(unknowns)
    rates, us = system.at(xs, us, zs, P, times)
    at_both_ends = times, xs, rates

    def path(k: int) -> CubicHermite:
        rows = slice(k * len(fine), (k + 1) * len(fine))
        return CubicHermite(*(a[rows] for a in at_both_ends))

    def integrated(s: float) -> tuple[np.ndarray, ...]:
        """Return state, rate, inputs and time at a fraction of the horizon."""
        k, t = mesh.element_at(s), t0 + s * (tf - t0)
        x, local = path(k)(np.array([t]))[0], (s - edges[k]) / h[k]
        z = np.array([np.interp(local, fine, column) for column in unknowns[k].T])
        xd, u = system.at(x[None], _external_inputs(nlp, solution.x, np.array([local]))[k], z[None], P, np.array([t]))
        return x, xd[0], u[0], np.array(t)

    excess = _violation(problem, xs, rates, us, times, P, low, high)
    # from here on one row per instant: at an edge that of the left element
    unique = np.delete(np.arange(len(s)), np.arange(1, mesh.elements) * len(fine))
    s, xs, us, times, rates = s[unique], xs[unique], us[unique], times[unique], rates[unique]
    at_edges = np.arange(0, len(s), SUBSTEPS)
    xs_c = states_and_controls(nlp, solution.x, s[at_edges])[0]
    end = dict(zip(problem.state_names, (xs[-1] - xs_c[-1]).tolist(), strict=True))
    defect = float(np.max(np.abs(xs[at_edges] - xs_c) / problem.x_scale, initial=0.0))
    if problem.quadratures:
        sums, sums_c = sums[unique], totals(nlp, solution.x, s[at_edges])
        end |= dict(zip(problem.quadrature_names, (sums[-1] - sums_c[-1]).tolist(), strict=True))
        size = [problem.flat.variables[q.index].nominal for q in problem.quadratures]
        defect = max(defect, float(np.max(np.abs(sums[at_edges] - sums_c) / size)))
    trajectory = named(problem, xs, rates, us, times, P, sums)
    cost += _mayer(solution, integrated, P) + mesh_cost(nlp, solution.x)
    cost_error = cost - float(nlp.nlp(solution.x, [])[0])
    return Resimulation(
        SolveStatus.SOLVED, "re-simulated", trajectory, end, defect, excess.value, excess.name, cost_error, ranges,
        excess.unit, excess.time, excess.share,
    )  # fmt: skip


def _external_inputs(nlp: Nlp, x: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Return controls and delayed inputs (elements, len(local), n) at fractions of each element."""
    return nlp.inputs(x, local)[..., : nlp.element.layout.nu + len(nlp.problem.delayed)]


def _integrate(
    solution: Solution, tolerance: float, mesh: Mesh
) -> tuple[list[np.ndarray], list[np.ndarray], float, np.ndarray]:
    """Return states (SUBSTEPS + 1, nx) and unknowns without a closed form per element until the integrator stops, the
    integral cost, and the cost states (elements * (SUBSTEPS + 1), n)."""
    nlp = solution.nlp
    layout = nlp.element.layout
    t0, tf = horizon(nlp, solution.x)
    P = constants(nlp, solution.x)
    integrator = make_integrator(nlp, tolerance, sums=True)
    total = np.array([q.start for q in nlp.problem.quadratures])
    sums: list[np.ndarray] = []
    x = states_and_controls(nlp, solution.x, np.array([0.0]))[0][0]
    z = _first_unknowns(solution, x, t0, P)
    states, unknowns, cost = [], [], 0.0
    nd = len(nlp.problem.delayed)
    for k in range(mesh.elements):
        y = solution.x[k * layout.size : (k + 1) * layout.size] * layout.scale
        inputs = np.concatenate([y[layout.u].reshape(-1), y[layout.z[:, :nd]].reshape(-1)])
        p = np.concatenate([[t0 + mesh.edges[k] * (tf - t0), mesh.h[k] * (tf - t0)], inputs, P])
        try:
            result = integrator(x0=x if len(x) else 0.0, z0=z, p=p)
        except RuntimeError:
            break
        states.append(np.vstack([x, np.asarray(result["xf"].full()).T[:, : len(x)]]))
        zf = np.asarray(result["zf"].full()).reshape(len(z), -1).T if len(z) else np.zeros((SUBSTEPS, 0))
        unknowns.append(np.vstack([zf[:1], zf]))  # left end as at the first step, since the input may jump there
        x, z = states[-1][-1], zf[-1] if len(z) else z
        quad = np.asarray(result["qf"].full())
        cost += float(quad[0, -1])
        sums.append(np.vstack([total, total + quad[1:].T]))
        total = sums[-1][-1]
    return states, unknowns, cost, np.vstack(sums) if sums else np.zeros((0, len(total)))


def _first_unknowns(solution: Solution, x: np.ndarray, t0: float, P: np.ndarray) -> np.ndarray:
    """Return start values for the unknowns without a closed form: the solution's, corrected by Newton's method."""
    nlp, problem = solution.nlp, solution.problem
    system = RateSystem.of(problem)
    if not system.count:
        return np.zeros(0)
    first = placed(nlp, solution.x).h[0] * nlp.mesh.table.points[0]
    _, slope, inputs, _ = states_and_controls(nlp, solution.x, np.array([first]))
    z = system.near(problem, inputs, slope)
    return system.solved(x[None], _external_inputs(nlp, solution.x, np.zeros(1))[0], z, P, np.array([t0]))[0]


def _mayer(solution: Solution, integrated: Callable[[float], tuple[np.ndarray, ...]], P: np.ndarray) -> float:
    """Return the Mayer cost from the re-simulated values at its instants."""
    problem = solution.problem
    values = []
    for i in problem.instants:
        x, rate, u, t = integrated(i.s)
        values.append(float(ca.Function("instant", problem.arguments, [i.expression])(x, rate, u, P, t)))
    symbols = ca.vertcat(*[i.symbol for i in problem.instants]) if values else ca.SX(0, 1)
    return float(ca.Function("mayer", [symbols, problem.P], [problem.mayer])(values, P))


def make_integrator(nlp: Nlp, tolerance: float, outputs: Sequence[float] = (), sums: bool = False) -> ca.Function:
    """Return CVODES (IDAS if equations have no closed form) over one element, with outputs at fractions of it.

    Its quadrature is the integral cost and, with `sums`, the cost states.

    p = [left end of the element [s], its length [s], control coefficients, delayed inputs at the points, P].
    """
    problem, mesh, layout = nlp.problem, nlp.mesh, nlp.element.layout
    nu, nd, m, k = layout.nu, len(problem.delayed), layout.u.shape[0], mesh.points
    s = ca.SX.sym("s")
    left, length = ca.SX.sym("left"), ca.SX.sym("length")
    U, D = ca.SX.sym("U", nu * m), ca.SX.sym("D", nd * k)
    u = _combined(_polynomials(mesh.control, mesh, s), U, nu)
    delayed = _combined(_polynomials("polynomial", mesh, s), D, nd)
    P = ca.SX.sym("P", problem.P.numel())
    t = left + s * length
    system = RateSystem.of(problem)
    z = ca.SX.sym("z", system.count)
    inputs = ca.vertcat(u, delayed)
    rates, point_variables = system.values(problem.x, inputs, z, P, t)
    point = pointwise(problem)(problem.x, rates, ca.vertcat(inputs, point_variables), P, t)
    weights = ca.DM([w for _, _, w in problem.integrals]) if problem.integrals else ca.DM(0, 1)
    quad = length * ca.dot(weights, point[3]) if problem.integrals else ca.SX(0)
    if sums:
        cost_rates = problem.integrands(problem.x, rates, ca.vertcat(inputs, point_variables), P, t)
        quad = ca.vertcat(quad, length * cost_rates)
    dae = {"x": problem.x, "p": ca.vertcat(left, length, U, D, P), "t": s, "ode": length * rates, "quad": quad}
    if not problem.x.numel():  # CVODES needs a state
        dae |= {"x": ca.SX.sym("nothing"), "ode": ca.SX(0)}
    options = {"abstol": tolerance, "reltol": tolerance, "quad_err_con": True, "max_num_steps": 100000}
    options |= {"verbose": False, "disable_internal_warnings": True, "show_eval_warnings": False}
    if system.count:
        dae |= {"z": z, "alg": system.residual(problem.x, inputs, z, P, t)[0]}
    grid = list(outputs) or np.linspace(0.0, 1.0, SUBSTEPS + 1)[1:].tolist()
    return ca.integrator("resimulate", "idas" if system.count else "cvodes", dae, 0.0, grid, options)


def _combined(values: list[ca.SX], numbers: ca.SX, width: int) -> ca.SX:
    """Return the sum of functions times rows of numbers."""
    return sum((v * numbers[j * width : (j + 1) * width] for j, v in enumerate(values)), ca.SX.zeros(width, 1))


def _polynomials(control: str, mesh: Mesh, s: ca.SX) -> list[ca.SX]:
    """Return the functions of control_basis in the symbol s."""
    if control == "constant":
        return [ca.SX(1)]
    if control == "linear":
        return [1 - s, s]
    c = mesh.table.points
    k = len(c)
    if control == "bernstein":
        return [comb(k - 1, j) * s**j * (1 - s) ** (k - 1 - j) for j in range(k)]
    values = []
    for j in range(k):
        term = ca.SX(1)
        for i in range(k):
            if i != j:
                term = term * (s - float(c[i])) / float(c[j] - c[i])
        values.append(term)
    return values


class _Excess(NamedTuple):
    """The excess of a row over its bound [SI units], its unit, its instant [s], and its share of the row's range."""

    name: str
    value: float
    unit: str
    time: float
    share: float


def _violation(
    problem: DynamicProblem, xs: np.ndarray, rates: np.ndarray, us: np.ndarray, times: np.ndarray, P: np.ndarray,
    u_low: np.ndarray, u_high: np.ndarray,
) -> _Excess:  # fmt: skip
    """Return the excess with the largest share."""
    path = on_rows(pointwise(problem), (xs, rates, us), P, times)[2].T
    values = np.hstack([xs, us, path.reshape(len(times), -1)])
    lowest, highest = np.min(values, axis=0), np.max(values, axis=0)
    nx, nu = xs.shape[1], len(u_low)  # the controls' extremes are exact, the rest is sampled
    lowest[nx : nx + nu], highest[nx : nx + nu] = u_low, u_high
    low = np.concatenate([problem.x_bounds.low, problem.u_bounds.low, [r.low for r in problem.path]])
    high = np.concatenate([problem.x_bounds.high, problem.u_bounds.high, [r.high for r in problem.path]])
    names = [*problem.state_names, *problem.control_names, *problem.point_names, *(r.label for r in problem.path)]
    if not names:
        return _Excess("", 0.0, "", np.nan, 0.0)
    nominals = np.concatenate([problem.x_scale, problem.u_scale, [r.scale for r in problem.path]])
    excess = np.maximum(np.maximum(low - lowest, highest - high), 0.0)
    shares = excess / _ranges(low, high, nominals)
    n = int(np.argmax(shares))
    over = np.maximum(low[n] - values[:, n], values[:, n] - high[n])
    pairs = [*problem.state_pairs, *problem.input_pairs]
    unit = problem.flat.unit_of(*pairs[n]) if n < len(pairs) else ""
    unit = "" if unit == "?" else unit
    return _Excess(names[n], float(excess[n]), unit, float(times[np.argmax(over)]), float(shares[n]))


def _ranges(low: np.ndarray, high: np.ndarray, nominals: np.ndarray) -> np.ndarray:
    """Return the distance of two bounds; the size of a single one, or the nominal, whichever is larger."""
    both = np.isfinite(low) & np.isfinite(high) & (high > low)
    sizes = [np.where(np.isfinite(b), np.abs(b), 0.0) for b in (low, high)]
    single = np.maximum(np.maximum(*sizes), nominals)
    with np.errstate(invalid="ignore"):
        return np.where(both, high - low, single)
