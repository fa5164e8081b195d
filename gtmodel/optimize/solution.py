"""A solution read back by name: trajectory, free constants, cost, multipliers."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from .._lazy import hint
from .._pickling import Portable
from ..lang.scope import derivative_name
from ..lang.source import SourceLocation
from ..results.check import Check
from ..results.refusal import ArgumentError
from ..results.status import SolveStatus
from ..results.trajectory import Trajectory
from .collocation import DURATION, LengthTerms
from .formulation.dynamic import DynamicProblem
from .formulation.quadratures import summed
from .formulation.system import RateSystem, on_rows
from .ipopt import SolverRun
from .mesh import ROUND_OFF, Mesh, basis, basis_slope, control_basis
from .nlp import Nlp, placed

if TYPE_CHECKING:
    from matplotlib.figure import Figure
else:
    Figure = hint("matplotlib.figure", "Figure")


@dataclass(frozen=True, eq=False)
class Solution(Portable):
    """Result of `solve`.

    `trajectory`: every top-level quantity at the start and the collocation points, in SI units; a control polynomial is
    extrapolated to the start. `free`: the optimised constants by name. `seconds`: wall time by stage. `status` and
    `message`: how the solve ended. `checks`: the checks made. `reservation`: what remains open about a solved problem,
    such as whether the stationary point is a minimum; else empty. `where`: file and line the message refers to (a
    declaration, an equation, a constraint, the objective or the class); None if solved without reservation.
    """

    status: SolveStatus
    message: str
    objective: float
    iterations: int
    trajectory: Trajectory
    free: dict[str, float]
    nlp: Nlp = field(repr=False)
    x: np.ndarray = field(repr=False)
    multipliers: np.ndarray = field(repr=False)
    seconds: dict[str, float]
    checks: dict[str, Check] = field(default_factory=dict)
    bound_multipliers: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)
    reservation: str = ""
    where: SourceLocation | None = None
    linked: bool = False  # one of several phases: the linking rows are not part of it

    def with_checks(self, **checks: Check) -> Solution:
        return replace(self, checks={**self.checks, **checks})

    def plot(self, *names: str) -> Figure:
        """Plot the named signals of the optimum over time, all if none is named; see `Trajectory.plot`."""
        return self.trajectory.plot(*names)

    @property
    def problem(self) -> DynamicProblem:
        return self.nlp.problem

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on a model from Modelica text, such as units that were not checked."""
        return type(self.problem.flat.root)._notes

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the parameters that `gt.transcribe(..., parameters=[...])` made tunable, by name, in SI units.

        Empty after `gt.solve`, where every parameter has the value of the model; `free` has the optimised constants.
        """
        values = constants(self.nlp, self.x)[len(self.problem.free_names) :]
        return dict(zip(self.problem.tunable, values.tolist(), strict=True))

    @property
    def sensitivity(self) -> dict[str, float]:
        """Derivative of the optimal cost with respect to each tunable parameter, in SI units (envelope theorem)."""
        nlp = self.nlp
        first = nlp.free.stop
        slope = np.asarray(nlp.functions["grad_f"](self.x, [])[1]).reshape(-1)[first:]
        jacobian = nlp.functions["jac_g"](self.x, [])[1][:, first:]
        slope = slope + np.asarray((jacobian.T @ ca.DM(self.multipliers)).full()).reshape(-1)
        return dict(zip(self.problem.tunable, (slope / nlp.p_scale[len(self.free) :]).tolist(), strict=True))

    def multiplier(self, name: str) -> np.ndarray | float:
        """Return the multipliers of a constraint in SI units and IPOPT's sign: cost per unit increase of its row.

        name: a name from `multiplier_names`, or its first whole words ("constraint 1" does not match the tenth). Shape:
        a number for a point constraint, (elements,) for the continuity of a state ("continuity of x": the costate at
        the element's end), (elements, points) for a path constraint; a vector adds a last axis. Divided by quadrature
        weight times element length, path multipliers approach the multiplier functions of time. Raises KeyError, which
        lists the names.
        """
        nlp = self.nlp
        m, N = nlp.element.rows.numel(), nlp.mesh.elements
        label = _matching_labels(name, self.multiplier_names)
        points = [n for n, row in enumerate(self.problem.points) if row.label in label]
        if points:
            sizes = np.array([self.problem.points[n].scale for n in points])
            values = self.multipliers[m * N + np.array(points)] / sizes
            return float(values[0]) if len(points) == 1 else values
        rows = [r for r, (row_name, _) in enumerate(nlp.element.row_names) if row_name in label]
        instants = list(dict.fromkeys(nlp.element.row_names[r][1] for r in rows))
        # entries of a vector side by side at each point
        rows.sort(key=lambda r: instants.index(nlp.element.row_names[r][1]))
        values = self.multipliers[: m * N].reshape(N, m)[:, rows] / self._row_scale()[rows]
        values = values.reshape(N, len(instants), -1)
        values = values[:, 0] if instants == [-1] else values
        return values[..., 0] if values.shape[-1] == 1 else values

    def _row_scale(self) -> np.ndarray:
        """Return the scale of each row of an element in SI units; order as in collocation.make_element."""
        problem, layout = self.problem, self.nlp.element.layout
        with_rate = [n for n, r in enumerate(problem.rates) if r is not None]
        each = np.concatenate([problem.x_scale[with_rate], problem.algebraic_scale])
        known = {f"{place}{r.label}": r.scale for r in problem.path for place in ("", "at the edge: ")}
        known[DURATION] = LengthTerms(problem, self.nlp.mesh).scale
        scale = np.array([known.get(label, 1.0) for label, _ in self.nlp.element.row_names])
        scale[: layout.nl] = layout.scale[layout.left]
        scale[layout.nl : layout.nl + len(each) * self.nlp.mesh.points] = np.tile(each, self.nlp.mesh.points)
        return scale

    @property
    def multiplier_names(self) -> tuple[str, ...]:
        """The names that multiplier() accepts."""
        points = [r.label for r in self.problem.points]
        return tuple(dict.fromkeys([*points, *(n for n, _ in self.nlp.element.row_names)]))

    def bound_multiplier(self, name: str) -> np.ndarray:
        """Return the multipliers of the bounds of a variable in SI units; positive at an upper bound.

        Shape (elements, points) for a state, algebraic variable or polynomial control at the collocation points,
        (elements, coefficients) for another control, (1, 1) for a free constant. A value shared by two elements counts
        once, at the end of the earlier one: a linear control's first coefficient has 0 in all elements but the first.
        A state fixed at the end of the horizon has no bound there. Raises KeyError, which lists the names.
        """
        problem, layout = self.problem, self.nlp.element.layout
        if name in problem.free_names:
            n = problem.free_names.index(name)
            return np.array([[self.bound_multipliers[self.nlp.free][n] / self.nlp.p_scale[n]]])
        columns = dict(zip(problem.state_names, layout.x.T, strict=True))
        # all coefficients of a blocked control are one unknown
        unknowns = [np.array(list(dict.fromkeys(c)), int) for c in layout.u.T.tolist()]
        columns |= dict(zip(problem.control_names, unknowns, strict=True))
        columns |= dict(zip(problem.point_names, layout.z.T, strict=True))
        if name not in columns:
            raise KeyError(f"no bounds belong to '{name}'; names are {', '.join([*columns, *problem.free_names])}")
        values = self.bound_multipliers[: self.nlp.end].reshape(-1, layout.size)
        multipliers = values[:, columns[name]] / layout.scale[columns[name]]
        twin = self._twin(name, int(columns[name][-1]))
        if twin is not None:
            # an element's end and the next one's left end are one quantity with two bounds
            scale, end = layout.scale[twin], self.nlp.end + twin
            if twin not in columns[name]:
                multipliers[:-1, -1] += values[1:, twin] / scale
            elif len(columns[name]) > 1:
                multipliers[:-1, -1] += multipliers[1:, 0]
                multipliers[1:, 0] = 0.0
            if self.nlp.lbx[end] < self.nlp.ubx[end]:
                multipliers[-1, -1] += self.bound_multipliers[end] / scale
        return multipliers

    def _twin(self, name: str, last: int) -> int | None:
        """Return the index, in the next element, of the value that is `last` in this one; None if it is not shared."""
        problem, layout, mesh = self.problem, self.nlp.element.layout, self.nlp.mesh
        if name in problem.state_names:
            ends = mesh.table.points[-1] == 1.0
            return int(layout.left[problem.state_names.index(name)]) if ends else None
        carried = dict(zip(layout.carries.tolist(), layout.carried.tolist(), strict=True))
        if name in problem.control_names:
            return carried.get(problem.control_names.index(name))
        return None

    @property
    def final_time(self) -> float:
        """End of the horizon [s]."""
        return float(self.trajectory.time[-1])

    def sample(self, s: np.ndarray) -> Trajectory:
        """Evaluate every named quantity on the collocation polynomials at increasing fractions s, 0 to 1, of the
        horizon.

        Raises ArgumentError for other fractions. For instants in seconds use `trajectory.resample`.
        """
        s = np.asarray(s, float)
        outside = s[~((s >= -ROUND_OFF) & (s <= 1 + ROUND_OFF))]
        if outside.size:
            raise ArgumentError(
                f"sample takes fractions of the horizon, 0 to 1; found {outside.flat[np.argmax(np.abs(outside))]:.6g} "
                "(for instants in seconds use trajectory.resample)"
            )
        return evaluate(self.nlp, self.x, s)


def _matching_labels(name: str, labels: tuple[str, ...]) -> set[str]:
    """Return the labels of the row, or of the entries of the vector, that begin with `name`. Raises KeyError."""
    matches = [n for n in labels if n == name]
    matches = matches or [n for n in labels if n.startswith(name) and not re.match(r"[\w.]", n[len(name) :])]
    if len({re.sub(r"\[\d+(?:, ?\d+)*\]", "", n[len(name) :]) for n in matches}) != 1:
        raise KeyError(f"{len(matches)} rows begin with '{name}'; names are {', '.join(labels)}")
    return set(matches)


def read_solution(nlp: Nlp, run: SolverRun, status: SolveStatus, message: str) -> Solution:
    """Return physical values of all names from the scaled unknowns."""
    x = run.x
    values = constants(nlp, x)[: len(nlp.problem.free_names)]
    free = dict(zip(nlp.problem.free_names, values.tolist(), strict=True))
    violation = run.miss
    if violation is None:
        violation = float(np.max(np.maximum(nlp.lbg - run.g, run.g - nlp.ubg), initial=0.0))
    trajectory = evaluate(nlp, x, mesh_fractions(placed(nlp, x)))
    solution = Solution(
        status, message, run.objective, run.iterations, trajectory, free, nlp, x, run.multipliers.rows, run.seconds,
        bound_multipliers=run.multipliers.bounds, reservation=run.reservation if status.ok else "",
    )  # fmt: skip
    return solution.with_checks(constraint_violation=Check(max(0.0, violation), 1e-6))


def mesh_fractions(mesh: Mesh) -> np.ndarray:
    """Return the fractions of the horizon of the start, all collocation points and, for Gauss, the end."""
    s = np.append(0.0, mesh.edges[:-1, None] + mesh.h[:, None] * mesh.table.points)
    if s[-1] < 1.0 - 1e-12:
        s = np.append(s, 1.0)
    s[-1] = 1.0
    return s


def constants(nlp: Nlp, x: np.ndarray) -> np.ndarray:
    """Return the free constants and tunable parameters in SI units."""
    return x[nlp.constants :] * nlp.p_scale


def horizon(nlp: Nlp, x: np.ndarray) -> tuple[float, float]:
    """Return start and end time [s]."""
    f = ca.Function("times", [nlp.problem.P], [nlp.problem.t0, nlp.problem.tf])
    t0, tf = f(constants(nlp, x))
    return float(t0), float(tf)


def states_and_controls(
    nlp: Nlp, x: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return states, state rates, inputs (len(s), n) and times at fractions s, from the polynomials.

    Inputs are the controls followed by the point variables (delayed inputs, algebraic variables). At an edge the
    element on the left is used, except at s = 0.
    """
    mesh, layout = placed(nlp, x), nlp.element.layout
    t0, tf = horizon(nlp, x)
    table, edges = mesh.table, mesh.edges
    # slightly to the left: time / duration may round past its edge
    k = np.clip(np.searchsorted(edges, s - 1e-12, side="left") - 1, 0, mesh.elements - 1)
    length, local = mesh.h[k], np.clip((s - edges[k]) / mesh.h[k], 0.0, 1.0)
    y = nlp.physical(x)[k]

    def combined(weights: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return, for each row, the sum of its weights times its unknowns."""
        return np.einsum("ri,rij->rj", weights, y[:, places])

    xs = combined(basis(table.nodes, local), layout.nodes)
    rates = combined(basis_slope(table.nodes, local), layout.nodes) / (length * (tf - t0))[:, None]
    u = combined(control_basis(mesh.control, table, local), layout.u)
    us = np.hstack([u, combined(basis(table.points, local), layout.z)])
    return xs, rates, us, t0 + s * (tf - t0)


def evaluate(nlp: Nlp, x: np.ndarray, s: np.ndarray) -> Trajectory:
    """Return all top-level names at fractions s: states and controls from their polynomials.

    Between collocation points, state rates and algebraic variables come from the model's equations if these have a
    finite solution there, else from the polynomials.
    """
    problem, P = nlp.problem, constants(nlp, x)
    xs, rates, us, times = states_and_controls(nlp, x, s)
    between = np.flatnonzero(~at_points(placed(nlp, x), s))
    if between.size and problem.loose:
        known = nlp.element.layout.nu + len(problem.delayed)
        system, rows, inputs_given = RateSystem.of(problem), xs[between], us[between, :known]
        z = system.solved(rows, inputs_given, system.near(problem, us[between], rates[between]), P, times[between])
        new_rates, new_inputs = system.at(rows, inputs_given, z, P, times[between])
        good = np.all(np.isfinite(new_rates), axis=1) & np.all(np.isfinite(new_inputs), axis=1)
        rates[between[good]], us[between[good]] = new_rates[good], new_inputs[good]
    return named(problem, xs, rates, us, times, P, totals(nlp, x, s))


def totals(nlp: Nlp, x: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Return the values (len(s), n) at fractions s of the states that the objective replaced by integrals."""
    problem, mesh = nlp.problem, placed(nlp, x)
    if not problem.quadratures:
        return np.zeros((len(s), 0))
    points = (mesh.edges[:-1, None] + mesh.h[:, None] * mesh.table.points).ravel()
    xs, rates, us, times = states_and_controls(nlp, x, points)
    (values,) = on_rows(problem.integrands, (xs, rates, us), constants(nlp, x), times)
    t0, tf = horizon(nlp, x)
    return summed(problem, mesh, values.T.reshape(mesh.elements, mesh.points, -1), s, tf - t0)


def at_points(mesh: Mesh, s: np.ndarray) -> np.ndarray:
    """Return which fractions s of the horizon are collocation points (bool, shape of s)."""
    points = (mesh.edges[:-1, None] + mesh.h[:, None] * mesh.table.points).ravel()
    right = np.clip(np.searchsorted(points, s), 0, len(points) - 1)
    miss = np.minimum(np.abs(points[right] - s), np.abs(points[np.maximum(right - 1, 0)] - s))
    return miss <= ROUND_OFF


def named(
    problem: DynamicProblem, xs: np.ndarray, rates: np.ndarray, us: np.ndarray, times: np.ndarray, P: np.ndarray,
    summed_up: np.ndarray,
) -> Trajectory:  # fmt: skip
    """Return a trajectory of every quantity declared at the top or one level below, and of the states' derivatives.

    summed_up: see totals().
    """
    names, f = _outputs(problem)
    (values,) = on_rows(f, (xs, rates, us), P, times, summed_up)
    result: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    row = 0
    for name, shape, size, unit in names:
        block = values[row : row + size]
        row += size
        if not np.all(np.isfinite(block)):
            continue  # not computable at the best iterate of a failed solve
        result[name] = block[0] if shape == () else block.T
        if unit not in (None, "?"):
            units[name] = unit
    return Trajectory(times, result, units)


def _outputs(problem: DynamicProblem) -> tuple[list[tuple[str, Any, int, str]], ca.Function]:
    if "outputs" in problem.cache:
        return problem.cache["outputs"]
    flat = problem.flat
    entries: list[tuple[str, tuple[int, ...], list[tuple[int, int]]]] = []
    states = set(problem.state_pairs)
    groups: list[tuple[str, tuple[int, ...], list[int]]] = []
    for name, (shape, indices) in flat.groups.items():
        if flat.level(indices[0]) > 1:
            continue
        if len(shape) < 2:
            groups.append((name, shape, list(indices)))
        else:  # a Trajectory holds vectors only: entries of a matrix are separate signals, as in simulate()
            groups += [(flat.variables[i].name, (), [i]) for i in indices]
    for order in (0, 1, 2):
        for name, shape, indices in groups:
            if order == 0 or all(_known(problem, states, i, order) for i in indices):
                entries.append((derivative_name(name, order), shape, [(i, order) for i in indices]))
    builder = problem.builder
    sums = ca.SX.sym("sums", len(problem.quadratures))
    replaced = {(q.index, 0): sums[n] for n, q in enumerate(problem.quadratures)}
    replaced |= {(q.index, 1): q.integrand for q in problem.quadratures}
    pairs_needed = [p for _, _, pairs in entries for p in pairs]
    expressed = iter(builder.express([flat.scope.symbol(*p) for p in pairs_needed if p not in replaced]))
    expressions = [replaced[p] if p in replaced else next(expressed) for p in pairs_needed]
    f = ca.Function("outputs", [*problem.arguments, sums], [ca.vertcat(*expressions)])
    table = [(n, shape, len(pairs), flat.unit_of(pairs[0][0], pairs[0][1])) for n, shape, pairs in entries]
    problem.cache["outputs"] = (table, f)
    return table, f


def _known(problem: DynamicProblem, states: set[tuple[int, int]], index: int, order: int) -> bool:
    """Return whether a derivative is a state, a state's rate, or the integrand of a state replaced by an integral."""
    if any(q.index == index for q in problem.quadratures):
        return order == 1
    _, kept, k = problem.plan.alias.resolve(index, order)
    return (kept, k) in states or ((kept, k - 1) in states and problem.builder.expressible((kept, k)))
