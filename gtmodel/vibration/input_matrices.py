"""B, D and the initial state of a subspace model: linear least squares on the simulated outputs, given A and C."""

from __future__ import annotations

import numpy as np

from ..linear.response import free_responses, states
from .record import Record


def input_matrices(
    record: Record, A: np.ndarray, C: np.ndarray, *, feedthrough: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """B (n, m), D (p, m), x0 (n,) and the outputs' offset (p,) whose simulated outputs are nearest to the measured ones
    in the 2-norm.

    Without `feedthrough` D is zero. A must be stable over the record: powers of an unstable one overflow.
    """
    N, p, m, n = len(record), len(C), record.u.shape[1], len(A)
    F = np.zeros((p, N, m * n + n + p))
    for i in range(p):
        # the transposed system gives C_i (qI - A)^-1 u_j for all states at once
        for j in range(m):
            F[i, :, j * n : (j + 1) * n] = states(A.T, np.outer(record.u[:, j], C[i]), np.zeros(n))
    F[:, :, m * n : m * n + n] = np.moveaxis(free_responses(A, C, N), 1, 0)
    F[range(p), :, range(m * n + n, m * n + n + p)] = 1.0
    right = record.y.T
    if feedthrough:
        # D touches one output each: eliminated output by output
        F, right, fit = _without(F, right, record.u)
    size = np.linalg.norm(F, axis=(0, 1))
    size[size == 0] = 1.0
    x = np.linalg.lstsq((F / size).reshape(p * N, -1), right.ravel(), rcond=None)[0] / size
    D = np.zeros((p, m))
    if feedthrough:
        D = np.stack([fit[i][0] - fit[i][1] @ x for i in range(p)])  # pyright: ignore[reportPossiblyUnboundVariable]
    return x[: m * n].reshape(m, n).T, D, x[m * n : m * n + n], x[m * n + n :]


def _without(
    F: np.ndarray, right: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Rows with what u explains at once taken out, and how D follows from the rest: D_i = d - G x."""
    plus = np.linalg.pinv(u)
    fit = [(plus @ r, plus @ f) for r, f in zip(right, F, strict=True)]
    taken = [f - u @ g for f, (_, g) in zip(F, fit, strict=True)]
    rest = [r - u @ d for r, (d, _) in zip(right, fit, strict=True)]
    return np.stack(taken), np.stack(rest), fit
