"""State spaces as matrices: from continuous to discrete time, of masses and springs, their poles, and the covariance
at which a Kalman filter settles."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

SETTLES = 1e-9  # per step: a filter that forgets its start more slowly, in a thousand million steps, does not


def held(A: np.ndarray, B: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """F (..., n, n) and G (..., n, m) of x(t + step) = F x + G u for an input held over the step (zero-order hold).

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
    """F, first and last of x(t + step) = F x + first u(t) + last u(t + step) for an input that is straight between.

    Shapes as of `held`; a step of zero moves nothing.
    """
    n, m = B.shape[-2:]
    driven = np.zeros((*B.shape[:-2], n + m, n + m))
    driven[..., :n, :n], driven[..., :n, n:] = A * step, B * step
    F, last = held(driven, np.broadcast_to(np.eye(n + m, m, -n), (*B.shape[:-2], n + m, m)), 1.0)
    return F[..., :n, :n], F[..., :n, n:] - last[..., :n, :], last[..., :n, :]


def held_late(
    A: np.ndarray, B: np.ndarray, rest: float, left: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """F, early and late of x(t + rest + left) = F x + early v + late u: v is held for `rest` [s], u for `left` [s]."""
    (first, early), (last, late) = held(A, B, rest), held(A, B, left)
    return last @ first, last @ early, late


def second_order(
    M: np.ndarray, D: np.ndarray, K: np.ndarray, F: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """A (..., 2p, 2p), B (..., 2p, m) and C (p, 2p) of M x'' + D x' + K x = F u with the states (x, x') and the outputs
    x; M, D, K (..., p, p), F (..., p, m)."""
    lead, (p, m) = np.broadcast_shapes(*(X.shape[:-2] for X in (M, D, K, F))), F.shape[-2:]
    X = np.linalg.solve(M, np.concatenate([np.broadcast_to(X, (*lead, *X.shape[-2:])) for X in (K, D, F)], axis=-1))
    A, B = np.zeros((*lead, 2 * p, 2 * p)), np.zeros((*lead, 2 * p, m))
    A[..., :p, p:], A[..., p:, :], B[..., p:, :] = np.eye(p), -X[..., : 2 * p], X[..., 2 * p :]
    return A, B, np.eye(p, 2 * p)


def continuous_poles(z: Any, sample_time: float) -> Any:
    """s = log(z) / T [1/s], those below the Nyquist frequency; z other than 0."""
    return np.log(np.asarray(z, complex)) / sample_time


def frequency_and_damping(s: Any) -> tuple[Any, Any]:
    """Undamped frequency |s| / 2 pi [Hz] and damping ratio -Re s / |s|, 0 of a pole at zero, below 0 of one that grows.

    >>> from gtmodel.linear.state_space import frequency_and_damping
    >>> frequency, damping = frequency_and_damping(2 * np.pi * np.array([3.0j, -4.0 + 3.0j]))
    >>> frequency.round(12), (damping + 0.0).round(12)
    (array([3., 5.]), array([0. , 0.8]))
    """
    size = np.abs(s)
    return size / (2 * np.pi), -np.real(s) / np.where(size > 0, size, 1.0)


def settled_covariance(F: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Covariance (n, n) before a reading at which a filter of F (n, n), H (k, n), Q (n, n) and the variances R (k,)
    settles. Raises numpy.linalg.LinAlgError where there is none."""
    scale = np.sqrt(np.where(np.diag(Q) > 0, np.diag(Q), 1.0))  # position and acceleration differ by 1e8
    own = H / np.sqrt(R)[:, None]
    P = scipy.linalg.solve_discrete_are(
        (F * scale / scale[:, None]).T, (own * scale).T, Q / np.outer(scale, scale), np.eye(len(R))
    ) * np.outer(scale, scale)
    if not np.all(np.isfinite(P)) or np.any(np.diag(P) < 0) or _slowest(F, own, P) > 1 - SETTLES:
        raise np.linalg.LinAlgError("no filter settles")
    return P


def _slowest(F: np.ndarray, own: np.ndarray, P: np.ndarray) -> float:
    """By how much the error of a filter with this covariance before a reading shrinks from step to step, at worst."""
    left = F - F @ P @ own.T @ np.linalg.solve(own @ P @ own.T + np.eye(len(own)), own)
    return float(np.abs(np.linalg.eigvals(left)).max())
