"""Derivatives of one collocation point, assembled into elements by constant matrices, and their machine code."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import casadi as ca
import numpy as np

from ..compiler.columns.kernel import mapped
from ..compiler.matrices import SparseMatrix, nonzeros, stacked, stacked_rows
from ..compiler.tape.elimination import Entries, gradient, hessian, jacobian
from ..compiler.tape.function import TapeFunction
from ..compiler.tape.operations import Tape, read_in
from ..compiler.toolchain import FLAGS, SHOWN, CompilerMissing, build, find, place, whole
from .collocation import Element, Layout, LengthTerms, pointwise
from .formulation.dynamic import DynamicProblem
from .mesh import Mesh, basis, control_basis


def compiled(functions: Sequence[ca.Function]) -> tuple[list[ca.Function], float]:
    """Return the functions compiled into one shared library, and the compile time [s]; 0.0 if it was cached.

    The library's name is a hash of the source, the flags, the compiler's path and the machine. A file with the hash of
    its bytes detects truncated or replaced libraries; these, and any that do not load, are rebuilt. Libraries are only
    loaded from folders that nobody but their owner can write. Externals have no derivatives. Raises CompilerMissing.
    """
    chain = find()
    if isinstance(chain, str):
        raise CompilerMissing(f"compile=True needs a compiler, but {chain}; compile=False gives the same optimum")
    generator = ca.CodeGenerator("element.c", {"with_header": False})
    for f in functions:
        generator.add(f)
    source = generator.dump()
    library = place(chain, source, FLAGS)
    begin = time.perf_counter()
    if whole(library):
        try:
            return _loaded(functions, library), 0.0
        except RuntimeError:
            pass  # intact, but built for another system or CasADi version
    build(chain, source, library, FLAGS)
    try:
        return _loaded(functions, library), time.perf_counter() - begin
    except RuntimeError as error:
        message = " ".join(str(error).split())[:SHOWN]
        raise CompilerMissing(f"the element functions compiled by {chain.cc} do not load: {message}") from None


def _loaded(functions: Sequence[ca.Function], library: Path) -> list[ca.Function]:
    return [ca.external(f.name(), str(library)) for f in functions]


# number of operations of a point from which CasADi's differentiation and common-subexpression search take seconds
LARGE = 3000
POINT_FUNCTIONS = "point functions"  # prefix of their keys in the problem's cache
Pattern = tuple[np.ndarray, np.ndarray]  # rows and columns of the entries of a matrix, column by column


@dataclass(eq=False)
class PointKernel:
    """Scaled rows and cost at `count` points of each element, as functions of (w, P, d).

    d = [element length, its left end, fraction of the point, its quadrature weight]. take (count nw, n): maps an
    element's scaled unknowns y to the stacked w of its points. place (count mr): indices of the points' rows among the
    `height` rows of the element. key: what the functions depend on besides the problem.
    """

    name: str
    key: tuple[object, ...]
    w: ca.SX
    P: ca.SX
    d: ca.SX
    value: ca.SX
    cost: ca.SX
    places: np.ndarray
    weights: np.ndarray
    take: SparseMatrix
    place: np.ndarray
    height: int

    @property
    def rows(self) -> SparseMatrix:
        """Matrix (height, count mr) that places the points' rows among the element's rows."""
        return SparseMatrix.picked(self.place, self.height)

    @property
    def count(self) -> int:
        return len(self.places)

    def data(self, mesh: Mesh) -> np.ndarray:
        """Return d at all points of all elements (4, N count)."""
        N, K = mesh.elements, self.count
        each = [np.repeat(mesh.h, K), np.repeat(mesh.edges[:-1], K), np.tile(self.places, N), np.tile(self.weights, N)]
        return np.vstack(each)


def point_kernels(problem: DynamicProblem, mesh: Mesh, element: Element, p_scale: np.ndarray) -> list[PointKernel]:
    """Return the kernels of the collocation points, of an element's duration if it is limited, and of its right edge
    if it has rows there."""
    layout, K = element.layout, mesh.points
    nx, nP, free = layout.nx, problem.P.numel(), layout.h >= 0
    point = pointwise(problem)
    with_rate = [n for n, r in enumerate(problem.rates) if r is not None]
    path_scale = np.array([r.scale for r in problem.path])
    x, slope, u = ca.SX.sym("x", nx), ca.SX.sym("slope", nx), ca.SX.sym("u", layout.nu + layout.nz)
    P, d, own = ca.SX.sym("P", nP), ca.SX.sym("d", 4), ca.SX.sym("own", 2 if free else 0)
    h, left = (own[0], own[1]) if free else (d[0], d[1])
    physical = P * ca.DM(p_scale) if nP else P
    t0, tf = ca.Function("times", [problem.P], [problem.t0, problem.tf])(physical)
    length, t = h * (tf - t0), t0 + (left + h * d[2]) * (tf - t0)
    rate, algebraic, path, integrand = point(x, slope / length, u, physical, t)
    parts = [
        (slope[with_rate] - length * rate) / ca.DM(problem.x_scale[with_rate]) if with_rate else ca.SX(0, 1),
        algebraic / ca.DM(problem.algebraic_scale) if algebraic.numel() else algebraic,
        path / ca.DM(path_scale) if path.numel() else path,
    ]
    weights = ca.DM([w for _, _, w in problem.integrals]) if problem.integrals else ca.DM(0, 1)
    cost = length * d[3] * ca.dot(weights, integrand) if problem.integrals else ca.SX(1, 1)
    of_lengths = LengthTerms(problem, mesh)
    if mesh.length_cost is not None:
        cost += of_lengths.cost(slope, h, d[0], tf - t0, d[3])
    first, npath, m = len(with_rate) + algebraic.numel(), path.numel(), element.rows.numel()
    inner = layout.nl + first * K  # order: rates and equations of all points, rows at the edge, path rows
    edge_count = len(element.at_edge)
    c, r = np.meshgrid(np.arange(K), np.arange(first + npath), indexing="ij")
    place = np.where(r < first, layout.nl + c * first + r, inner + edge_count + c * npath + r - first)
    kernels = [PointKernel(
        "point", (free, mesh.length_cost), ca.vertcat(x, slope, u, own), P, d, ca.vertcat(*parts), cost,
        mesh.table.points, mesh.table.weights, _point_matrix(layout), place.ravel(), m,
    )]  # fmt: skip
    one, no_weight = np.ones(1), np.zeros(1)
    if of_lengths.limits is not None:
        kernels.append(PointKernel(
            "duration", (of_lengths.scale,), own, P, d, length / of_lengths.scale, ca.SX(1, 1), one, no_weight,
            _lengths_of(layout), np.array([m - 1]), m,
        ))  # fmt: skip
    if not edge_count:
        return kernels
    nothing = ca.SX.zeros(nx), ca.SX.zeros(problem.u.numel())
    at_edge = point(x, *nothing, physical, t)[2][element.at_edge] / ca.DM(path_scale[element.at_edge])
    kernels.append(PointKernel(
        "edge", (free, tuple(element.at_edge)), ca.vertcat(x, own), P, d, at_edge, ca.SX(1, 1), one, no_weight,
        _edge_matrix(layout), inner + np.arange(edge_count), m,
    ))  # fmt: skip
    return kernels


def linear_rows(layout: Layout, m: int) -> SparseMatrix:
    """Return the continuity rows (m, n) at an element's right end; the kernels' rows are empty."""
    nx, end = layout.nx, layout.mesh.table.end
    entries = [(np.arange(nx), layout.nodes[j], np.full(nx, end[j])) for j in np.flatnonzero(end)]
    if layout.carried.size:
        entries.append((layout.carried, layout.u[-1, layout.carries], np.ones(len(layout.carried))))
    if layout.h >= 0:
        edge = np.full(2, layout.edge)
        entries.append((edge, np.array([layout.edge, layout.h]), np.array([1.0, layout.scale[layout.h]])))
    rows, columns, values = (np.concatenate(each) for each in zip(*entries, strict=True))
    return SparseMatrix.of(rows, columns, values, (m, layout.size))


def _point_matrix(layout: Layout) -> SparseMatrix:
    """Map y to each collocation point's states, slopes, inputs and, if the lengths are free, length and left end."""
    mesh, nx = layout.mesh, layout.nx
    table, nodes = mesh.table, [layout.left[:nx], *layout.x]
    by_u, by_z = control_basis(mesh.control, table, table.points), basis(table.points, table.points)
    blocks = []
    for c in range(mesh.points):
        slope = [(table.derivative[j, c], columns) for j, columns in enumerate(nodes)]
        blocks += [
            _combined([(1.0, layout.x[c])], nx, layout),
            _combined(slope, nx, layout),
            _combined(list(zip(by_u[c], layout.u, strict=True)), layout.nu, layout),
            _combined(list(zip(by_z[c], layout.z, strict=True)), layout.nz, layout),
            _lengths_of(layout),
        ]
    return stacked_rows(blocks)


