"""The equations of the shared unknowns solved: by Cholesky, by eigenvalues where they are singular, or sparsely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from .elimination import ReducedEquations

# of S with columns of J of length one: eigenvalues below this part of the largest may be rounding
ROUNDING = 1e-11
# of the diagonal of the Cholesky factor of S with a diagonal of ones, squared: below, S may be singular
PIVOT = 1e-9
# columns up to which a singular S is taken apart by eigenvalues; above it is damped by LEAST
SMALL, LEAST = 1500, 1e-9


@dataclass(eq=False)
class SharedSolver:
    """Solves S x = b on the columns that anything sees; what nothing determines stays zero."""

    used: np.ndarray
    factor: Any
    kind: str
    size: np.ndarray

    def __call__(self, b: np.ndarray) -> np.ndarray:
        x = np.zeros_like(b)
        size = self.size if b.ndim == 1 else self.size[:, None]
        if not len(self.used):
            return x
        right = b[self.used] / size
        if self.kind == "cholesky":
            part = scipy.linalg.cho_solve(self.factor, right)
        elif self.kind == "eigen":
            values, vectors = self.factor
            part = vectors @ ((vectors.T @ right) / (values if b.ndim == 1 else values[:, None]))
        else:
            part = self.factor.solve(right)
        x[self.used] = part / size
        return x


def solver(r: ReducedEquations) -> SharedSolver:
    """Of the reduced equations; by pseudo-inverse where they are singular and not too many."""
    used = np.flatnonzero(r.scale > 0)
    if not isinstance(r.S, np.ndarray):
        return _sparse(r, used)
    S = r.S[np.ix_(used, used)] if len(used) < len(r.scale) else r.S
    own = np.diag(S)
    if len(used) and own.min() > 0:
        size = np.sqrt(own)
        try:
            factor = scipy.linalg.cho_factor(S / np.outer(size, size), lower=True, check_finite=False)
            if np.diag(factor[0]).min() ** 2 > PIVOT:
                return SharedSolver(used, factor, "cholesky", size)
        except np.linalg.LinAlgError:
            pass
    size = r.scale[used]
    unit = S / np.outer(size, size)
    if len(used) > SMALL:
        factor = scipy.linalg.cho_factor(unit + LEAST * np.eye(len(used)), lower=True, check_finite=False)
        return SharedSolver(used, factor, "cholesky", size)
    values, vectors = np.linalg.eigh(unit)
    good = values > ROUNDING * values.max(initial=0.0)
    return SharedSolver(used, (values[good], vectors[:, good]), "eigen", size)


def _sparse(r: ReducedEquations, used: np.ndarray) -> SharedSolver:
    size = r.scale[used]
    scaled = scipy.sparse.diags(1 / size)
    unit = (scaled @ r.S[used][:, used] @ scaled + LEAST * scipy.sparse.eye(len(used))).tocsc()
    factor = scipy.sparse.linalg.splu(
        unit, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0
    )
    return SharedSolver(used, factor, "sparse", size)
