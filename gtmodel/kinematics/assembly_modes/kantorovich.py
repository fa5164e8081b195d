"""Is there exactly one solution near an approximate one? The Newton-Kantorovich test for quadrics.

At z with |z| = 1, in the affine patch z*.w = 1, let beta = |step of Newton| and K = |J^-1| |D2F|, with D2F constant
because F is quadratic. If h = beta K <= 1/2, one solution lies within r = (1 - sqrt(1 - 2h)) / K of z and no other
within rho = (1 + sqrt(1 - 2h)) / K. Two points whose balls of uniqueness do not meet are different solutions; a
point whose conjugate lies within its rho is real, for conjugates of solutions are solutions. The numbers are
computed in double precision, not in intervals: a proof but for rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .platform import Real
from .study import EQUATIONS, VARIABLES, Array, gradients

STRICT = 0.1  # largest h that is trusted: at an exact double solution h tends to 1/2, whatever the precision
BASIS_MATRICES = np.moveaxis(gradients(np.eye(VARIABLES)), 0, -1)  # (18, 8, 8): D(z) = BASIS_MATRICES z


@dataclass(frozen=True)
class Isolation:
    """Per point (m,): certified (h small), rho (radius of uniqueness, 0 if not certified), condition number."""

    certified: NDArray[np.bool_]
    rho: Real
    condition: Real


def isolate(C: Array, z: Array) -> Isolation:
    """Test points z (m, 8), |z| = 1, as solutions of the systems C (m, 7, 18)."""
    D = gradients(z)
    matrix = np.empty((len(z), VARIABLES, VARIABLES), dtype=complex)
    matrix[:, :EQUATIONS] = C @ D
    matrix[:, EQUATIONS] = np.conj(z)
    U, values, _ = np.linalg.svd(matrix)
    residual = np.zeros((len(z), VARIABLES), dtype=complex)
    residual[:, :EQUATIONS] = 0.5 * (matrix[:, :EQUATIONS] @ z[:, :, None])[..., 0]
    with np.errstate(all="ignore"):
        turned = np.conj(np.swapaxes(U, 1, 2)) @ residual[:, :, None]
        beta = np.linalg.norm(turned[..., 0] / values, axis=1)
        K = _second_derivative(C) / values[:, -1]
        h = beta * K
        certified = h <= STRICT
        rho = np.where(certified, (1 + np.sqrt(np.where(certified, 1 - 2 * h, 0))) / K, 0.0)
        return Isolation(certified, rho, values[:, 0] / values[:, -1])


def _second_derivative(C: Array) -> Real:
    """A bound of |D2F| for systems C (m, 7, 18): root of the sum of squares of the Hessians' spectral norms."""
    hessians = np.tensordot(C, BASIS_MATRICES, axes=(2, 0))
    return np.sqrt(np.sum(np.linalg.norm(hessians, ord=2, axis=(-2, -1)) ** 2, axis=-1))
