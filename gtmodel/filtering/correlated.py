"""Noise with a full covariance, by independent numbers: a matrix that mixes them, and their variances."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..results.refusal import ArgumentError

ROUNDING = 1e-9  # of the largest entry: a covariance that another program computed is symmetric to this
SINGULAR = 1e-12  # of its trace: eigenvalues above minus this are round-off of zero
SAME = 1e-9  # of mixing matrices, which have entries about one


def covariance_matrix(value: Any, size: int, argument: str, *, singular: bool) -> np.ndarray:
    """A covariance (size, size) as it was given. Raises ArgumentError for another shape, one that is not symmetric, and
    one that is not positive definite, or with `singular` not even semidefinite."""
    try:
        R = np.asarray(value, float)
    except (TypeError, ValueError):
        R = np.full(0, np.nan)
    if R.shape != (size, size) or not np.isfinite(R).all():
        shown = f"shape {R.shape}" if R.ndim == 2 and np.isfinite(R).all() else repr(value)
        raise ArgumentError(f"expected a covariance ({size}, {size}) of finite numbers; found {shown}", argument)
    if np.abs(R - R.T).max() > ROUNDING * np.abs(R).max():
        i, j = np.unravel_index(int(np.argmax(np.abs(R - R.T))), R.shape)
        sentence = f"expected a symmetric covariance; found {R[i, j]:g} at [{i}, {j}] and {R[j, i]:g} at [{j}, {i}]"
        raise ArgumentError(sentence, argument)
    d = np.sqrt(np.maximum(np.diag(R), 0.0))
    safe = np.where(d > 0, d, 1.0)
    least = float(np.linalg.eigvalsh(R / np.outer(safe, safe) + np.diag(np.where(d > 0, 0.0, 1.0)))[0])
    wrong_axis = bool(np.any(np.diag(R) < 0) or np.any(R[d == 0] != 0))
    if wrong_axis or least < -SINGULAR * size or (not singular and (np.any(d == 0) or least <= SINGULAR)):
        wanted = "positive semidefinite" if singular else "positive definite"
        raise ArgumentError(
            f"expected a {wanted} covariance; found {'a row without a variance' if wrong_axis else ''}"
            f"{'' if wrong_axis else f'a smallest eigenvalue of {least:.3g} in units of its deviations'}",
            argument,
        )
    return (R + R.T) / 2


def mixing(R: np.ndarray) -> np.ndarray:
    """W with W diag(R) W' = R: what makes noise of covariance R of independent numbers of the same variances.

    >>> W = mixing(np.array([[4.0, 1.0], [1.0, 1.0]]))
    >>> (W @ np.diag([4.0, 1.0]) @ W.T).round(12).tolist()
    [[4.0, 1.0], [1.0, 1.0]]
    """
    d = np.sqrt(np.diag(R))
    safe = np.where(d > 0, d, 1.0)
    unit = R / np.outer(safe, safe) + np.diag(np.where(d > 0, 0.0, 1.0))
    try:
        root = np.linalg.cholesky(unit)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(unit)
        root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T  # whatever signs the vectors have
    return safe[:, None] * root / safe


def independent(R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """L and d with L diag(d)^2 L' = R, L lower triangular with ones on its diagonal: L^-1 times numbers of covariance R
    are independent, of deviations d; the first of them depend on the first numbers alone, and no volume changes.

    >>> L, d = independent(np.array([[4.0, 2.0], [2.0, 5.0]]))
    >>> L.tolist(), d.tolist()
    ([[1.0, 0.0], [0.5, 1.0]], [2.0, 2.0])
    """
    root = np.linalg.cholesky(R)
    d = np.diag(root)
    return root / d, d.copy()


def same_mixing(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    """Whether two noises are correlated alike; None stands for not at all."""
    if one is None or other is None:
        return one is other
    return bool(np.allclose(one, other, rtol=0.0, atol=SAME * np.abs(one).max()))
