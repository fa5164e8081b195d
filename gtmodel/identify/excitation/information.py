"""How much information a regressor has on its parameters: condition number, determinant, standard deviations.

W (samples, p) are the stacked rows of the regressor. Columns are scaled by nominal values first: the parameters
are then relative ones, and kilograms beside newtons compare. The information matrix is M = (W s)'(W s) / samples.
"""

from __future__ import annotations

from typing import Literal

import casadi as ca
import numpy as np
import numpy.typing as npt

Array = np.ndarray
Criterion = Literal["condition", "determinant", "variance"]
CRITERIA: tuple[Criterion, ...] = ("condition", "determinant", "variance")
DOUBLINGS = 2  # the surrogate takes the 4-norm of the eigenvalues: within p^(1/4) of their largest


def condition(W: Array, nominal: npt.ArrayLike) -> float:
    """Condition number of a stacked regressor W (samples, p), its columns scaled by `nominal` values (p,).

    It is the largest over the smallest singular value, and infinite where columns are dependent exactly.

    >>> time = np.linspace(0.0, 1.0, 101)
    >>> W = np.column_stack([np.ones(101), time])
    >>> round(gt.identify.condition(W, [1.0, 1.0]), 2), round(gt.identify.condition(W, [1.0, 2.0]), 2)
    (4.35, 3.75)
    """
    s = singular_values(W, nominal)
    return float(s[0] / s[-1]) if s[-1] > 0 else float("inf")


def singular_values(W: Array, nominal: npt.ArrayLike) -> Array:
    """Singular values (p,) of a stacked regressor W (samples, p) over the root of its samples, largest first.

    Columns are scaled by `nominal` values (p,), so that the singular values are in the unit of the efforts.

    >>> W = np.column_stack([np.ones(4), [1.0, -1.0, 1.0, -1.0]])
    >>> gt.identify.singular_values(W, [3.0, 0.5])
    array([3. , 0.5])
    """
    scaled = W * np.asarray(nominal, float)
    singular = np.linalg.svd(scaled, compute_uv=False) / np.sqrt(len(W))
    return np.concatenate([singular, np.zeros(W.shape[1] - len(singular))])


def predicted_deviations(W: Array, noise: float) -> Array:
    """Standard deviations (p,) of the parameters fitted to the rows of W (samples, p), each with independent noise.

    `noise` is its standard deviation; the covariance is noise^2 (W'W)^-1. All are infinite where the columns are
    dependent.

    >>> W = np.column_stack([np.ones(100), np.linspace(-1.0, 1.0, 100)])
    >>> gt.identify.predicted_deviations(W, noise=30.0).round(2)
    array([3.  , 5.14])
    """
    size = np.linalg.norm(W, axis=0)
    if np.any(size == 0):
        return np.full(W.shape[1], np.inf)
    _, s, Vt = np.linalg.svd(W / size, full_matrices=False)
    if len(s) < W.shape[1] or s[-1] <= np.finfo(float).eps * len(W) * s[0]:
        return np.full(W.shape[1], np.inf)
    return noise * np.linalg.norm(Vt.T / s, axis=1) / size


def cost(criterion: Criterion, size: int) -> ca.Function:
    """M (size, size) -> what to minimise, smooth.

    condition: log of the ratio of 4-norms of the eigenvalues of M and of its inverse, an upper bound of 2 log of the
    condition number that is at most log(size)/2 above it; the condition number itself is not smooth. determinant: -log
    det M / size, log of the mean relative variance in the geometric sense. variance: log of the trace of the inverse.
    """
    M = ca.SX.sym("M", size, size)
    R = ca.chol(M)
    inverse = ca.solve(R, ca.SX.eye(size))  # of the triangle: M^-1 = inverse inverse'
    if criterion == "determinant":
        value = -2 * ca.sum1(ca.log(ca.diag(R))) / size
    elif criterion == "variance":
        value = ca.log(ca.sumsqr(inverse))
    else:
        value = _log_norm(M) + _log_norm(ca.mtimes(inverse, inverse.T))
    return ca.Function("cost", [M], [value])


def _log_norm(M: ca.SX) -> ca.SX:
    """log of the 2^DOUBLINGS-norm of the eigenvalues of a symmetric matrix: from the trace of its power."""
    power = M
    for _ in range(DOUBLINGS - 1):
        power = ca.mtimes(power, power)
    return ca.log(ca.sumsqr(power)) / 2**DOUBLINGS
