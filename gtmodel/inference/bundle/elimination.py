"""Block normal equations, the Schur complement of the local unknowns, the solution for the shared ones, and
near-singular directions of S, checked with J itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from .residual_block import Linearised
from .structure import Structure

# columns of S up to which it is a dense matrix: about 500 cameras with nine unknowns
DENSE = 4500
# of V scaled to a diagonal of ones: a smaller pivot is round-off, and the direction does not move
PIVOT = 1e-13


@dataclass(eq=False)
class BlockNormal:
    """J'J and J'r by blocks. U: pairs of shared instances; V: local ones (locals, l, l); W: coupling, by width; g
    (columns,), h (locals, l): J'r; cost: of the residuals."""

    U: dict[tuple[int, int], np.ndarray]
    V: np.ndarray
    W: dict[int, np.ndarray]
    g: np.ndarray
    h: np.ndarray
    cost: float
    rows: list[Linearised]

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.cost) and np.isfinite(self.g.sum()) and np.isfinite(self.h.sum()))


def normal_equations(s: Structure, rows: list[Linearised]) -> BlockNormal:
    """Normal equations from all blocks of rows, in the order of `s.rows`."""
    l = s.local.moves if s.local is not None else 0
    U = {kinds: np.zeros((len(k), *kinds)) for kinds, k in s.keys.items()}
    V, h = np.zeros((len(s.eliminated), l, l)), np.zeros((len(s.eliminated), l))
    W = {width: np.zeros((len(e.of), width, l)) for width, e in s.entries.items()}
    g = np.zeros(s.columns)
    with np.errstate(all="ignore"):  # values that are not finite show in the sums
        for d in s.direct:
            J = rows[d.rows].J
            U[d.kinds][d.to] += d.sums.products(J[d.k], J[d.m], d.chosen, d.chosen)
        for number, (r, lin) in enumerate(zip(s.rows, rows, strict=True)):
            for k, _ in r.shared:
                sums = s.shared_sums[number, k]
                part = sums.products(lin.J[k], lin.r[:, :, None])[:, :, 0]
                g[s.offset[sums.unique][:, None] + np.arange(part.shape[1])] += part
            if r.local is None:
                continue
            sums = s.local_sums[number]
            Jl = lin.J[r.local[0]]
            V[sums.unique] += sums.products(Jl, Jl)
            h[sums.unique] += sums.products(Jl, lin.r[:, :, None])[:, :, 0]
            for width, e in s.entries.items():
                for k, _ in r.shared:
                    if (number, k) in e.sums:
                        join, to = e.sums[number, k]
                        W[width][to] += join.products(lin.J[k], Jl)
    return BlockNormal(U, V, W, g, h, float(sum(r.cost for r in rows)), rows)


@dataclass(eq=False)
class ReducedEquations:
    """Equations of the shared unknowns only: S (columns, columns), dense or sparse, and the gradient `g`.

    roots: B (locals, l, l) with V^-1 = B B'. Y: the products W B, by number of columns. weak: basis
    (locals, l, k) of the null space of V, None if V is regular. scale: lengths of the columns of J (columns,).
    """

    s: Structure
    S: Any
    g: np.ndarray
    scale: np.ndarray
    roots: np.ndarray
    Y: dict[int, np.ndarray]
    weak: np.ndarray | None
    h: np.ndarray

    def back(self, x: np.ndarray) -> np.ndarray:
        """Return the increments of the local unknowns (locals, l) for increments x of the shared ones (columns,)."""
        return self.local_part(x, self.h)

    def local_part(self, x: np.ndarray, h: np.ndarray) -> np.ndarray:
        """Return -V^-1 (h + W'x)."""
        inner = np.einsum("bij,bi->bj", self.roots, h)
        for width, Y in self.Y.items():
            e = self.s.entries[width]
            moved = x[self.s.offset[e.instance][:, None] + np.arange(width)]
            inner[e.by_local.unique] += e.by_local.sums(np.einsum("eij,ei->ej", Y, moved))
        return -np.einsum("bij,bj->bi", self.roots, inner)


def lengths(s: Structure, n: BlockNormal) -> np.ndarray:
    """Squared lengths of the shared columns of J (columns,)."""
    squares = np.zeros(s.columns)
    for kinds, keys in s.keys.items():
        first, second = np.divmod(keys, len(s.owner))
        diagonal_blocks = np.flatnonzero(first == second)
        if len(diagonal_blocks):
            diagonal = np.diagonal(n.U[kinds][diagonal_blocks], axis1=1, axis2=2)
            squares[s.offset[first[diagonal_blocks]][:, None] + np.arange(kinds[0])] = diagonal
    return squares


