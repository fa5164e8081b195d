"""One collocation element as SX functions: rows, costs and their derivatives. Everything is mapped over the mesh."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from .mesh import Mesh
from .problem import DynamicProblem
from .tables import basis, basis_slope


@dataclass(eq=False)
class Layout:
    """Where things stand in the unknowns of one element: y = [x at the left end; points].

    With control "polynomial" each point holds its x and u; with "constant" one u follows the left state.
    Values are divided by their nominals.
    """

    problem: DynamicProblem
    mesh: Mesh

    def __post_init__(self) -> None:
        p, k = self.problem, self.mesh.points
        nx, nu = p.x.numel(), p.u.numel()
        self.nx, self.nu = nx, nu
        self.left = np.arange(nx)
        if self.mesh.control == "constant":
            base = nx + nu
            self.u = np.tile(np.arange(nx, nx + nu), (k, 1))
            self.x = np.array([base + np.arange(nx) + c * nx for c in range(k)]).reshape(k, nx)
            self.size = base + k * nx
        else:
            width = nx + nu
            self.x = np.array([nx + c * width + np.arange(nx) for c in range(k)]).reshape(k, nx)
            self.u = np.array([nx + c * width + nx + np.arange(nu) for c in range(k)]).reshape(k, nu)
            self.size = nx + k * width
        self.scale = np.ones(self.size)
        self.scale[self.left] = p.x_scale
        for c in range(k):
            self.scale[self.x[c]] = p.x_scale
            self.scale[self.u[c]] = p.u_scale


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
    integrals: ca.SX


def pointwise(problem: DynamicProblem) -> ca.Function:
    """(x, xd, u, P, t) -> rates, algebraic rows, path rows, integrands."""
    rates = [r for r in problem.rates if r is not None]
    return ca.Function(
        "point",
        [problem.x, problem.xd, problem.u, problem.P, problem.t],
        [
            ca.vertcat(*rates) if rates else ca.SX(0, 1),
            problem.algebraic,
            ca.vertcat(*[r.expression for r in problem.path]) if problem.path else ca.SX(0, 1),
            ca.vertcat(*[e for _, e, _ in problem.integrals]) if problem.integrals else ca.SX(0, 1),
        ],
    )


def make_element(problem: DynamicProblem, mesh: Mesh) -> Element:
    """Rows of one element: [end state - next left state's share; collocation; path], scaled by nominals."""
    layout = Layout(problem, mesh)
    table = mesh.table
    k, nx = mesh.points, layout.nx
    y = ca.SX.sym("y", layout.size)
    P = ca.SX.sym("P", problem.P.numel())
    d = ca.SX.sym("d", 2)
    physical = y * ca.DM(layout.scale)
    times = ca.Function("times", [problem.P], [problem.t0, problem.tf])
    t0, tf = times(P)
    horizon = tf - t0
    length = d[0] * horizon
    x = [physical[layout.left.tolist()]] + [physical[layout.x[c].tolist()] for c in range(k)]
    u = [physical[layout.u[c].tolist()] if layout.nu else ca.SX(0, 1) for c in range(k)]
    point = pointwise(problem)
    with_rate = [n for n, r in enumerate(problem.rates) if r is not None]
    x_scale = problem.x_scale
    end = sum((float(table.end[j]) * x[j] for j in range(k + 1)), ca.SX.zeros(nx, 1))
    rows: list[ca.SX] = [end / ca.DM(x_scale)]
    names: list[tuple[str, int]] = [(f"continuity of {n}", -1) for n in problem.state_names]
    low, high = [np.zeros(nx)], [np.zeros(nx)]
    quadrature = ca.SX.zeros(len(problem.integrals), 1)
    path_rows: list[ca.SX] = []
    path_names: list[tuple[str, int]] = []
    for c in range(k):
        slope = sum((float(table.derivative[j, c]) * x[j] for j in range(k + 1)), ca.SX.zeros(nx, 1))
        t = t0 + (d[1] + d[0] * float(table.points[c])) * horizon
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
        path_rows.append(path)
        path_names += [(r.label, c) for r in problem.path]
        quadrature = quadrature + length * float(table.weights[c]) * integrand
    rows += path_rows
    names += path_names
    low += [np.array([r.low for r in problem.path])] * k
    high += [np.array([r.high for r in problem.path])] * k
    weights = ca.DM([w for _, _, w in problem.integrals]) if problem.integrals else ca.DM(0, 1)
    cost = ca.dot(weights, quadrature) if problem.integrals else ca.SX(0)
    all_rows = ca.vertcat(*rows)
    return Element(layout, y, P, d, all_rows, np.concatenate(low), np.concatenate(high), names, cost, quadrature)


def value_at(problem: DynamicProblem, mesh: Mesh, layout: Layout, y: ca.SX, P: ca.SX, h: float, left: float, s: float):
    """x, xd, u and t at the fraction s of an element: polynomials evaluated; u at the left end is extrapolated."""
    table = mesh.table
    k = mesh.points
    physical = y * ca.DM(layout.scale)
    x = [physical[layout.left.tolist()]] + [physical[layout.x[c].tolist()] for c in range(k)]
    bx = basis(table.nodes, np.array([s]))[0]
    dx = basis_slope(table.nodes, np.array([s]))[0]
    t0, tf = ca.Function("times", [problem.P], [problem.t0, problem.tf])(P)
    zero = ca.SX.zeros(layout.nx, 1)
    xs = sum((float(bx[j]) * x[j] for j in range(k + 1)), zero)
    xd = sum((float(dx[j]) * x[j] for j in range(k + 1)), zero) / (h * (tf - t0))
    if not layout.nu:
        us = ca.SX(0, 1)
    elif mesh.control == "constant":
        us = physical[layout.u[0].tolist()]
    else:
        bu = basis(table.points, np.array([s]))[0]
        us = sum((float(bu[c]) * physical[layout.u[c].tolist()] for c in range(k)), ca.SX.zeros(layout.nu, 1))
    return xs, xd, us, t0 + (left + h * s) * (tf - t0)
