"""Information of a regressor on its parameters: condition number, determinant, standard deviations.

W (samples, p) are the stacked rows of the regressor. Scaling the columns by nominal values makes parameters relative,
so that kilograms and newtons compare. The information matrix is M = (W s)'(W s) / samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = np.ndarray
Criterion = Literal["condition", "determinant", "variance"]
CRITERIA: tuple[Criterion, ...] = ("condition", "determinant", "variance")
# powers of the eigenvalues: their 4-norm is within p^(1/4) of the largest
POWERS = {"condition": (4, -4), "variance": (-1,)}


def condition(W: Array, nominal: npt.ArrayLike) -> float:
    """Return the condition number of a stacked regressor W (samples, p), its columns scaled by `nominal` values (p,).

    It is the ratio of the largest to the smallest singular value; infinite if columns are exactly dependent.

    >>> time = np.linspace(0.0, 1.0, 101)
    >>> W = np.column_stack([np.ones(101), time])
    >>> round(gt.identify.condition(W, [1.0, 1.0]), 2), round(gt.identify.condition(W, [1.0, 2.0]), 2)
    (4.35, 3.75)
    """
    s = singular_values(W, nominal)
    return float(s[0] / s[-1]) if s[-1] > 0 else float("inf")


def singular_values(W: Array, nominal: npt.ArrayLike) -> Array:
    """Return the singular values (p,) of W (samples, p) over the square root of the samples, largest first.

    The columns are scaled by `nominal` values (p,), so that the singular values have the unit of the efforts.

    >>> W = np.column_stack([np.ones(4), [1.0, -1.0, 1.0, -1.0]])
    >>> gt.identify.singular_values(W, [3.0, 0.5])
    array([3. , 0.5])
    """
    scaled = W * np.asarray(nominal, float)
    singular = np.linalg.svd(scaled, compute_uv=False) / np.sqrt(len(W))
    return np.concatenate([singular, np.zeros(W.shape[1] - len(singular))])


def predicted_deviations(W: Array, noise: float) -> Array:
    """Return the standard deviations (p,) of parameters fitted to the rows of W (samples, p) with independent noise.

    `noise` is the standard deviation of the noise; the covariance is noise^2 (W'W)^-1. All are infinite if the columns
    are dependent.

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


@dataclass(frozen=True, eq=False)
class CriterionAt:
    """The cost of a criterion at an information matrix M (p, p): a smooth function of its eigenvalues l.

    condition: log of the product of the 4-norms of the eigenvalues of M and of its inverse. It exceeds 2 log of the
    condition number, which is not smooth, by at most log(p)/2. determinant: -log det M / p, log of the geometric mean
    of the relative variances. variance: log of the trace of the inverse.
    """

    criterion: Criterion
    M: Array

    @cached_property
    def _eigen(self) -> tuple[Array, Array]:
        return np.linalg.eigh(self.M)

    @cached_property
    def value(self) -> float:
        """The cost; infinite if M is not finite or not positive definite."""
        if not np.all(np.isfinite(self.M)) or self._eigen[0][0] <= 0:
            return np.inf
        l = self._eigen[0]
        if self.criterion == "determinant":
            return -float(np.mean(np.log(l)))
        return sum(float(np.log(np.sum(l**q))) / abs(q) for q in POWERS[self.criterion])

    @cached_property
    def gradient(self) -> Array:
        """(p, p) derivative with respect to M."""
        U = self._eigen[1]
        return (U * self._by_eigenvalues[0]) @ U.T

    def second(self, D: Array) -> Array:
        """(n, n) second derivatives along symmetric directions D (n, p, p)."""
        U, (_, rise, both) = self._eigen[1], self._by_eigenvalues
        rotated = U.T @ D @ U
        diagonal = np.diagonal(rotated, axis1=1, axis2=2)
        return np.tensordot(rotated * rise, rotated, ((1, 2), (1, 2))) + diagonal @ both @ diagonal.T

    @cached_property
    def _by_eigenvalues(self) -> tuple[Array, Array, Array]:
        """The first derivative g (p,) with respect to the eigenvalues; (g_i - g_j) / (l_i - l_j), the term from
        rotating eigenvectors (Lewis and Sendov 2001, Twice differentiable spectral functions); the remaining second
        derivative."""
        l = self._eigen[0]
        p = len(l)
        if self.criterion == "determinant":
            return -1 / (p * l), _divided_difference(l, -1) / -p, np.zeros((p, p))
        g, rise, both = np.zeros(p), np.zeros((p, p)), np.zeros((p, p))
        for q in POWERS[self.criterion]:
            factor = np.sign(q) / np.sum(l**q)
            term = factor * l ** (q - 1.0)
            g += term
            rise += factor * _divided_difference(l, q - 1)
            both -= abs(q) * np.outer(term, term)
        return g, rise, both


def _divided_difference(l: Array, q: int) -> Array:
    """(l_i^q - l_j^q) / (l_i - l_j) as a sum of terms of one sign, which is also valid for equal eigenvalues."""
    a, b = l[:, None], l
    if q > 0:
        return sum((a**k * b ** (q - 1 - k) for k in range(q)), np.zeros((len(l), len(l))))
    return -sum((a ** (-1.0 - k) * b ** (q + k) for k in range(-q)), np.zeros((len(l), len(l))))
