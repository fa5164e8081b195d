"""The NLP: derivatives of one element, mapped over the mesh and scattered into sparse matrices.

Differentiating a single element keeps the set-up time independent of the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from ..compiler.matrices import SparseMatrix, nonzeros, stacked
from ..lang.source import ModelError
from .collocation import Element, Layout, make_element, value_at
from .formulation.delays import DelayRows, delay_rows
from .formulation.dynamic import DynamicProblem
from .mesh import Mesh
from .point_kernels import Derivatives, Pattern, compiled, derivatives, linear_rows, point_kernels
from .watch import Program


@dataclass(eq=False)
class Nlp(Program):
    """Functions for nlpsol, bounds, and the layout of unknowns and rows.

    Unknowns X = [y_0, ..., y_(N-1), right end, P], scaled by nominals (P by p_scale).
    """

    problem: DynamicProblem
    mesh: Mesh
    element: Element
    p_scale: np.ndarray
    linear_names: list[str]
    compile_seconds: float | None = None  # None: CasADi's virtual machine evaluates the elements
    derivatives: list[Derivatives] = field(default_factory=list)  # must live as long as the functions
    cache: dict[str, Any] = field(default_factory=dict)  # objects built from the functions on first use

    @property
    def size(self) -> int:
        return len(self.lbx)

    @property
    def end(self) -> int:
        """Index of the first unknown of the last element's right end."""
        return self.mesh.elements * self.element.layout.size

    @property
    def constants(self) -> int:
        """Index of the first free constant among the unknowns."""
        return self.end + self.element.layout.nl

    @property
    def free(self) -> slice:
        """Indices of the free constants among the unknowns; the tunable parameters follow them."""
        return slice(self.constants, self.constants + len(self.problem.free_names))

    def physical(self, x: np.ndarray) -> np.ndarray:
        """Return the unknowns of each element in SI units (elements, n)."""
        layout = self.element.layout
        return x[: self.end].reshape(self.mesh.elements, layout.size) * layout.scale

    def inputs(self, x: np.ndarray, local: np.ndarray) -> np.ndarray:
        """Return controls and point variables (elements, len(local), n) at fractions of each element."""
        return self.element.layout.inputs(self.physical(x), local)

    def row_label(self, row: int) -> str:
        """Return the label of a constraint row."""
        m, mc = self.element.rows.numel(), len(self.problem.points)
        last = row - m * self.mesh.elements
        if last >= mc:
            return self.linear_names[last - mc]
        return self.problem.points[last].label if last >= 0 else self.element.row_names[row % m][0]

    def row_name(self, row: int) -> str:
        """Return the label of a row with its element and collocation point."""
        name, m = self.row_label(row), self.element.rows.numel()
        if row >= m * self.mesh.elements:
            return name
        point = self.element.row_names[row % m][1]
        place = f"element {row // m + 1}" + (f", point {point + 1}" if point >= 0 else "")
        return f"{name} in {place}"

    def row_fraction(self, row: int, x: np.ndarray) -> float | None:
        """Return the position of a row as a fraction of the horizon; None for a row that belongs to no element."""
        m = self.element.rows.numel()
        if row >= m * self.mesh.elements:
            return None
        k = row // m
        mesh = placed(self, x)
        point = self.element.row_names[row % m][1]
        return float(mesh.edges[k] + mesh.h[k] * (mesh.table.points[point] if point >= 0 else 1.0))


def placed(nlp: Nlp, x: np.ndarray) -> Mesh:
    """Return the mesh with the element lengths in x; the mesh itself if its lengths are fixed."""
    layout, mesh = nlp.element.layout, nlp.mesh
    if layout.h < 0:
        return mesh
    h = x[: nlp.end].reshape(mesh.elements, layout.size)[:, layout.h] * layout.scale[layout.h]
    return replace(mesh, lengths=tuple(h.tolist()), length_ratio=None, length_limits=None, length_cost=None)


