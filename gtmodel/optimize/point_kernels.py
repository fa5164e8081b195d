"""One collocation point differentiated, elements put together from points by constant matrices, and their functions
as machine code."""

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
from .collocation import Element, Layout, pointwise
from .formulation.dynamic import DynamicProblem
from .mesh import Mesh, basis, control_basis


def compiled(functions: Sequence[ca.Function]) -> tuple[list[ca.Function], float]:
    """The same functions from one shared library, and the seconds that compiling took: 0.0 if it was there.

    The library's name is a hash of the source, the flags, the compiler's path and the machine; beside it lies the hash
    of its own bytes: one that is cut, or exchanged, or does not load, is built anew. Libraries are loaded from folders
    that none but their owner can write. Externals have no derivatives. Raises CompilerMissing.
    """
    chain = find()
    if isinstance(chain, str):
        raise CompilerMissing(f"compile=True needs a compiler, and {chain}; compile=False gives the same optimum")
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
            pass  # whole as it was written, but for another system or another CasADi
    build(chain, source, library, FLAGS)
    try:
        return _loaded(functions, library), time.perf_counter() - begin
    except RuntimeError as error:
        said = " ".join(str(error).split())[:SHOWN]
        raise CompilerMissing(f"the element functions compiled by {chain.cc} do not load: {said}") from None


def _loaded(functions: Sequence[ca.Function], library: Path) -> list[ca.Function]:
    return [ca.external(f.name(), str(library)) for f in functions]


# operations of a point from which CasADi's own differentiation, and its search for what occurs twice, take seconds
LARGE = 3000
POINT_FUNCTIONS = "point functions"  # under which, with more, a problem keeps them
Pattern = tuple[np.ndarray, np.ndarray]  # rows and columns of the entries of a matrix, column by column


@dataclass(eq=False)
class PointKernel:
    """Scaled rows and cost at `count` places of each element, as functions of (w, P, d).

    d = [length of the element, its left end, the place in it, its weight in the cost]. take: (count nw, n) that gives
    the places' w, one below the other, of an element's scaled unknowns y; place: (count mr) where their rows stand
    among the `height` rows of the element. key: what the functions depend on besides the problem, not the mesh.
    """

    name: str
    key: tuple[bool, tuple[int, ...]]
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
        """(height, count mr), which puts the rows of the places among those of the element."""
        return SparseMatrix.picked(self.place, self.height)

    @property
    def count(self) -> int:
        return len(self.places)

    def data(self, mesh: Mesh) -> np.ndarray:
        """d at all places of all elements (4, N count)."""
        N, K = mesh.elements, self.count
        each = [np.repeat(mesh.h, K), np.repeat(mesh.edges[:-1], K), np.tile(self.places, N), np.tile(self.weights, N)]
        return np.vstack(each)


def point_kernels(problem: DynamicProblem, mesh: Mesh, element: Element, p_scale: np.ndarray) -> list[PointKernel]:
    """The kernel of the collocation points, and where an element has rows at its right edge that of the edge."""
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
    first, npath, m = len(with_rate) + algebraic.numel(), path.numel(), element.rows.numel()
    inner = layout.nl + first * K  # behind the rates and equations of all points those at the edge, then the path's
    own_edge = len(element.at_edge)
    c, r = np.meshgrid(np.arange(K), np.arange(first + npath), indexing="ij")
    place = np.where(r < first, layout.nl + c * first + r, inner + own_edge + c * npath + r - first)
    kernel = PointKernel(
        "point", (free, ()), ca.vertcat(x, slope, u, own), P, d, ca.vertcat(*parts), cost, mesh.table.points,
        mesh.table.weights, _taken(layout), place.ravel(), m,
    )  # fmt: skip
    if not own_edge:
        return [kernel]
    nothing = ca.SX.zeros(nx), ca.SX.zeros(problem.u.numel())
    at_edge = point(x, *nothing, physical, t)[2][element.at_edge] / ca.DM(path_scale[element.at_edge])
    edge = PointKernel(
        "edge", (free, tuple(element.at_edge)), ca.vertcat(x, own), P, d, at_edge, ca.SX(1, 1), np.ones(1), np.zeros(1),
        _taken_end(layout), inner + np.arange(own_edge), m,
    )  # fmt: skip
    return [kernel, edge]


