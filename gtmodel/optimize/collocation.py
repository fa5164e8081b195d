"""One collocation element as SX functions (rows and costs), which are mapped over the mesh."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from .formulation.dynamic import DynamicProblem
from .formulation.horizon import ConstraintRow, names_of
from .mesh import Mesh, basis, basis_slope, coefficients, control_basis


@dataclass(eq=False)
class Layout:
    """Indices into the unknowns of one element: y = [left end; points; length], divided by nominals.

    `left`: quantities continuous across elements: the states (`left[:nx]`), the controls that are continuous or blocked
    (`carries`: their numbers; `carried`: their indices), and the position of the edge on the horizon if the lengths are
    free. `x` (points, nx): states. `z` (points, nz): variables free at each point (delayed inputs, algebraic
    variables). `u` (coefficients, nu): controls; all coefficients of a blocked one are the same unknown. `h`: the
    element length, -1 if it is fixed. `blocks`: by number of the control.
    """

    problem: DynamicProblem
    mesh: Mesh

    def __post_init__(self) -> None:
        p, mesh = self.problem, self.mesh
        k, nx, nu = mesh.points, p.x.numel(), len(p.control_indices)
        nz = p.u.numel() - nu
        self.nx, self.nu, self.nz = nx, nu, nz
        self.blocks = {} if mesh.blocks is None else mesh.blocks.of(p.control_names, mesh.elements, p.flat.title)
        linear, free = mesh.control == "linear", mesh.length_ratio is not None
        self.carries = np.arange(nu) if linear else np.array(list(self.blocks), int)
        self.carried = nx + np.arange(len(self.carries))
        self.edge = nx + len(self.carried) if free else -1
        self.left = np.arange(nx + len(self.carried) + free)
        position = len(self.left)
        m = coefficients(mesh.control, mesh.table)
        unshared = m - 1 if linear else m  # coefficients that belong to this element alone, of controls without blocks
        own = np.array([k for k in range(nu) if k not in self.blocks], int)  # np.setdiff1d imports numpy.ma
        self.x, self.z = np.zeros((k, nx), int), np.zeros((k, nz), int)
        self.u = np.zeros((m, nu), int)
        self.u[:, self.carries] = self.carried
        if unshared < k:
            for c in range(m - unshared, m):
                self.u[c, own] = position + np.arange(len(own))
                position += len(own)
        for c in range(k):
            self.x[c] = position + np.arange(nx)
            self.z[c] = position + nx + np.arange(nz)
            position += nx + nz
            if unshared == k:
                self.u[c + m - unshared, own] = position + np.arange(len(own))
                position += len(own)
        self.h = position if free else -1
        self.size = position + free
        self.scale = np.ones(self.size)
        self.scale[self.left[:nx]] = p.x_scale
        self.scale[self.x] = p.x_scale
        self.scale[self.u] = p.u_scale[:nu]
        self.scale[self.z] = p.u_scale[nu:]
        if free:
            self.scale[self.h] = 1 / mesh.elements

    @property
    def nl(self) -> int:
        """Number of unknowns that are continuous across elements."""
        return len(self.left)

    @property
    def nodes(self) -> np.ndarray:
        """Indices of the states at the left end and the points (points + 1, nx)."""
        return np.vstack([self.left[: self.nx], self.x])

    def inputs(self, y: np.ndarray, local: np.ndarray) -> np.ndarray:
        """Return controls and point variables (..., len(local), nu + nz) at fractions of elements, from physical y."""
        mesh = self.mesh
        u = control_basis(mesh.control, mesh.table, local) @ y[..., self.u]
        return np.concatenate([u, basis(mesh.table.points, local) @ y[..., self.z]], -1)


@dataclass(eq=False)
class Element:
    """SX functions of (y, P, d) with d = [element length h, left end s], and the names of their rows."""

    layout: Layout
    y: ca.SX
    P: ca.SX
    d: ca.SX
    rows: ca.SX
    low: np.ndarray
    high: np.ndarray
    row_names: list[tuple[str, int]]
    cost: ca.SX
    length_cost: ca.SX  # not part of `cost`
    integrals: ca.SX
    at_edge: list[int]  # path rows also imposed at the right edge, if the edge is not a collocation point


DURATION = "element duration"


class LengthTerms:
    """Cost and limits of free element lengths. `limits` (2,): shortest and longest [s]; None without limits."""

    def __init__(self, problem: DynamicProblem, mesh: Mesh) -> None:
        self.declared = mesh.length_cost
        self.rates = np.zeros(problem.x.numel())
        if mesh.length_cost is not None:
            names = [[n for n, _ in names_of(problem.flat, problem.base.alias, p)] for p in problem.state_pairs]
            self.rates[: len(names)] = mesh.length_cost.weights(names)
        self.limits = None if mesh.length_limits is None else np.array(mesh.length_limits, float)
        self.scale = 1.0
        if self.limits is not None:
            self.scale = float(next((x for x in self.limits if 0 < x < np.inf), 1.0))

    def cost(self, slope: ca.SX, h: ca.SX, nominal: ca.SX, horizon: ca.SX, weight: ca.SX | float) -> ca.SX:
        """Return one collocation point's share of its element's cost.

        slope: derivative of the states by the fraction of the element; h, nominal: length and initial length, fractions
        of the horizon; weight: quadrature weight of the point.
        """
        if self.declared is None:
            return ca.SX(0)
        share = self.declared.uneven * (h / nominal - 1) ** 2
        if np.any(self.rates):
            length = h * horizon
            share += h ** (1 + self.declared.power) * length * ca.dot(ca.DM(self.rates), (slope / length) ** 2)
        return weight * share


def pointwise(problem: DynamicProblem) -> ca.Function:
    """(x, xd, u, P, t) -> rates, algebraic rows, path rows, integrands."""
    rates = [r for r in problem.rates if r is not None]
    return ca.Function(
        "point",
        problem.arguments,
        [
            ca.vertcat(*rates) if rates else ca.SX(0, 1),
            problem.algebraic,
            ca.vertcat(*[r.expression for r in problem.path]) if problem.path else ca.SX(0, 1),
            ca.vertcat(*[e for _, e, _ in problem.integrals]) if problem.integrals else ca.SX(0, 1),
        ],
    )


def make_element(problem: DynamicProblem, mesh: Mesh) -> Element:
    """Build the rows of one element: [continuity; collocation; path], scaled by nominals.

    The continuity rows hold the end state only; the next element's left state is subtracted in nlp.
    """
    layout = Layout(problem, mesh)
    if layout.size == 1 and layout.nx == 0:
        raise ModelError(
            f"{problem.flat.title} has no state and only one unknown per element; use a mesh with at least two points"
        )
    table = mesh.table
    k, nx = mesh.points, layout.nx
    y = ca.SX.sym("y", layout.size)
    P = ca.SX.sym("P", problem.P.numel())
    d = ca.SX.sym("d", 2)
    physical = y * ca.DM(layout.scale)
    times = ca.Function("times", [problem.P], [problem.t0, problem.tf])
    t0, tf = times(P)
    horizon = tf - t0
    h, left = (physical[layout.h], physical[layout.edge]) if layout.h >= 0 else (d[0], d[1])
    length = h * horizon
    x = [physical[layout.left[:nx].tolist()]] + [physical[layout.x[c].tolist()] for c in range(k)]
    u = _inputs(layout, physical, table.points)
    point = pointwise(problem)
    with_rate = [n for n, r in enumerate(problem.rates) if r is not None]
    x_scale = problem.x_scale
    end = sum((float(table.end[j]) * x[j] for j in range(k + 1)), ca.SX.zeros(nx, 1))
    rows: list[ca.SX] = [end / ca.DM(x_scale)]
    names: list[tuple[str, int]] = [(f"continuity of {n}", -1) for n in problem.state_names]
    if layout.carried.size:
        rows.append(y[layout.u[-1, layout.carries].tolist()])
        names += [(f"continuity of {problem.control_names[j]}", -1) for j in layout.carries]
    if layout.h >= 0:
        rows.append(left + h)
        names.append(("element lengths", -1))
    low, high = [np.zeros(layout.nl)], [np.zeros(layout.nl)]
    quadrature, length_cost = ca.SX.zeros(len(problem.integrals), 1), ca.SX(0)
    of_lengths = LengthTerms(problem, mesh)
    path_rows: list[ca.SX] = []
    path_names: list[tuple[str, int]] = []
    for c in range(k):
        slope = sum((float(table.derivative[j, c]) * x[j] for j in range(k + 1)), ca.SX.zeros(nx, 1))
        t = t0 + (left + h * float(table.points[c])) * horizon
        rate, algebraic, path, integrand = point(x[c + 1], slope / length, u[c], P, t)
        if with_rate:
            defect = (slope[with_rate] - length * rate) / ca.DM(x_scale[with_rate])
            rows.append(defect)
            names += [(f"rate of {problem.state_names[n]}", c) for n in with_rate]
        rows.append(algebraic / ca.DM(problem.algebraic_scale) if algebraic.numel() else algebraic)
        names += [(label, c) for label in problem.algebraic_labels]
        n = len(with_rate) + algebraic.numel()
        low.append(np.zeros(n))
        high.append(np.zeros(n))
        path_rows.append(path / ca.DM([r.scale for r in problem.path]) if path.numel() else path)
        path_names += [(r.label, c) for r in problem.path]
        quadrature = quadrature + length * float(table.weights[c]) * integrand
        length_cost = length_cost + of_lengths.cost(slope, h, d[0], horizon, float(table.weights[c]))
    edges: list[int] = []
    if table.points[-1] < 1.0:
        edges = [n for n, r in enumerate(problem.path) if r.low != r.high and of_states(problem, r)]
    if edges:
        # bounds on states are imposed at the edges, which are not Gauss points; so are these rows
        at_edge = point(end, ca.SX.zeros(nx), ca.SX.zeros(problem.u.numel()), P, t0 + (left + h) * horizon)[2]
        edge_rows = [problem.path[n] for n in edges]
        scales = np.array([r.scale for r in edge_rows])
        rows.append(at_edge[edges] / ca.DM(scales))
        names += [(f"at the edge: {r.label}", -1) for r in edge_rows]
        low.append(np.array([r.low for r in edge_rows]) / scales)
        high.append(np.array([r.high for r in edge_rows]) / scales)
    rows += path_rows
    names += path_names
    low += [np.array([r.low / r.scale for r in problem.path])] * k
    high += [np.array([r.high / r.scale for r in problem.path])] * k
    if of_lengths.limits is not None:  # the last row, see point_kernels
        rows.append(length / of_lengths.scale)
        names.append((DURATION, -1))
        low.append(of_lengths.limits[:1] / of_lengths.scale)
        high.append(of_lengths.limits[1:] / of_lengths.scale)
    weights = ca.DM([w for _, _, w in problem.integrals]) if problem.integrals else ca.DM(0, 1)
    cost = ca.dot(weights, quadrature) if problem.integrals else ca.SX(0)
    all_rows = ca.vertcat(*rows)
    return Element(
        layout,
        y,
        P,
        d,
        all_rows,
        np.concatenate(low),
        np.concatenate(high),
        names,
        cost,
        length_cost,
        quadrature,
        edges,
    )


def of_states(problem: DynamicProblem, row: ConstraintRow) -> bool:
    """Return whether the row depends only on states, constants and time, with at least one state."""
    keys = {s.element_hash() for s in ca.symvar(row.expression)}
    states = {s.element_hash() for s in ca.vertsplit(problem.x)}
    return bool(keys & states) and keys <= {
        *states, *(s.element_hash() for s in ca.vertsplit(problem.P)), problem.t.element_hash()
    }  # fmt: skip


def _inputs(layout: Layout, physical: ca.SX, local: np.ndarray) -> list[ca.SX]:
    """Return symbolic controls and point variables at fractions of the element."""
    mesh = layout.mesh
    inputs = []
    for by_u, by_z in zip(
        control_basis(mesh.control, mesh.table, local), basis(mesh.table.points, local), strict=True
    ):  # fmt: skip
        u = sum((_share(w, _entries(physical, i)) for w, i in zip(by_u, layout.u, strict=True) if w != 0.0),
                ca.SX.zeros(layout.nu, 1))  # fmt: skip
        z = sum((_share(w, _entries(physical, i)) for w, i in zip(by_z, layout.z, strict=True) if w != 0.0),
                ca.SX.zeros(layout.nz, 1))  # fmt: skip
        inputs.append(ca.vertcat(u, z))
    return inputs


def _entries(column: ca.SX, index: np.ndarray) -> ca.SX:
    """Return the entries as a column; an empty selection from a scalar would be a row in CasADi."""
    return column[index.tolist()] if index.size else ca.SX(0, 1)


def _share(weight: float, value: ca.SX) -> ca.SX:
    return value if weight == 1.0 else float(weight) * value


def value_at(problem: DynamicProblem, mesh: Mesh, layout: Layout, y: ca.SX, P: ca.SX, h: float, left: float, s: float):
    """Evaluate x, xd, u and t at the fraction s of an element; u at the left end is extrapolated."""
    table = mesh.table
    k, nx = mesh.points, layout.nx
    physical = y * ca.DM(layout.scale)
    x = [physical[layout.left[:nx].tolist()]] + [physical[layout.x[c].tolist()] for c in range(k)]
    bx = basis(table.nodes, np.array([s]))[0]
    dx = basis_slope(table.nodes, np.array([s]))[0]
    t0, tf = ca.Function("times", [problem.P], [problem.t0, problem.tf])(P)
    length, begin = (physical[layout.h], physical[layout.edge]) if layout.h >= 0 else (h, left)
    zero = ca.SX.zeros(nx, 1)
    xs = sum((float(bx[j]) * x[j] for j in range(k + 1)), zero)
    xd = sum((float(dx[j]) * x[j] for j in range(k + 1)), zero) / (length * (tf - t0))
    us = _inputs(layout, physical, np.array([s]))[0]
    return xs, xd, us, t0 + (begin + length * s) * (tf - t0)
