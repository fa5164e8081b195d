"""Time and frequency responses of discrete linear systems via the Schur form, also for defective matrices."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

ON_A_POLE = 4 * sys.float_info.epsilon  # relative to z: accuracy of an eigenvalue, and distance at which z is on a pole


def states(A: np.ndarray, drive: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """Return x (N, n) of x[k+1] = A x[k] + drive[k] for drive (N, n), from x0 (n,)."""
    T, U = _schur(A)
    return np.real(_schur_states(T, drive @ U.conj(), U.conj().T @ x0) @ U.T)


def simulate(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, u: np.ndarray, x0: np.ndarray | None = None
) -> np.ndarray:
    """Return y (N, p) of x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k] for u (N, m), from x0 (n,), default zero."""
    T, U = _schur(A)
    z0 = np.zeros(len(A)) if x0 is None else x0
    z = _schur_states(T, (u @ B.T) @ U.conj(), U.conj().T @ z0)
    return np.real(z @ (C @ U).T) + u @ D.T


def _schur(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    factors: Any = scipy.linalg.schur(A, "complex")
    return factors


def _schur_states(T: np.ndarray, drive: np.ndarray, z0: np.ndarray) -> np.ndarray:
    """As `states` for upper triangular T, computed from the last state to the first."""
    z = np.empty(drive.shape, complex)
    if not len(z):
        return z
    solve: Any = scipy.linalg.get_blas_funcs("tbsv", dtype=np.complex128)  # scipy.signal takes long to import
    band = np.ones((2, len(z)), complex, order="F")  # of z[k + 1] - T[i, i] z[k], which is solved forwards
    for i in range(len(T) - 1, -1, -1):
        into = drive[:, i] + z[:, i + 1 :] @ T[i, i + 1 :]
        band[1] = -T[i, i]
        z[:, i] = solve(1, band, np.append(z0[i], into[:-1]), lower=1, diag=1)
    return z


def free_responses(A: np.ndarray, C: np.ndarray, samples: int) -> np.ndarray:
    """Return C A^k (samples, p, n), outputs for unit initial states, by doubling: log2(samples) products."""
    responses = np.asarray(C, float)[None]
    power = A
    while len(responses) < samples:
        responses = np.concatenate([responses, responses[: samples - len(responses)] @ power])
        power = power @ power
    return responses


def late_lag(u: np.ndarray, a: float, b: float, delay: int) -> np.ndarray:
    """Return the response (N,) of b q^-delay / (1 - a q^-1) to u (N,), from rest; delay in samples."""
    late = np.concatenate([np.zeros(delay), u])[: len(u)]
    return np.asarray(scipy.signal.lfilter([b], [1.0, -a], late))


class Transfer:
    """leaves (z - A)^-1 entries for A (n, n), entries (n, k), leaves (n,), via the Schur form of the balanced A.

    A single z is a Python number, evaluated without NumPy; several z are an array.

    >>> from gtmodel.linear.response import Transfer
    >>> lag = Transfer(np.array([[0.5]]), np.array([[2.0]]), np.array([1.0]))
    >>> lag.at(1.0 + 0j, [1.0]), lag.at(np.array([1.0 + 0j, -0.5 + 0j]), [1.0])
    ((4+0j), array([ 4.+0.j, -2.+0.j]))
    """

    def __init__(self, A: np.ndarray, entries: np.ndarray, leaves: np.ndarray) -> None:
        # balanced by powers of two, without rounding; otherwise slow states lose digits to fast ones
        balanced, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
        triangle, turn = scipy.linalg.schur(balanced, output="complex")
        self._arrays = triangle, turn.conj().T @ (entries / scale[:, None]), (leaves * scale) @ turn
        self._rows: list[list[complex]] = triangle.tolist()
        self._entries: list[list[complex]] = self._arrays[1].tolist()
        self._leaves: list[complex] = self._arrays[2].tolist()

    def at(self, z: Any, inputs: Sequence[Any]) -> Any:
        """Return the output for `inputs`, one for each column of entries, at one z or an array of z.

        At a pole, within rounding, a single z raises ZeroDivisionError; an array is divided by zero there.
        """
        if isinstance(z, np.ndarray):
            return self._along(z, inputs)
        x, out = [z] * len(self._rows), 0 * z
        for i in range(len(x) - 1, -1, -1):
            row = self._rows[i]
            right = 0 * z
            for entry, size in zip(self._entries[i], inputs, strict=True):
                right = right + entry * size
            for j in range(i + 1, len(x)):
                right = right + row[j] * x[j]
            distance = z - row[i]
            x[i] = right / (distance * (abs(distance) > ON_A_POLE * abs(z)))
            out = out + self._leaves[i] * x[i]
        return out

    def _along(self, z: np.ndarray, inputs: Sequence[Any]) -> np.ndarray:
        T, entries, leaves = self._arrays
        flat: Any = z.ravel()
        x = np.empty((len(T), z.size), complex)
        near = ON_A_POLE**2 * (flat.real**2 + flat.imag**2)
        for i in range(len(T) - 1, -1, -1):
            x[i] = T[i, i + 1 :] @ x[i + 1 :]
            for entry, size in zip(entries[i], inputs, strict=True):
                x[i] += entry * np.ravel(size)
            distance = flat - T[i, i]
            x[i] /= distance * (distance.real**2 + distance.imag**2 > near)
        return (leaves @ x).reshape(z.shape)
