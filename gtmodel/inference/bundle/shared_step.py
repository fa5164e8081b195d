"""The equations of the shared unknowns solved, by Cholesky or sparsely; directions that S hardly sees, by J itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from .elimination import BlockDirections, ReducedEquations
from .residual_block import Linearised
from .structure import Structure

# of the diagonal of the Cholesky factor of S with a diagonal of ones, squared: below, S may be singular
PIVOT = 1e-9
# columns up to which faint directions are looked for at each step; above it steps are damped by LEAST
SMALL, LEAST = 1500, 1e-9
# of S with columns of J of length one: eigenvectors below this eigenvalue are faint, and how many are looked for above
# SMALL columns
FAINT, SMALLEST = 1e-7, 12
# length of J v for v of length one in units of the columns: below, v is a direction that nothing measured sees
SILENT = 1e-7


@dataclass(eq=False)
class SharedSolver:
    """Solves S x = b, b (columns,) or (columns, k), on the columns that anything sees, `used`, by their lengths `size`;
    what nothing determines stays zero. `unit` solves for columns of length one but along `basis`, where J has the
    lengths `sizes`."""

    used: np.ndarray
    size: np.ndarray
    unit: Callable[[np.ndarray], np.ndarray]
    basis: np.ndarray
    sizes: np.ndarray

    def __call__(self, b: np.ndarray) -> np.ndarray:
        size, B, seen = self.size.reshape(-1, *[1] * (b.ndim - 1)), self.basis, self.sizes > SILENT
        right = b[self.used] / size
        part = self.unit(right - B @ (B.T @ right))
        part -= B @ (B.T @ part)
        part += (B[:, seen] / self.sizes[seen] ** 2) @ (B[:, seen].T @ right)
        x = np.zeros_like(b)
        x[self.used] = part / size
        return x


def step_solver(s: Structure, rows: Sequence[Linearised], r: ReducedEquations) -> SharedSolver:
    """For a step: by Cholesky where S is far from singular; where it is not, with its faint directions, or damped where
    there are too many columns to look for them."""
    used = np.flatnonzero(r.scale > 0)
    if not len(used):
        return _plain(used, r.scale[used], np.copy)
    if isinstance(r.S, np.ndarray):
        S = r.S[np.ix_(used, used)] if len(used) < len(r.scale) else r.S
        own = np.diag(S)
        if own.min() > 0:
            size = np.sqrt(own)
            try:
                factor = scipy.linalg.cho_factor(S / np.outer(size, size), lower=True, check_finite=False)
                if np.diag(factor[0]).min() ** 2 > PIVOT:
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
    """With all faint directions of S, and the lengths of J along them."""
    used, unit = _unit(r)
    size = r.scale[used]
    if not len(used):
        return _plain(used, size, np.copy)
    basis = directions.x[used] * size[:, None]
    if isinstance(unit, np.ndarray):
        factor = scipy.linalg.cho_factor(unit + basis @ basis.T, lower=True, check_finite=False)
        return SharedSolver(used, size, lambda b: scipy.linalg.cho_solve(factor, b), basis, sizes)
    factor = scipy.sparse.linalg.splu(
        (unit + LEAST * scipy.sparse.eye(len(used))).tocsc(),
        permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0,
    )  # fmt: skip
    return SharedSolver(used, size, factor.solve, basis, sizes)


def faint(s: Structure, rows: Sequence[Linearised], r: ReducedEquations) -> tuple[BlockDirections, np.ndarray]:
    """Directions that S hardly sees, or not at all, orthonormal in units of the shared columns, and the lengths of J
    along them."""
    used, unit = _unit(r)
    if isinstance(unit, np.ndarray):
        subset = None if len(used) <= SMALL else [0, SMALLEST - 1]
        values, vectors = scipy.linalg.eigh(unit, subset_by_index=subset) if len(used) else (np.zeros(0), unit)
    else:
        begin = np.ones(len(used))  # ARPACK would take a random one
        values, vectors = scipy.sparse.linalg.eigsh(
            unit.tocsc(), k=min(SMALLEST, len(used) - 1), sigma=-FAINT, v0=begin
        )
    near = vectors[:, values < FAINT]
    x = np.zeros((s.columns, near.shape[1]))
    x[used] = near / r.scale[used, None]
    z = [r.local_part(v, np.zeros_like(r.h)) for v in x.T]
    return BlockDirections(x, np.stack(z, axis=2) if z else np.zeros((*r.h.shape, 0))).by_length(s, rows)


def _unit(r: ReducedEquations) -> tuple[np.ndarray, np.ndarray]:
    """The columns that anything sees, and S of them with columns of J of length one, dense or sparse."""
    used = np.flatnonzero(r.scale > 0)
    size = r.scale[used]
    if isinstance(r.S, np.ndarray):
        return used, r.S[np.ix_(used, used)] / np.outer(size, size)
    scaled = scipy.sparse.diags(1 / size)
    return used, scaled @ r.S[used][:, used] @ scaled
