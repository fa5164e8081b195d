"""Matrices of intervals: products, and a lower bound of the smallest singular value (Rump, Acta Numerica 2010)."""

from __future__ import annotations

import numpy as np

from .intervals import Array, Interval, add, multiply, outward, point, subtract
from .rounding import GROWN


def product(a: Interval, b: Interval) -> Interval:
    """Return the products of matrices (n, i, k) and (n, k, j)."""
    total = point(np.zeros(1))
    for k in range(a.lo.shape[2]):
        term = multiply(
            Interval(a.lo[:, :, k, None], a.hi[:, :, k, None]), Interval(b.lo[:, k, None], b.hi[:, k, None])
        )
        total = term if k == 0 else add(total, term)
    return total


def midpoint_inverses(matrices: Interval) -> Array:
    """Return approximate inverses (n, m, m) of the midpoints; NaN without one."""
    middle = 0.5 * (matrices.lo + matrices.hi)
    result = np.full(middle.shape, np.nan)
    good = np.isfinite(middle).all(axis=(1, 2))
    try:
        result[good] = np.linalg.inv(middle[good])
    except np.linalg.LinAlgError:
        for k in np.flatnonzero(good):
            try:
                result[k] = np.linalg.inv(middle[k])
            except np.linalg.LinAlgError:
                continue
    return result


def upper_norm(matrices: Array) -> Array:
    """Return upper bounds (n,) of the spectral norm of matrices (n, m, m) with entries of at most these sizes."""
    size = np.abs(matrices)
    return np.sqrt(size.sum(axis=1).max(axis=1) * size.sum(axis=2).max(axis=1)) * GROWN


def remainder(inverses: Array, matrices: Interval) -> Interval:
    """Return I - C J for all J in the intervals."""
    return subtract(point(np.eye(inverses.shape[1])[None]), product(point(inverses), matrices))


def least_singular_value(matrices: Interval) -> tuple[Array, Array]:
    """Return lower bounds (n,) of the smallest singular value of all matrices (n, m, m) inside the intervals, and the
    sign of their determinants; NaN where a singular one cannot be excluded."""
    with np.errstate(all="ignore"):
        inverses = midpoint_inverses(matrices)
        rest = remainder(inverses, matrices)
        # |J^-1| <= |C| / (1 - |I - C J|)
        spread = upper_norm(rest.magnitude)
        bound = np.nextafter(1.0 - spread, -np.inf) / upper_norm(inverses) / GROWN
        sign = np.sign(np.linalg.det(np.where(np.isfinite(inverses), inverses, 0.0)))
        return np.where(spread < 1.0, bound, np.nan), sign


def along(matrix: Interval, change: Interval) -> Interval:
    """Return matrix (m, k, n) times vector (k, n) -> (m, n); a zero entry gives zero, however wide the vector."""
    total = point(np.zeros((matrix.lo.shape[0], matrix.lo.shape[2])))
    for k in range(matrix.lo.shape[1]):
        entry = Interval(matrix.lo[:, k], matrix.hi[:, k])
        term = multiply(entry, Interval(change.lo[None, k], change.hi[None, k]))
        zero = (entry.lo == 0) & (entry.hi == 0)
        total = add(total, Interval(np.where(zero, 0.0, term.lo), np.where(zero, 0.0, term.hi)))
    return total


def about(lo: Array, hi: Array) -> tuple[Array, Interval]:
    """Return the midpoints of boxes, and enclosures of the way from these to any point."""
    middle = lo + 0.5 * (hi - lo)
    return middle, outward(lo - middle, hi - middle)
