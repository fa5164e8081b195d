"""Responses of discrete linear systems, filtered along a Schur form: fast in N, safe for defective matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import expm, schur
from scipy.signal import lfilter


def states(A: np.ndarray, drive: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """x (N, n) of x[k+1] = A x[k] + drive[k] with drive (N, n), from x0 (n,)."""
    T, U = _schur(A)
    return np.real(_schur_states(T, drive @ U.conj(), U.conj().T @ x0) @ U.T)


def simulate(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, u: np.ndarray, x0: np.ndarray | None = None
) -> np.ndarray:
    """y (N, p) of x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k] under u (N, m), from x0 (n,), default zero."""
    T, U = _schur(A)
    z0 = np.zeros(len(A)) if x0 is None else x0
    z = _schur_states(T, (u @ B.T) @ U.conj(), U.conj().T @ z0)
    return np.real(z @ (C @ U).T) + u @ D.T


def _schur(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    factors: Any = schur(A, "complex")
    return factors


def _schur_states(T: np.ndarray, drive: np.ndarray, z0: np.ndarray) -> np.ndarray:
    """The same for upper triangular T, from the last state to the first."""
    z = np.empty(drive.shape, complex)
    for i in range(len(T) - 1, -1, -1):
        into = drive[:, i] + z[:, i + 1 :] @ T[i, i + 1 :]
        z[:, i] = lfilter([0.0, 1.0], [1.0, -T[i, i]], into, zi=[z0[i]])[0]
    return z


def free_responses(A: np.ndarray, C: np.ndarray, samples: int) -> np.ndarray:
    """C A^k (samples, p, n): outputs from each unit initial state. By doubling, log2(samples) products."""
    responses = np.asarray(C, float)[None]
    power = A
    while len(responses) < samples:
        responses = np.concatenate([responses, responses[: samples - len(responses)] @ power])
        power = power @ power
    return responses


def held(A: np.ndarray, B: np.ndarray, sample_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Discrete (A, B) of x' = A x + B u with u held over each sample, exactly (zero-order hold)."""
    n, m = B.shape
    E = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * sample_time)
    return E[:n, :n], E[:n, n:]