def _edge_matrix(layout: Layout) -> SparseMatrix:
    nodes = [layout.left[: layout.nx], *layout.x]
    state = _combined(list(zip(layout.mesh.table.end, nodes, strict=True)), layout.nx, layout)
    return stacked_rows([state, _lengths_of(layout)])


def _combined(terms: Sequence[tuple[float, np.ndarray]], size: int, layout: Layout) -> SparseMatrix:
    """Return the matrix (size, n) of a weighted sum of entries of y, in SI units."""
    nonzero = [(weight, columns) for weight, columns in terms if size and abs(weight) > 0.0]
    columns = np.concatenate([c for _, c in nonzero]) if nonzero else np.zeros(0, int)
    values = np.repeat([weight for weight, _ in nonzero], size) * layout.scale[columns]
    rows = np.tile(np.arange(size), len(nonzero))
    return SparseMatrix.of(rows, columns, values, (size, layout.size))


def _lengths_of(layout: Layout) -> SparseMatrix:
    columns = [layout.h, layout.edge] if layout.h >= 0 else []
    return SparseMatrix.of(np.arange(len(columns)), columns, layout.scale[columns], (len(columns), layout.size))


@dataclass(eq=False)
class Derivatives:
    """Functions of one point, and the positions of their results in the matrices of one element.

    rows: (w, P, d) -> rows; share: -> cost; cost: -> cost, d cost/dw, d cost/dP; first: -> rows and the nonzeros of
    their derivatives with respect to [w, P]; second: (w, P, d, lam_f, lam) -> nonzeros of the upper triangle of the
    Hessian with respect to [w, P]. by_rows, by_unknowns: pattern of the element's Jacobian and Hessian with respect to
    [y, P], and the matrix that computes their entries from those of all points.

    The object must live as long as the maps of its functions. rows and share have derivatives.
    """

    kernel: PointKernel
    rows: ca.Function
    share: ca.Function | None
    cost: TapeFunction | ca.Function | None
    first: TapeFunction | ca.Function
    second: TapeFunction | ca.Function
    by_rows: tuple[Pattern, SparseMatrix]
    by_unknowns: tuple[Pattern, SparseMatrix]
    maps: list[ca.Function] = field(default_factory=list)  # keeps the mapped functions alive

    def map(self, name: str, points: int) -> ca.Function:
        """Return the function of that name mapped over points; rows and share have derivatives."""
        f = getattr(self, name)
        if name in ("rows", "share") or isinstance(f, TapeFunction):
            return f.map(points)
        self.maps.append(mapped(f, points))
        return self.maps[-1]

    @property
    def functions(self) -> list[ca.Function]:
        """The functions of one point as CasADi functions."""
        functions = [self.rows, self.first, self.second, *([] if self.cost is None else [self.cost])]
        return [f.casadi if isinstance(f, TapeFunction) else f for f in functions]

    def exchanged(self, functions: Sequence[ca.Function]) -> Derivatives:
        """Return a copy with other functions of the same names."""
        rows, first, second, *costs = functions
        cost = costs[0] if costs else None
        return Derivatives(self.kernel, rows, cost, cost, first, second, self.by_rows, self.by_unknowns)


