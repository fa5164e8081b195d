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


def upper_norm(matrices: Array) -> Array:
    """Return upper bounds (n,) of the spectral norm of matrices (n, i, j) with entries of at most these sizes: the
    eighth root of a row sum of (A A')^4, whose round-off is far below 1e-10 of its norm."""
    size = np.maximum(np.abs(matrices).max(axis=(1, 2)), 1e-300)  # the eighth power must not underflow
    scaled = matrices / size[:, None, None]
    square = scaled @ scaled.transpose(0, 2, 1)
    for _ in range(2):
        square = square @ square
    return size * np.abs(square).sum(axis=2).max(axis=1) ** 0.125 * (1.0 + 1e-10)


def remainder(inverses: Array, matrices: Interval) -> Interval:
    """Return I - C J for all J in the intervals."""
    return subtract(point(np.eye(inverses.shape[1])[None]), product(point(inverses), matrices))


def least_singular_value(matrices: Interval, slopes: Interval | None = None, way: Interval | None = None) -> Array:
    """Return lower bounds (n,) of the smallest singular value of all matrices (n, i, j) inside the intervals; NaN where
    one without full rank cannot be excluded. slopes (n, i, j, k), way (k, n): add these changes to the matrices."""
    with np.errstate(all="ignore"):
        if matrices.lo.shape[1] < matrices.lo.shape[2]:  # the transposed matrices have the same singular values
            matrices = Interval(*(x.transpose(0, 2, 1) for x in matrices))
            slopes = None if slopes is None else Interval(*(x.transpose(0, 2, 1, 3) for x in slopes))
        middle = 0.5 * (matrices.lo + matrices.hi)
        n, rows, columns = middle.shape
        inverses = np.full((n, columns, rows), np.nan)
        good = np.isfinite(middle).all(axis=(1, 2))
        inverses[good] = np.linalg.pinv(middle[good])
        # |J^-1| <= |C| / (1 - |I - C J|)
        rest = remainder(inverses, matrices)
        if slopes is not None and way is not None:  # C meets the slopes before their ways are added
            turned = product(point(inverses), Interval(*(x.reshape(n, rows, -1) for x in slopes)))
            turned = Interval(*(x.reshape(n, columns * columns, -1).transpose(1, 2, 0) for x in turned))
            change = along(turned, way)
            rest = subtract(rest, Interval(*(x.T.reshape(n, columns, columns) for x in change)))
        spread = upper_norm(rest.magnitude)
        bound = np.nextafter(1.0 - spread, -np.inf) / upper_norm(inverses) / GROWN
        return np.where(spread < 1.0, bound, np.nan)


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