def linear_rows(layout: Layout, m: int) -> SparseMatrix:
    """(m, n): what continues, at an element's right end; the other rows are the kernels'."""
    nx, end = layout.nx, layout.mesh.table.end
    entries = [(np.arange(nx), layout.nodes[j], np.full(nx, end[j])) for j in np.flatnonzero(end)]
    if layout.carried.size:
        entries.append((layout.carried, layout.u[-1], np.ones(len(layout.carried))))
    if layout.h >= 0:
        edge = np.full(2, layout.edge)
        entries.append((edge, np.array([layout.edge, layout.h]), np.array([1.0, layout.scale[layout.h]])))
    rows, columns, values = (np.concatenate(each) for each in zip(*entries, strict=True))
    return SparseMatrix.of(rows, columns, values, (m, layout.size))


def _taken(layout: Layout) -> SparseMatrix:
    """Each collocation point's states, slopes per element length, inputs and, where it is free, length and left end."""
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
            _own(layout),
        ]
    return stacked_rows(blocks)


def _taken_end(layout: Layout) -> SparseMatrix:
    nodes = [layout.left[: layout.nx], *layout.x]
    state = _combined(list(zip(layout.mesh.table.end, nodes, strict=True)), layout.nx, layout)
    return stacked_rows([state, _own(layout)])


def _combined(terms: Sequence[tuple[float, np.ndarray]], size: int, layout: Layout) -> SparseMatrix:
    """(size, n): the sum of weights times the columns of y, in SI units."""
    kept = [(weight, columns) for weight, columns in terms if size and abs(weight) > 0.0]
    columns = np.concatenate([c for _, c in kept]) if kept else np.zeros(0, int)
    values = np.repeat([weight for weight, _ in kept], size) * layout.scale[columns]
    rows = np.tile(np.arange(size), len(kept))
    return SparseMatrix.of(rows, columns, values, (size, layout.size))


def _own(layout: Layout) -> SparseMatrix:
    columns = [layout.h, layout.edge] if layout.h >= 0 else []
    return SparseMatrix.of(np.arange(len(columns)), columns, layout.scale[columns], (len(columns), layout.size))


@dataclass(eq=False)
class Derivatives:
    """Functions of one place, and where in the matrices of one element what they give belongs.

    rows: (w, P, d) -> rows; share: -> cost; cost: -> cost, d cost/dw, d cost/dP; first: -> rows, nonzeros of their
    derivatives by [w, P]; second: (w, P, d, lam_f, lam) -> nonzeros of the upper triangle of the Hessian by [w, P].
    jacobian, hessian: the element's entries by [y, P], from those of all its places.

    Hold it as long as what maps its functions is in use. rows and share have derivatives.
    """

    kernel: PointKernel
    rows: ca.Function
    share: ca.Function | None
    cost: TapeFunction | ca.Function | None
    first: TapeFunction | ca.Function
    second: TapeFunction | ca.Function
    by_rows: tuple[Pattern, SparseMatrix]
    by_unknowns: tuple[Pattern, SparseMatrix]
    maps: list[ca.Function] = field(default_factory=list)  # held: a Batch lives no longer than somebody holds it

    def map(self, name: str, points: int) -> ca.Function:
        """The function of that name at many points; of rows and share with derivatives."""
        f = getattr(self, name)
        if name in ("rows", "share") or isinstance(f, TapeFunction):
            return f.map(points)
        self.maps.append(mapped(f, points))
        return self.maps[-1]

    @property
    def functions(self) -> list[ca.Function]:
        """As functions of CasADi of one place."""
        made = [self.rows, self.first, self.second, *([] if self.cost is None else [self.cost])]
        return [f.casadi if isinstance(f, TapeFunction) else f for f in made]

    def exchanged(self, functions: Sequence[ca.Function]) -> Derivatives:
        """The same with other functions of the same names."""
        rows, first, second, *costs = functions
        cost = costs[0] if costs else None
        return Derivatives(self.kernel, rows, cost, cost, first, second, self.by_rows, self.by_unknowns)