Evaluated = TapeFunction | ca.Function
Functions = tuple[ca.Function, ca.Function | None, Evaluated | None, Evaluated, Evaluated]  # as in `Derivatives`
Differentiated = tuple[Functions, Pattern, Pattern]  # with the patterns of first and second derivatives


def derivatives(problem: DynamicProblem, kernel: PointKernel) -> Derivatives:
    """Differentiate a kernel, on a tape if it is large; cached per problem for all meshes."""
    key = f"{POINT_FUNCTIONS} {kernel.name} {kernel.key}"
    if key not in problem.cache:
        f = ca.Function("f", [kernel.w, kernel.P, kernel.d], [kernel.value, kernel.cost])
        large = f.n_instructions() > LARGE and not f.get_function()  # a tape has no calls of functions
        problem.cache[key] = _on_tape(kernel) if large else _by_casadi(kernel)
    return _placed(kernel, *problem.cache[key])


def _by_casadi(kernel: PointKernel) -> Differentiated:
    k, args, v = kernel, [kernel.w, kernel.P, kernel.d], ca.vertcat(kernel.w, kernel.P)
    value, cost = ca.cse([k.value, k.cost])
    J = ca.jacobian(value, v)
    lam_f, lam = ca.SX.sym("lam_f"), ca.SX.sym("lam", value.numel())
    H = ca.triu(ca.hessian(lam_f * cost + ca.dot(lam, value), v)[0])
    costs = None
    if k.cost.nnz():
        slope = [ca.densify(ca.gradient(cost, s)) if s.numel() else ca.SX(0, 1) for s in (k.w, k.P)]
        costs = _shared(f"{k.name}_c", args, [cost, *slope])
    rows = _shared(f"{k.name}_g", args, [value])
    first = _shared(f"{k.name}_j", args, [value, stacked(nonzeros(J))])
    second = _shared(f"{k.name}_h", [*args, lam_f, lam], [stacked(nonzeros(H))])
    return (rows, costs, costs, first, second), _pattern(J), _pattern(H)


