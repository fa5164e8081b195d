"""Calibration of the three-link robot by a user of NumPy: squared closures, their exact Jacobian, Gauss-Newton.

x (21,) holds A (3, 3), v (3, 3), L (3,); arm k has the closure |T - A_k - q_k v_k|^2 - L_k^2.
"""

from __future__ import annotations

import numpy as np

STEPS, ARRIVED = 50, 1e-12  # Gauss-Newton ends with a step that is this part of the unknowns


def residual(x: np.ndarray, q: np.ndarray, T: np.ndarray) -> np.ndarray:
    """(3 N,), the three closures of a pose side by side."""
    d = T[:, None] - x[:9].reshape(3, 3) - q[:, :, None] * x[9:18].reshape(3, 3)
    return (np.einsum("kij,kij->ki", d, d) - x[18:] ** 2).reshape(-1)


def jacobian(x: np.ndarray, q: np.ndarray, T: np.ndarray) -> np.ndarray:
    """(3 N, 21)."""
    d = -2 * (T[:, None] - x[:9].reshape(3, 3) - q[:, :, None] * x[9:18].reshape(3, 3))
    J = np.zeros((len(q), 3, 21))
    for k in range(3):
        J[:, k, 3 * k : 3 * k + 3] = d[:, k]
        J[:, k, 9 + 3 * k : 12 + 3 * k] = q[:, k, None] * d[:, k]
        J[:, k, 18 + k] = -2 * x[18 + k]
    return J.reshape(-1, 21)


def arm(x: np.ndarray, q: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Gauss-Newton by normal equations on one arm: x (7,) of A, v, L; q (N,), T (3, N) in columns."""
    J = np.empty((7, len(q)))
    J[6] = 1.0
    for _ in range(STEPS):
        d = T - x[:3, None] - q * x[3:6, None]
        r = np.einsum("ik,ik->k", d, d) - x[6] ** 2
        np.multiply(d, -2, out=J[:3])
        np.multiply(J[:3], q, out=J[3:6])
        J[6] = -2 * x[6]
        step = np.linalg.solve(J @ J.T, J @ r)
        x = x - step
        if np.linalg.norm(step) <= ARRIVED * np.linalg.norm(x):
            break
    return x


def arm_by_rows(x: np.ndarray, q: np.ndarray, T: np.ndarray) -> np.ndarray:
    """The same with a row per pose, as most people write it: T (N, 3), J (N, 7)."""
    for _ in range(STEPS):
        d = T - x[:3] - q[:, None] * x[3:6]
        r = np.sum(d * d, axis=1) - x[6] ** 2
        J = np.hstack([-2 * d, -2 * q[:, None] * d, np.full((len(q), 1), -2 * x[6])])
        step = np.linalg.solve(J.T @ J, J.T @ r)
        x = x - step
        if np.linalg.norm(step) <= ARRIVED * np.linalg.norm(x):
            break
    return x


def by_arm(x0: np.ndarray, q: np.ndarray, T: np.ndarray, columns: bool = True) -> np.ndarray:
    """All three arms one by one, on contiguous columns or on rows."""
    poses, x = np.ascontiguousarray(T.T) if columns else T, x0.copy()
    for k in range(3):
        own = [*range(3 * k, 3 * k + 3), *range(9 + 3 * k, 12 + 3 * k), 18 + k]
        x[own] = (arm if columns else arm_by_rows)(x[own], np.ascontiguousarray(q[:, k]), poses)
    return x
