"""State-space matrices: discretisation, second-order systems, poles, steady-state covariance of a Kalman filter."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

SETTLES = 1e-9  # least decay per step of a filter's initial error; a slower filter counts as not stationary


def held(A: np.ndarray, B: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return F (..., n, n) and G (..., n, m) of x(t + step) = F x + G u for a zero-order hold.

    A (..., n, n), B (..., n, m); step [s].

    >>> from gtmodel.linear.state_space import held
    >>> F, G = held(np.array([[-1.0]]), np.array([[1.0]]), np.log(2.0))
    >>> F.round(12), G.round(12)
    (array([[0.5]]), array([[0.5]]))
    """
    n, m = B.shape[-2:]
    block = np.zeros((*np.broadcast_shapes(A.shape[:-2], B.shape[:-2]), n + m, n + m))
    block[..., :n, :n], block[..., :n, n:] = A, B
    E = scipy.linalg.expm(block * step)
    return E[..., :n, :n], E[..., :n, n:]


def ramped(A: np.ndarray, B: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return F, first and last of x(t + step) = F x + first u(t) + last u(t + step) for a linearly interpolated input.

    Shapes as in `held`; for a step of zero the state is unchanged.
    """
    n, m = B.shape[-2:]
    driven = np.zeros((*B.shape[:-2], n + m, n + m))
    driven[..., :n, :n], driven[..., :n, n:] = A * step, B * step
    F, last = held(driven, np.broadcast_to(np.eye(n + m, m, -n), (*B.shape[:-2], n + m, m)), 1.0)
    return F[..., :n, :n], F[..., :n, n:] - last[..., :n, :], last[..., :n, :]


def held_late(
    A: np.ndarray, B: np.ndarray, rest: float, left: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return F, early and late of x(t + rest + left) = F x + early v + late u: v is held for `rest` [s], then u for
    `left` [s]."""
    (first, early), (last, late) = held(A, B, rest), held(A, B, left)
    return last @ first, last @ early, late


def second_order(
    M: np.ndarray, D: np.ndarray, K: np.ndarray, F: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return A (..., 2p, 2p), B (..., 2p, m), C (p, 2p) of M x'' + D x' + K x = F u with states (x, x') and outputs x.

    M, D, K: (..., p, p); F: (..., p, m).
    """
    lead, (p, m) = np.broadcast_shapes(*(X.shape[:-2] for X in (M, D, K, F))), F.shape[-2:]
    X = np.linalg.solve(M, np.concatenate([np.broadcast_to(X, (*lead, *X.shape[-2:])) for X in (K, D, F)], axis=-1))
    A, B = np.zeros((*lead, 2 * p, 2 * p)), np.zeros((*lead, 2 * p, m))
    A[..., :p, p:], A[..., p:, :], B[..., p:, :] = np.eye(p), -X[..., : 2 * p], X[..., 2 * p :]
    return A, B, np.eye(p, 2 * p)


def continuous_poles(z: Any, sample_time: float) -> Any:
    """Return s = log(z) / T [1/s], the poles below the Nyquist frequency; z must not be 0."""
    return np.log(np.asarray(z, complex)) / sample_time


def frequency_and_damping(s: Any) -> tuple[Any, Any]:
    """Return undamped frequency |s| / 2 pi [Hz] and damping ratio -Re s / |s|: 0 for s = 0, negative if unstable.

    >>> from gtmodel.linear.state_space import frequency_and_damping
    >>> frequency, damping = frequency_and_damping(2 * np.pi * np.array([3.0j, -4.0 + 3.0j]))
    >>> frequency.round(12), (damping + 0.0).round(12)
    (array([3., 5.]), array([0. , 0.8]))
    """
    size = np.abs(s)
    return size / (2 * np.pi), -np.real(s) / np.where(size > 0, size, 1.0)


def settled_covariance(F: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return the steady-state predicted covariance (n, n) of a Kalman filter with F (n, n), H (k, n), Q (n, n) and
    measurement variances R (k,). Raises numpy.linalg.LinAlgError if the filter has no steady state."""
    scale = np.sqrt(np.where(np.diag(Q) > 0, np.diag(Q), 1.0))  # position and acceleration differ by 1e8
    whitened = H / np.sqrt(R)[:, None]
    P = scipy.linalg.solve_discrete_are(
        (F * scale / scale[:, None]).T, (whitened * scale).T, Q / np.outer(scale, scale), np.eye(len(R))
    ) * np.outer(scale, scale)
    if not np.all(np.isfinite(P)) or np.any(np.diag(P) < 0) or _slowest(F, whitened, P) > 1 - SETTLES:
        raise np.linalg.LinAlgError("there is no stationary Kalman filter")
    return P


def _slowest(F: np.ndarray, H: np.ndarray, P: np.ndarray) -> float:
    """Spectral radius of the error dynamics of a filter with predicted covariance P and whitened H."""
    error = F - F @ P @ H.T @ np.linalg.solve(H @ P @ H.T + np.eye(len(H)), H)
    return float(np.abs(np.linalg.eigvals(error)).max())