def _shared(name: str, args: list[ca.SX], out: list[ca.SX]) -> ca.Function:
    return ca.Function(name, args, ca.cse(out))


def _pattern(matrix: ca.SX) -> Pattern:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, int), np.array(columns, int)


def _on_tape(kernel: PointKernel) -> Differentiated:
    k, nw, nP, mr = kernel, kernel.w.numel(), kernel.P.numel(), kernel.value.numel()
    args, multipliers = [k.w, k.P, k.d], [ca.SX.sym("lam_f"), ca.SX.sym("lam", mr)]
    tape = Tape()
    *value, cost = read_in(tape, ca.vertcat(k.value, k.cost), ca.vertcat(*args, *multipliers))
    inputs = [tape.input(place) for place in range(nw + nP + k.d.numel() + 1 + mr)]
    v, lam_f, lam = inputs[: nw + nP], inputs[-1 - mr], inputs[-mr:] if mr else []
    J, H = jacobian(tape, value, v), hessian(tape, [*value, cost], [*lam, lam_f], v)
    share = costs = None
    if k.cost.nnz():
        slope = gradient(tape, [cost], [tape.constant(1.0)], v)
        share = TapeFunction(f"{k.name}_f", tape, args, [[cost]]).casadi
        costs = TapeFunction(f"{k.name}_c", tape, args, [[cost], slope[:nw], slope[nw:]])
    by_rows, first = _by_columns(J)
    by_unknowns, second = _by_columns(H)
    functions = (
        TapeFunction(f"{k.name}_g", tape, args, [value]).casadi, share, costs,
        TapeFunction(f"{k.name}_j", tape, args, [value, first]),
        TapeFunction(f"{k.name}_h", tape, [*args, *multipliers], [second]),
    )  # fmt: skip
    return functions, by_rows, by_unknowns