def reduced(s: Structure, n: BlockNormal, damping: float = 0.0, dense: bool | None = None) -> ReducedEquations:
    """Eliminate the local unknowns; `damping`, relative to the squared lengths of all columns, is added to J'J."""
    squares = lengths(s, n)
    V = n.V
    if damping:
        V = V + damping * np.einsum("bii->bi", V)[:, :, None] * np.eye(V.shape[1])
    roots, weak = local_roots(V)
    Y = {width: np.matmul(W, roots[s.entries[width].of]) for width, W in n.W.items()}
    blocks = {kinds: U.copy() for kinds, U in n.U.items()}
    for p in s.pairs:
        A, B = Y[p.kinds[0]].transpose(0, 2, 1), Y[p.kinds[1]].transpose(0, 2, 1)
        blocks[p.kinds][p.to] -= p.sums.products(A, B, p.a, p.b)
    if damping:
        for kinds, keys in s.keys.items():
            first, second = np.divmod(keys, len(s.owner))
            diagonal_blocks = np.flatnonzero(first == second)
            if not len(diagonal_blocks):
                continue
            more = damping * squares[s.offset[first[diagonal_blocks]][:, None] + np.arange(kinds[0])]
            blocks[kinds][diagonal_blocks] += more[:, :, None] * np.eye(kinds[0])
    g = n.g.copy()
    inner = np.einsum("bij,bi->bj", roots, n.h)
    for width, y in Y.items():
        e = s.entries[width]
        columns = s.offset[e.by_instance.unique][:, None] + np.arange(width)
        g[columns] -= e.by_instance.sums(np.einsum("eij,ej->ei", y, inner[e.of]))
    is_dense = s.columns <= DENSE if dense is None else dense
    S = _dense(s, blocks, Y) if is_dense else _sparse(s, blocks)
    return ReducedEquations(s, S, g, np.sqrt(squares), roots, Y, weak, n.h)