def mesh_cost(nlp: Nlp, x: np.ndarray) -> float:
    """Return the share of the objective that the mesh adds: steps between blocks, and free element lengths."""
    layout, element, mesh = nlp.element.layout, nlp.element, nlp.mesh
    y = nlp.physical(x)
    cost = 0.0
    for j, block in layout.blocks.items():
        cost += block.step_penalty * float(np.sum(np.diff(y[:, layout.u[0, j]]) ** 2))
    if mesh.length_cost is not None:
        f = ca.Function("lengths", [element.y, element.P, element.d], [element.length_cost])
        P, d = x[nlp.constants :] * nlp.p_scale, np.vstack([mesh.h, mesh.edges[:-1]])
        each = f.map(mesh.elements)((y / layout.scale).T, np.tile(P[:, None], mesh.elements), d)
        cost += float(np.sum(np.asarray(each)))
    return cost


def make_nlp(problem: DynamicProblem, mesh: Mesh, machine_code: bool = False) -> Nlp:
    """Transcribe a dynamic problem on a mesh; machine_code: compile the element functions.

    Raises CompilerMissing.
    """
    element = make_element(problem, mesh)
    n, m, N = element.layout.size, element.rows.numel(), mesh.elements
    nx, nP = element.layout.nl, problem.P.numel()
    delays = delay_rows(problem, mesh, element.layout)
    p_scale = problem.P_scale
    total = N * n + nx + nP
    X = ca.MX.sym("X", total)
    parts, compile_seconds = _parts(problem, mesh, element, p_scale, machine_code)
    point = _points(problem, mesh, element, p_scale)
    z = X[point.index.tolist()] if point.index.size else ca.MX(0, 1)
    mc = len(problem.points)
    md = len(delays.value)
    lam_all = ca.MX.sym("lam_g", N * m + mc + md)
    sigma = ca.MX.sym("lam_f_x")

    Y, P = ca.reshape(X[: N * n], n, N), X[N * n + nx :]
    arguments = [part.arguments(Y, P) for part in parts]
    continued = linear_rows(element.layout, m)
    through = continued.dm @ Y
    link = _link(X, n, m, nx, N)
    mayer, rows_p = point.value(z)
    delayed = delays.matrix.dm @ X[: N * n] if md else ca.MX(0, 1)

    def all_rows(values: list[ca.MX]) -> ca.MX:
        rows = sum((part.rows(v) for part, v in zip(parts, values, strict=True)), through)
        return ca.vertcat(ca.vec(rows) - link, rows_p, delayed)

    g = all_rows([part.mapped("rows")(*a) for part, a in zip(parts, arguments, strict=True)])
    with_cost = [(part, a) for part, a in zip(parts, arguments, strict=True) if part.each.cost is not None]
    f = sum((ca.sum2(part.mapped("share").call(a)[0]) for part, a in with_cost), mayer)

    first = [part.mapped("first")(*a) for part, a in zip(parts, arguments, strict=True)]
    g_first = all_rows([v[0] for v in first])
    entries = [part.entries(part.each.by_rows, v[1], m) for part, v in zip(parts, first, strict=True)]
    jac = _jacobian(continued, entries, point, z, n, m, nx, nP, N, total, mc, delays)
    grad_f = ca.MX.zeros(total, 1)
    f_first = mayer
    for part, a in with_cost:
        each, by_w, by_P = part.mapped("cost")(*a)
        f_first = f_first + ca.sum2(each)
        by_y = part.each.kernel.take.T.dm @ part.beside(by_w)
        grad_f = grad_f + ca.vertcat(ca.vec(by_y), ca.MX.zeros(nx, 1), ca.sum2(by_P) if nP else ca.MX(0, 1))
    mayer_z = point.gradient(z)
    if point.index.size:
        spread = ca.DM.triplet(
            point.index.tolist(), list(range(point.index.size)), np.ones(point.index.size), total, point.index.size
        )
        grad_f = grad_f + spread @ mayer_z
    multipliers = ca.reshape(lam_all[: N * m], m, N)
    second = [part.second(*a, sigma, multipliers) for part, a in zip(parts, arguments, strict=True)]
    hess = _hessian(second, point, z, sigma, lam_all[N * m : N * m + mc], n, nx, N, total)

    parameters = ca.MX.sym("p", 0)
    f = ca.densify(f)  # an objective of 0 has no entries
    nlp = ca.Function("nlp", [X, parameters], [f, g], ["x", "p"], ["f", "g"])
    functions = functions_of(X, parameters, sigma, lam_all, f_first, g_first, grad_f, jac, hess)
    lbx, ubx = _bounds(problem, element, mesh, p_scale)
    lbg = np.concatenate([np.tile(element.low, N), [r.low / r.scale for r in problem.points], delays.value])
    ubg = np.concatenate([np.tile(element.high, N), [r.high / r.scale for r in problem.points], delays.value])
    _step_bounds(element.layout, m, lbg, ubg)
    _open_end(problem, mesh, element, lbg, ubg)
    return Nlp(
        functions, nlp, lbx, ubx, lbg, ubg, problem, mesh, element, p_scale, delays.names, compile_seconds,
        derivatives=[part.each for part in parts],
    )  # fmt: skip