def _placed(kernel: PointKernel, functions: Functions, by_rows: Pattern, by_unknowns: Pattern) -> Derivatives:
    """Derive the positions in the element's matrices from those in the matrices of one point."""
    k, nw, nP, mr, n = kernel, kernel.w.numel(), kernel.P.numel(), kernel.value.numel(), kernel.take.shape[1]
    # [y, P] of the element -> [w, P] of one point
    take = [_with_identity(k.take.among(c * nw, (c + 1) * nw), nP) for c in range(k.count)]
    scattered = _scattered(by_rows, k.place.reshape(k.count, mr), take, k.height)
    return Derivatives(k, *functions, scattered, _squared(by_unknowns, take, n + nP))


def _with_identity(matrix: SparseMatrix, size: int) -> SparseMatrix:
    """Return the block-diagonal matrix of `matrix` and the identity."""
    (m, n), diagonal = matrix.shape, np.arange(size)
    pairs = (matrix.rows, m + diagonal), (matrix.columns, n + diagonal), (matrix.values, np.ones(size))
    rows, columns, values = (np.concatenate(pair) for pair in pairs)
    return SparseMatrix(rows, columns, values, (m + size, n + size))


def _by_columns(entries: Entries) -> tuple[Pattern, list[int]]:
    """Return their pattern, column by column, and their numbers on the tape."""
    places = sorted(entries, key=lambda place: place[::-1])
    rows, columns = (np.array([place[n] for place in places], int) for n in (0, 1))
    return (rows, columns), [entries[place] for place in places]


def _scattered(
    pattern: Pattern, rows: np.ndarray, take: Sequence[SparseMatrix], height: int
) -> tuple[Pattern, SparseMatrix]:
    """Sum R J A over the points: the element's pattern, and the matrix from the points' entries to its entries.

    rows: (points, rows of each), the row indices in the element.
    """
    targets, sources, values = [], [], []
    i, j = pattern
    for c, (own_rows, A) in enumerate(zip(rows, take, strict=True)):
        number, columns, weights = A.of_rows(j)
        targets.append(own_rows[i[number]] + columns * height)
        sources.append(c * len(i) + number)
        values.append(weights)
    return _gathered(targets, sources, values, height, len(i) * len(take))


def _squared(pattern: Pattern, take: Sequence[SparseMatrix], n: int) -> tuple[Pattern, SparseMatrix]:
    """Sum the upper triangle of A'HA over the points, from H's upper triangle."""
    targets, sources, values = [], [], []
    i, j = pattern
    for c, A in enumerate(take):
        number, a, wa = A.of_rows(i)
        pair, b, wb = A.of_rows(j[number])
        number, r, s, v = number[pair], a[pair], b, wa[pair] * wb
        both = i[number] != j[number]
        r, s = np.concatenate([r, s[both]]), np.concatenate([s, r[both]])
        number, v = np.concatenate([number, number[both]]), np.concatenate([v, v[both]])
        upper = r <= s
        targets.append(r[upper] + s[upper] * n)
        sources.append(c * len(i) + number[upper])
        values.append(v[upper])
    return _gathered(targets, sources, values, n, len(i) * len(take))


def _gathered(
    targets: list[np.ndarray], sources: list[np.ndarray], values: list[np.ndarray], height: int, width: int
) -> tuple[Pattern, SparseMatrix]:
    """Sum the entries (row + height * column) that several points contribute to."""
    if not targets:
        return (np.zeros(0, int), np.zeros(0, int)), SparseMatrix.of([], [], [], (0, width))
    entries, rows = np.unique(np.concatenate(targets), return_inverse=True)
    matrix = SparseMatrix.of(rows, np.concatenate(sources), np.concatenate(values), (len(entries), width))
    return (entries % height, entries // height), matrix