def local_roots(V: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """B (n, l, l) with V^-1 = B B' and None; for a singular V its pseudo-inverse and the null space (n, l, k)."""
    if not V.size:
        return V, None
    size = np.sqrt(np.einsum("bii->bi", V))
    size = np.where(size > 0, size, 1.0)
    unit = V / (size[:, :, None] * size[:, None, :])
    try:
        L = np.linalg.cholesky(unit)
        if np.einsum("bii->bi", L).min() ** 2 > PIVOT:
            return np.linalg.inv(L).transpose(0, 2, 1) / size[:, :, None], None
    except np.linalg.LinAlgError:
        pass
    values, vectors = np.linalg.eigh(np.where(np.isfinite(unit), unit, 0.0))
    good = values > PIVOT * np.maximum(values[:, -1:], PIVOT)
    roots = vectors * np.where(good, np.where(good, values, 1.0) ** -0.5, 0.0)[:, None, :]
    weak = np.where(good[:, None, :], 0.0, vectors) / size[:, :, None]
    return roots / size[:, :, None], weak


def _dense(s: Structure, blocks: dict[tuple[int, int], np.ndarray], Y: dict[int, np.ndarray]) -> np.ndarray:
    S = np.zeros((s.columns, s.columns))
    for kinds, keys in s.keys.items():
        first, second = (s.offset[i] for i in np.divmod(keys, len(s.owner)))
        rows = (first[:, None] + np.arange(kinds[0]))[:, :, None]
        columns = (second[:, None] + np.arange(kinds[1]))[:, None, :]
        S[rows, columns] = blocks[kinds]
        S[columns, rows] = blocks[kinds]
    for b in s.heavy:
        parts, places = [], []
        for width, e in s.entries.items():
            mine = slice(*np.searchsorted(e.of, [b, b + 1]))
            parts.append(Y[width][mine].reshape(-1, Y[width].shape[2]))
            places.append((s.offset[e.instance[mine]][:, None] + np.arange(width)).reshape(-1))
        rows, where = np.concatenate(parts), np.concatenate(places)
        S[np.ix_(where, where)] -= rows @ rows.T
    return S


def _sparse(s: Structure, blocks: dict[tuple[int, int], np.ndarray]) -> Any:
    rows, columns, values = [], [], []
    for kinds, keys in s.keys.items():
        first, second = np.divmod(keys, len(s.owner))
        shape = blocks[kinds].shape
        r = np.broadcast_to((s.offset[first][:, None] + np.arange(kinds[0]))[:, :, None], shape)
        c = np.broadcast_to((s.offset[second][:, None] + np.arange(kinds[1]))[:, None, :], shape)
        off = first != second
        rows += [r.reshape(-1), c[off].reshape(-1)]
        columns += [c.reshape(-1), r[off].reshape(-1)]
        values += [blocks[kinds].reshape(-1), blocks[kinds][off].reshape(-1)]
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return scipy.sparse.csc_matrix(entries, shape=(s.columns, s.columns))


@dataclass(eq=False)
class BlockDirections:
    """k directions: x (columns, k) are their shared parts, z (locals, l, k) their local parts."""

    x: np.ndarray
    z: np.ndarray

    @property
    def count(self) -> int:
        return self.x.shape[1]

    def then(self, other: BlockDirections) -> BlockDirections:
        """Return both sets of directions together."""
        return BlockDirections(np.hstack([self.x, other.x]), np.concatenate([self.z, other.z], axis=2))

    def of(self, weights: np.ndarray) -> BlockDirections:
        """Return combinations of the directions, weights (k, c)."""
        return BlockDirections(self.x @ weights, self.z @ weights)

    def flat(self, lengths: np.ndarray) -> np.ndarray:
        """Return all entries in units of the column lengths, (entries, k)."""
        return np.concatenate([self.x, self.z.reshape(-1, self.count)]) * lengths[:, None]

    def by_length(self, s: Structure, rows: Sequence[Linearised]) -> tuple[BlockDirections, np.ndarray]:
        """Return combinations v with orthogonal weights whose J v are orthogonal, and the lengths of these (k,).

        It uses J itself, since lengths below 1e-8 are lost in J'J.
        """
        if not self.count:
            return self, np.zeros(0)
        moved = np.concatenate([a.reshape(-1, self.count) for a in along(s, rows, self.x, self.z)])
        R = np.linalg.qr(moved, mode="r") if len(moved) > self.count else moved
        _, sizes, Vt = np.linalg.svd(R, full_matrices=True)
        return self.of(Vt.T), np.concatenate([sizes, np.zeros(self.count - len(sizes))])


def along(s: Structure, rows: Sequence[Linearised], x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
    """J v for all blocks of rows, each (n, m, k), with k directions x (columns, k), z (locals, l, k)."""
    out = []
    for r, lin in zip(s.rows, rows, strict=True):
        moved = np.zeros((*lin.r.shape, x.shape[1]))
        for k, i in r.shared:
            moved += np.matmul(lin.J[k], x[s.offset[i][:, None] + np.arange(lin.J[k].shape[2])])
        if r.local is not None:
            moved += np.matmul(lin.J[r.local[0]], z[r.local[1]])
        out.append(moved)
    return out


# squared diagonal of the Cholesky factor of S scaled to a diagonal of ones: below, S may be singular
SHARED_PIVOT = 1e-9
# columns up to which each step searches for faint directions; with more columns steps are damped by LEAST
SMALL, LEAST = 1500, 1e-9
# with columns of J of length one: eigenvalue of S below which its eigenvector is faint, and how many are computed above
# SMALL columns
FAINT, SMALLEST = 1e-7, 12
# length of J v for v of length one in units of the columns: below, no measurement depends on the direction v
SILENT = 1e-7


@dataclass(eq=False)
class SharedSolver:
    """Solves S x = b, b (columns,) or (columns, k). used: nonzero columns; size: their lengths. unit: solver for
    columns of length one, except along `basis`, where J has the lengths `sizes`. Undetermined directions stay zero."""

    used: np.ndarray
    size: np.ndarray
    unit: Callable[[np.ndarray], np.ndarray]
    basis: np.ndarray
    sizes: np.ndarray

    def __call__(self, b: np.ndarray) -> np.ndarray:
        size, B, regular = self.size.reshape(-1, *[1] * (b.ndim - 1)), self.basis, self.sizes > SILENT
        right = b[self.used] / size
        part = self.unit(right - B @ (B.T @ right))
        part -= B @ (B.T @ part)
        part += (B[:, regular] / self.sizes[regular] ** 2) @ (B[:, regular].T @ right)
        x = np.zeros_like(b)
        x[self.used] = part / size
        return x


def step_solver(s: Structure, rows: Sequence[Linearised], r: ReducedEquations) -> SharedSolver:
    """Solver for a step: Cholesky if S is far from singular; otherwise with its faint directions, or damped if there
    are too many columns to search for them."""
    used = np.flatnonzero(r.scale > 0)
    if not len(used):
        return _plain(used, r.scale[used], np.copy)
    if isinstance(r.S, np.ndarray):
        S = r.S[np.ix_(used, used)] if len(used) < len(r.scale) else r.S
        diagonal = np.diag(S)
        if diagonal.min() > 0:
            size = np.sqrt(diagonal)
            try:
                factor = scipy.linalg.cho_factor(S / np.outer(size, size), lower=True, check_finite=False)
                if np.diag(factor[0]).min() ** 2 > SHARED_PIVOT:
                    return _plain(used, size, lambda b: scipy.linalg.cho_solve(factor, b))
            except np.linalg.LinAlgError:
                pass
        if len(used) <= SMALL:
            return solver(r, *faint(s, rows, r))
        unit = S / np.outer(r.scale[used], r.scale[used]) + LEAST * np.eye(len(used))
        factor = scipy.linalg.cho_factor(unit, lower=True, check_finite=False)
        return _plain(used, r.scale[used], lambda b: scipy.linalg.cho_solve(factor, b))
    return solver(r, BlockDirections(np.zeros((len(r.scale), 0)), np.zeros((*r.h.shape, 0))), np.zeros(0))


def _plain(used: np.ndarray, size: np.ndarray, unit: Callable[[np.ndarray], np.ndarray]) -> SharedSolver:
    return SharedSolver(used, size, unit, np.zeros((len(used), 0)), np.zeros(0))


def solver(r: ReducedEquations, directions: BlockDirections, sizes: np.ndarray) -> SharedSolver:
    """Solver with the faint directions of S and the lengths of J along them."""
    used, unit = _unit(r)
    size = r.scale[used]
    if not len(used):
        return _plain(used, size, np.copy)
    basis = directions.x[used] * size[:, None]
    if isinstance(unit, np.ndarray):
        spared = LEAST if len(used) > SMALL else 0.0  # there may be more faint directions than computed
        whole = unit + basis @ basis.T + spared * np.eye(len(used))
        factor = scipy.linalg.cho_factor(whole, lower=True, check_finite=False)
        return SharedSolver(used, size, lambda b: scipy.linalg.cho_solve(factor, b), basis, sizes)
    factor = scipy.sparse.linalg.splu(
        (unit + LEAST * scipy.sparse.eye(len(used))).tocsc(),
        permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0,
    )  # fmt: skip
    return SharedSolver(used, size, factor.solve, basis, sizes)


def faint(s: Structure, rows: Sequence[Linearised], r: ReducedEquations) -> tuple[BlockDirections, np.ndarray]:
    """Faint directions, along which S is zero or nearly zero, orthonormal in units of the shared columns, and the
    lengths of J along them."""
    used, unit = _unit(r)
    if isinstance(unit, np.ndarray):
        subset = None if len(used) <= SMALL else [0, SMALLEST - 1]
        values, vectors = scipy.linalg.eigh(unit, subset_by_index=subset) if len(used) else (np.zeros(0), unit)
    else:
        begin = np.ones(len(used))  # ARPACK would start with a random vector
        values, vectors = scipy.sparse.linalg.eigsh(
            unit.tocsc(), k=min(SMALLEST, len(used) - 1), sigma=-FAINT, v0=begin
        )
    near = vectors[:, values < FAINT]
    x = np.zeros((s.columns, near.shape[1]))
    x[used] = near / r.scale[used, None]
    z = [r.local_part(v, np.zeros_like(r.h)) for v in x.T]
    return BlockDirections(x, np.stack(z, axis=2) if z else np.zeros((*r.h.shape, 0))).by_length(s, rows)


def _unit(r: ReducedEquations) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the nonzero columns, and S of them with columns of J of length one, dense or sparse."""
    used = np.flatnonzero(r.scale > 0)
    size = r.scale[used]
    if isinstance(r.S, np.ndarray):
        return used, r.S[np.ix_(used, used)] / np.outer(size, size)
    scaled = scipy.sparse.diags(1 / size)
    return used, scaled @ r.S[used][:, used] @ scaled