def _open_end(
    problem: DynamicProblem, mesh: Mesh, element: Element, lbg: np.ndarray, ubg: np.ndarray
) -> None:  # fmt: skip
    """Remove the bounds, at the end of the horizon, of path rows that do not hold there."""
    labels = {r.label for r in problem.path if not r.ends[1]}
    last = mesh.points - 1 if mesh.table.points[-1] == 1.0 else -1
    names = {(f"{place}{label}", last) for label in labels for place in ("", "at the edge: ")}
    m = element.rows.numel()
    rows = (mesh.elements - 1) * m + np.flatnonzero([name in names for name in element.row_names])
    lbg[rows], ubg[rows] = -np.inf, np.inf


@dataclass(eq=False)
class _Part:
    """The derivatives of one kernel at all its points on the mesh."""

    each: Derivatives
    mesh: Mesh

    @property
    def places(self) -> int:
        return self.mesh.elements * self.each.kernel.count

    def arguments(self, Y: ca.MX, P: ca.MX) -> tuple[ca.MX, ca.MX, ca.DM]:
        """Return w, P and d at all points, from the unknowns (n, N) of all elements and the constants."""
        kernel = self.each.kernel
        w = ca.reshape(kernel.take.dm @ Y, kernel.w.numel(), self.places)
        return w, ca.repmat(P, 1, self.places), ca.DM(kernel.data(self.mesh))

    def mapped(self, name: str) -> ca.Function:
        return self.each.map(name, self.places)

    def beside(self, values: ca.MX) -> ca.MX:
        """Reshape values at all points to one column per element (., N)."""
        return ca.reshape(values, values.numel() // self.mesh.elements, self.mesh.elements)

    def rows(self, values: ca.MX) -> ca.MX:
        return self.each.kernel.rows.dm @ self.beside(values)

    def entries(self, to: tuple[Pattern, SparseMatrix], values: ca.MX, height: int) -> tuple[Pattern, ca.MX]:
        """Return the pattern within the matrix of an element, and the entries of all elements (., N)."""
        pattern, matrix = to
        return pattern, matrix.dm @ self.beside(values)

    def second(self, w: ca.MX, P: ca.MX, d: ca.DM, sigma: ca.MX, lam: ca.MX) -> tuple[Pattern, ca.MX]:
        """Return pattern and entries, for all elements, of the upper triangle of the Hessian with respect to [y, P]."""
        kernel = self.each.kernel
        multipliers = ca.reshape(kernel.rows.T.dm @ lam, kernel.value.numel(), self.places)
        values = self.mapped("second")(w, P, d, ca.repmat(sigma, 1, self.places), multipliers)
        return self.entries(self.each.by_unknowns, values, 0)


def _parts(
    problem: DynamicProblem, mesh: Mesh, element: Element, p_scale: np.ndarray, machine_code: bool
) -> tuple[list[_Part], float | None]:
    """Return the derivatives of all kernels and the compile time [s]; None if nothing is compiled."""
    each, seconds = [derivatives(problem, k) for k in point_kernels(problem, mesh, element, p_scale)], None
    if machine_code:
        functions, seconds = compiled([f for d in each for f in d.functions])
        known = {f.name(): f for f in functions}
        each = [d.exchanged([known[f.name()] for f in d.functions]) for d in each]
    return [_Part(d, mesh) for d in each], seconds


def functions_of(
    X: ca.MX, p: ca.MX, sigma: ca.MX, lam: ca.MX, f: ca.MX, g: ca.MX, gradient: ca.MX, jacobian: ca.MX, hessian: ca.MX
) -> dict[str, ca.Function]:
    """Return derivatives by nlpsol's option names; the Hessian of sigma f + lam g as its upper triangle."""
    gradient = ca.densify(gradient)  # IPOPT reads every entry, even if the objective of a phase is constant
    return {
        "jac_g": ca.Function("nlp_jac_g", [X, p], [g, jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "grad_f": ca.Function("nlp_grad_f", [X, p], [f, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l", [X, p, sigma, lam], [hessian], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
        ),
    }


def _step_bounds(layout: Layout, m: int, lbg: np.ndarray, ubg: np.ndarray) -> None:
    """Turn the continuity row of a control at the border of two blocks into a bound on the step."""
    for j, block in layout.blocks.items():
        place, most = layout.u[0, j], block.step_max / layout.problem.u_scale[j]  # the index of its carried unknown
        for k in block.borders:
            lbg[(k - 1) * m + place], ubg[(k - 1) * m + place] = -most, most


def _link(X: ca.MX, n: int, m: int, nx: int, N: int) -> ca.MX:
    """Return the left states of the next elements, placed in the continuity rows."""
    columns = [(k + 1) * n + i for k in range(N) for i in range(nx)]
    rows = [k * m + i for k in range(N) for i in range(nx)]
    pick = ca.DM.triplet(rows, list(range(len(rows))), [1.0] * len(rows), N * m, len(rows))
    return pick @ X[columns] if rows else ca.MX.zeros(N * m, 1)


@dataclass(eq=False)
class _Point:
    """Mayer term and point constraints as functions of the unknowns that occur in them."""

    index: np.ndarray
    value: ca.Function
    gradient: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    jac_sparsity: ca.Sparsity
    hess_sparsity: ca.Sparsity


@dataclass(eq=False)
class Instants:
    """Values at instants: the symbols `old` equal the expressions `new` of the unknowns `z` at `index`; `ys` are the
    elements in z."""

    old: ca.SX
    new: ca.SX
    z: ca.SX
    index: np.ndarray
    ys: dict[int, ca.SX]


def instants(problem: DynamicProblem, mesh: Mesh, layout: Layout, p_scale: np.ndarray, more: Sequence[int]) -> Instants:
    """Express values at instants in the unknowns of their elements; z also contains the elements `more`.

    Raises ModelError for an instant within a horizon whose element lengths are free.
    """
    N, n, nx, nP = mesh.elements, layout.size, layout.nl, problem.P.numel()
    edges, h = mesh.edges, mesh.h
    inner = [i.s for i in problem.instants if 0.0 < i.s < 1.0]
    if inner and mesh.length_ratio is not None:
        raise ModelError(
            f"{problem.flat.title} uses a value at {inner[0]:g} of the horizon, but with free element lengths "
            "(length_ratio) no edge stays there; use values at the ends, or fixed lengths"
        )
    elements = [mesh.element_at(i.s) for i in problem.instants]
    used = sorted({*elements, *more})
    ys = {k: ca.SX.sym(f"y{k}", n) for k in used}
    xN = ca.SX.sym("xN", nx)
    Ps = ca.SX.sym("Ps", nP)
    P = Ps * ca.DM(p_scale) if nP else Ps
    points: dict[float, tuple[ca.SX, ...]] = {}  # several values may share one instant
    values = []
    for i, k in zip(problem.instants, elements, strict=True):
        if i.s not in points:
            s = (i.s - edges[k]) / h[k]
            x, xd, u, t = value_at(problem, mesh, layout, ys[k], P, float(h[k]), float(edges[k]), float(s))
            if i.s == 1.0:
                x = xN[: layout.nx] * ca.DM(problem.x_scale)
            points[i.s] = (x, xd, u, P, t)
        e = i.expression if i.off is None or mesh.is_point((i.s - edges[k]) / h[k]) else i.off
        values.append(ca.Function("instant", problem.arguments, [e])(*points[i.s]))
    old = ca.vertcat(*[i.symbol for i in problem.instants], problem.P)
    new = ca.vertcat(*values, P)
    index = np.concatenate(
        [np.arange(k * n, (k + 1) * n) for k in used] + [np.arange(N * n, N * n + nx), N * n + nx + np.arange(nP)]
    ).astype(int)
    return Instants(old, new, ca.vertcat(*[ys[k] for k in used], xN, Ps), index, ys)


def _points(problem: DynamicProblem, mesh: Mesh, element: Element, p_scale: np.ndarray) -> _Point:
    layout = element.layout
    penalised = {j: block for j, block in layout.blocks.items() if block.step_penalty}
    borders = [k for block in penalised.values() for k in block.borders]
    values_at = instants(problem, mesh, layout, p_scale, [*borders, *(k - 1 for k in borders)])
    z, index, ys = values_at.z, values_at.index, values_at.ys
    exprs = [
        problem.mayer,
        ca.vertcat(*[r.expression / r.scale for r in problem.points]) if problem.points else ca.SX(0, 1),
    ]
    if values_at.old.numel():
        exprs = ca.substitute(exprs, [values_at.old], [values_at.new])
    mayer, rows = exprs
    for j, block in penalised.items():
        for k in block.borders:
            step = (ys[k][int(layout.u[0, j])] - ys[k - 1][int(layout.u[0, j])]) * problem.u_scale[j]
            mayer += block.step_penalty * step**2
    # keep only the unknowns that occur
    columns = sorted(set(ca.jacobian_sparsity(ca.vertcat(mayer, rows), z).get_triplet()[1])) if z.numel() else []
    zs = [z[j] for j in columns]
    symbol = ca.SX.sym("z", len(columns))
    if columns:
        mayer, rows = ca.substitute([mayer, rows], [ca.vertcat(*zs)], [symbol])
    lam_f, lam = ca.SX.sym("lam_f"), ca.SX.sym("lam", rows.numel())
    jac = ca.jacobian(rows, symbol)
    hess = ca.triu(ca.hessian(lam_f * mayer + ca.dot(lam, rows), symbol)[0])
    return _Point(
        index[columns],
        ca.Function("points", [symbol], [mayer, rows]),
        ca.Function("points_gradient", [symbol], [ca.densify(ca.gradient(mayer, symbol))]),
        ca.Function("points_jacobian", [symbol], [stacked(nonzeros(jac))]),
        ca.Function("points_hessian", [symbol, lam_f, lam], [stacked(nonzeros(hess))]),
        jac.sparsity(),
        hess.sparsity(),
    )


def scatter(rows: np.ndarray, cols: np.ndarray, values: ca.MX, shape: tuple[int, int]) -> ca.MX:
    """Return a sparse matrix from triplets without duplicates: one gather at run time."""
    order = np.lexsort((rows, cols))
    sparsity = ca.Sparsity.triplet(*shape, rows.astype(int).tolist(), cols.astype(int).tolist())
    return ca.MX(sparsity, values[order.tolist()])


def _tile(rows: np.ndarray, cols: np.ndarray, N: int, dr: int, dc: int) -> tuple[np.ndarray, np.ndarray]:
    k = np.repeat(np.arange(N), len(rows))
    return np.tile(rows.astype(int), N) + k * dr, np.tile(cols.astype(int), N) + k * dc


def _jacobian(
    continued: SparseMatrix, entries: list[tuple[Pattern, ca.MX]], point: _Point, z: ca.MX,
    n: int, m: int, nx: int, nP: int, N: int, total: int, mc: int, delays: DelayRows,
) -> ca.MX:  # fmt: skip
    r, c = _tile(continued.rows, continued.columns, N, m, n)
    rows, cols, values = [r], [c], [ca.MX(ca.DM(np.tile(continued.values, N)))]
    for (r, c), v in entries:
        by_P = np.tile(c >= n, N)
        r, columns = _tile(r, c, N, m, n)
        rows.append(r)
        cols.append(np.where(by_P, np.tile(c, N) - n + N * n + nx, columns))
        values.append(ca.vec(v))
    rows.append(np.array([k * m + i for k in range(N) for i in range(nx)], int))
    cols.append(np.array([(k + 1) * n + i for k in range(N) for i in range(nx)], int))
    values.append(-ca.MX.ones(N * nx, 1))
    rp, cp = (np.array(a, int) for a in point.jac_sparsity.get_triplet())
    rows.append(rp + N * m)
    cols.append(point.index[cp] if cp.size else cp)
    rows.append(delays.matrix.rows + N * m + mc)
    cols.append(delays.matrix.columns)
    values += [point.jacobian(z), ca.MX(ca.DM(delays.matrix.values))]
    shape = (N * m + mc + len(delays.value), total)
    return scatter(np.concatenate(rows), np.concatenate(cols), ca.vertcat(*values), shape)


def _hessian(
    second: list[tuple[Pattern, ca.MX]], point: _Point, z: ca.MX, sigma: ca.MX, lam: ca.MX,
    n: int, nx: int, N: int, total: int,
) -> ca.MX:  # fmt: skip
    result = ca.MX(total, total)
    for (r, c), values in second:
        local = r < n  # the remaining entries belong to the constants, shared by all elements
        rows, cols = _tile(r[local], c[local], N, n, n)
        by_P = np.tile(c[local] >= n, N)
        cols = np.where(by_P, np.tile(c[local], N) - n + N * n + nx, cols)
        result = result + scatter(rows, cols, ca.vec(values[np.flatnonzero(local).tolist(), :]), (total, total))
        if not np.all(local):
            shared = ca.sum2(values[np.flatnonzero(~local).tolist(), :])
            offset = N * n + nx - n
            result = result + scatter(r[~local] + offset, c[~local] + offset, shared, (total, total))
    if point.hess_sparsity.nnz():
        rp, cp = (np.array(a, int) for a in point.hess_sparsity.get_triplet())
        rows, cols = point.index[rp], point.index[cp]
        values = point.hessian(z, sigma, lam)
        low, high = np.minimum(rows, cols), np.maximum(rows, cols)
        result = result + scatter(low, high, values, (total, total))
    return result


def _bounds(
    problem: DynamicProblem, element: Element, mesh: Mesh, p_scale: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    layout, N = element.layout, mesh.elements
    nx, nu = layout.nx, layout.nu
    one_low, one_high = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
    u, x = problem.u_bounds, problem.x_bounds
    one_low[layout.left[:nx]], one_high[layout.left[:nx]] = x.low, x.high
    one_low[layout.x], one_high[layout.x] = x.low, x.high
    one_low[layout.u], one_high[layout.u] = u.low[:nu], u.high[:nu]
    one_low[layout.z], one_high[layout.z] = u.low[nu:], u.high[nu:]
    one_low, one_high = one_low / layout.scale, one_high / layout.scale
    low, high = np.tile(one_low, N), np.tile(one_high, N)
    end_low, end_high = one_low[layout.left], one_high[layout.left]
    s = problem.x_scale
    end_low[:nx] = np.maximum(end_low[:nx], problem.end_bounds.low / s)
    end_high[:nx] = np.minimum(end_high[:nx], problem.end_bounds.high / s)
    low[:nx] = np.maximum(low[:nx], problem.start_bounds.low / s)
    high[:nx] = np.minimum(high[:nx], problem.start_bounds.high / s)
    if mesh.length_ratio is not None:
        shortest, longest = mesh.length_ratio
        lengths = np.arange(N) * layout.size + layout.h
        low[lengths], high[lengths] = shortest * mesh.h * N, longest * mesh.h * N
        low[layout.edge] = high[layout.edge] = 0.0
        end_low[-1] = end_high[-1] = 1.0
    return (
        np.concatenate([low, end_low, problem.P_bounds.low / p_scale]),
        np.concatenate([high, end_high, problem.P_bounds.high / p_scale]),
    )