Evaluated = TapeFunction | ca.Function
Functions = tuple[ca.Function, ca.Function | None, Evaluated | None, Evaluated, Evaluated]  # as in `Derivatives`
Differentiated = tuple[Functions, Pattern, Pattern]  # and where the entries of first and second derivatives stand


def derivatives(problem: DynamicProblem, kernel: PointKernel) -> Derivatives:
    """Differentiate a kernel, a large one on a tape: once for a problem, whatever meshes it is put on."""
    key = f"{POINT_FUNCTIONS} {kernel.name} {kernel.key}"
    if key not in problem.cache:
        operations = ca.Function("f", [kernel.w, kernel.P, kernel.d], [kernel.value, kernel.cost]).n_instructions()
        problem.cache[key] = _on_tape(kernel) if operations > LARGE else _by_casadi(kernel)
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
    """With where what the functions give belongs, from where it stands in the matrices of one place."""
    k, nw, nP, mr, n = kernel, kernel.w.numel(), kernel.P.numel(), kernel.value.numel(), kernel.take.shape[1]
    # y and behind it P, of one place and of the element
    take = [_with_identity(k.take.among(c * nw, (c + 1) * nw), nP) for c in range(k.count)]
    scattered = _scattered(by_rows, k.place.reshape(k.count, mr), take, k.height)
    return Derivatives(k, *functions, scattered, _squared(by_unknowns, take, n + nP))


def _with_identity(matrix: SparseMatrix, size: int) -> SparseMatrix:
    """The matrix, and below and beside it the identity."""
    (m, n), own = matrix.shape, np.arange(size)
    pairs = (matrix.rows, m + own), (matrix.columns, n + own), (matrix.values, np.ones(size))
    rows, columns, values = (np.concatenate(pair) for pair in pairs)
    return SparseMatrix(rows, columns, values, (m + size, n + size))


def _by_columns(entries: Entries) -> tuple[Pattern, list[int]]:
    """Where they stand, column by column, and their numbers on the tape."""
    places = sorted(entries, key=lambda place: place[::-1])
    rows, columns = (np.array([place[n] for place in places], int) for n in (0, 1))
    return (rows, columns), [entries[place] for place in places]


def _scattered(
    own: Pattern, rows: np.ndarray, take: Sequence[SparseMatrix], height: int
) -> tuple[Pattern, SparseMatrix]:
    """R J A for each place: the element's entries, and the matrix that gives them of the places'. rows: (places, rows
    of each) where they stand in the element."""
    to, at, values = [], [], []
    i, j = own
    for c, (own_rows, A) in enumerate(zip(rows, take, strict=True)):
        number, columns, weights = A.of_rows(j)
        to.append(own_rows[i[number]] + columns * height)
        at.append(c * len(i) + number)
        values.append(weights)
    return _gathered(to, at, values, height, len(i) * len(take))


def _squared(own: Pattern, take: Sequence[SparseMatrix], n: int) -> tuple[Pattern, SparseMatrix]:
    """The upper triangle of A'HA for each place, of H's upper triangle."""
    to, at, values = [], [], []
    i, j = own
    for c, A in enumerate(take):
        number, a, wa = A.of_rows(i)
        pair, b, wb = A.of_rows(j[number])
        number, r, s, v = number[pair], a[pair], b, wa[pair] * wb
        both = i[number] != j[number]
        r, s = np.concatenate([r, s[both]]), np.concatenate([s, r[both]])
        number, v = np.concatenate([number, number[both]]), np.concatenate([v, v[both]])
        upper = r <= s
        to.append(r[upper] + s[upper] * n)
        at.append(c * len(i) + number[upper])
        values.append(v[upper])
    return _gathered(to, at, values, n, len(i) * len(take))


def _gathered(
    to: list[np.ndarray], at: list[np.ndarray], values: list[np.ndarray], height: int, width: int
) -> tuple[Pattern, SparseMatrix]:
    """Entries (row + height column) that several places give are summed."""
    if not to:
        return (np.zeros(0, int), np.zeros(0, int)), SparseMatrix.of([], [], [], (0, width))
    entries, where = np.unique(np.concatenate(to), return_inverse=True)
    matrix = SparseMatrix.of(where, np.concatenate(at), np.concatenate(values), (len(entries), width))
    return (entries % height, entries // height), matrix
