"""Symmetric positive definite M, D, K nearest to matrices that are not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..inference.nonlinear import by_differences, nonlinear_fit
from ..results import ArgumentError
from .modes import REAL, matrices


@dataclass(frozen=True, eq=False)
class DefiniteForm:
    """Symmetric M and K (p, p), positive definite, with the given M^-1 K, and the nearest symmetric D >= 0.

    trace(M) is that of the given M. `asymmetry`: relative size of the part of D that no choice of M makes symmetric;
    `raised`: relative size of what was added to make D positive semidefinite; both 0 for a passive structure. `notes`
    say so.
    """

    M: np.ndarray
    D: np.ndarray
    K: np.ndarray
    asymmetry: float
    raised: float
    notes: tuple[str, ...]


def definite_form(M: ArrayLike, D: ArrayLike, K: ArrayLike) -> DefiniteForm:
    """A passive structure with the frequencies and shapes of M x'' + K x = 0 and damping as near to D as may be.

    With M^-1 K = V diag(w^2) V^-1, M = V^-T S V^-1 and K = V^-T S diag(w^2) V^-1 are symmetric positive definite for
    every diagonal S > 0; S makes D = M (M^-1 D) as symmetric as it gets, in modal coordinates of unit mass, where its
    symmetric part is then projected on the positive semidefinite ones. Raises ArgumentError for other shapes, a
    singular M, and M^-1 K with an eigenvalue that is not real and positive: no such structure has those modes.

    >>> M, D = np.diag([30.0, 12.0]), np.array([[210.0, -60.0], [-60.0, 60.0]])
    >>> K = np.array([[150e3, -80e3], [-90e3, 90e3]])  # not symmetric, as printed or measured
    >>> nearest = gt.vibration.definite_form(M, D, K)
    >>> np.allclose(nearest.K, nearest.K.T)
    True
    >>> gt.vibration.modes(nearest.M, nearest.D, nearest.K).frequency_Hz.round(3)
    array([ 6.379, 16.611])
    >>> gt.vibration.modes(M, D, K).frequency_Hz.round(3)
    array([ 6.379, 16.611])
    """
    M0, D0, K0 = matrices(M, D, K)
    p = len(M0)
    X_K, X_D = np.linalg.solve(M0, K0), np.linalg.solve(M0, D0)
    values, V = np.linalg.eig(X_K)
    if np.abs(np.imag(values)).max() > REAL * np.abs(values).max() or np.any(np.real(values) <= 0):
        eigenvalues = ", ".join(f"{v:.4g}" for v in values)
        raise ArgumentError(
            f"M^-1 K has the eigenvalues {eigenvalues} 1/s2; a structure with symmetric positive definite M and K has "
            "positive ones only: look at the signs of M and K"
        )
    V = np.real(V)
    C = np.linalg.solve(V, X_D @ V)
    size = max(float(np.linalg.norm(C)), 1e-300)
    upper = np.triu_indices(p, 1)

    def scaled(x: np.ndarray) -> np.ndarray:
        e = np.exp(np.append(0.0, x) / 2)
        return C * e[:, None] / e[None, :]

    x = np.zeros(p - 1)
    if p > 1 and np.any(C[upper]):
        residuals = by_differences(lambda x: (scaled(x) - scaled(x).T)[upper] / size, len(upper[0]))
        x = nonlinear_fit(residuals, x, [f"x[{k}]" for k in range(p - 1)], sigma=1.0, hold_undetermined=True).x
    S = scaled(x)
    asymmetry = float(np.linalg.norm(S - S.T) / 2 / max(float(np.linalg.norm(S)), 1e-300))
    w, Q = np.linalg.eigh((S + S.T) / 2)
    above = np.maximum(w, 0.0)
    raised = float(np.linalg.norm(above - w) / max(float(np.linalg.norm(w)), 1e-300))
    # mass-normalised shapes P with P' M P = 1
    W = np.exp(np.append(0.0, x) / 2)[:, None] * np.linalg.inv(V)
    m, d = W.T @ W, W.T @ (Q * above) @ Q.T @ W
    k = W.T @ np.diag(np.real(values)) @ W
    size = abs(float(np.trace(M0))) / float(np.trace(m))
    notes = ["M and K are symmetric and positive definite, with the frequencies and shapes of the given M^-1 K"]
    if asymmetry > REAL:
        notes.append(f"{100 * asymmetry:.3g} % of the damping is not symmetric for any M: that part was left out")
    if raised > REAL:
        notes.append(
            f"the damping is not passive: {100 * raised:.3g} % was added to make D positive semidefinite"
        )  # fmt: skip
    return DefiniteForm(size * m, size * d, size * k, asymmetry, raised, tuple(notes))
