"""gt_newton.h in NumPy, step by step in the same order: what C must equal bit for bit. Rows are independent."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..results.status import Status

# as in gt_newton.h
STEPS = 4
REACH = 0.5
CONTRACTION = 0.25
NEARLY = 0.999  # of the largest candidate: the first such is the pivot of `pivot_order`, whatever the round-off

Kernel = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def newton(
    kernel: Kernel, z: np.ndarray, nominal: np.ndarray, largest: np.ndarray, least: float, round_off: float
) -> tuple[np.ndarray, np.ndarray]:
    """Solutions (rows, n) and statuses (rows,) from the starts z.

    kernel: (z of some rows, their numbers) -> residuals (m, n), Jacobians (m, n, n); the rest as in gt_newton.h. All
    is done in the precision of z.
    """
    z, rows = z.copy(), np.arange(len(z))
    status = np.full(len(z), Status.OK, dtype=int)
    most = np.full(len(z), REACH, z.dtype)
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            r, jacobian = kernel(z[rows], rows)
            _, step, _, regular = eliminate(jacobian, r, least)
            rows, step = _keep(status, rows, regular, Status.SINGULAR, step)
            size = np.max(np.abs(step) * nominal, axis=1, initial=0.0)  # NaN where any part is
            rows, step, size = _keep(status, rows, size <= most[rows], Status.NOT_CONVERGED, step, size)
            z[rows] -= step
            most[rows] = np.maximum(CONTRACTION * size, z.dtype.type(round_off))
        r, _ = kernel(z[rows], rows)
        small = np.all(np.abs(r) * largest <= 1.0, axis=1)
        _keep(status, rows, small, Status.NOT_CONVERGED)
    return z, status


def eliminate(
    jacobian: np.ndarray, r: np.ndarray, least: float, skipping: bool = True
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """LU with partial pivoting of many systems J x = r, overwritten: factors (m, n, n), x (m, n), smallest pivots
    (m,), and whether every pivot is above `least` (m,). A row of the matrix with a factor of zero stays as it is, and
    with `skipping` its right-hand side too: beside infinite numbers that is not the same."""
    m, n = r.shape
    every = np.arange(m)
    smallest = np.full(m, np.finfo(r.dtype).max)
    regular = np.ones(m, dtype=bool)
    with np.errstate(all="ignore"):
        for k in range(n):
            size = np.abs(jacobian[:, k:, k])
            best, row = size[:, 0].copy(), np.full(m, k)
            for i in range(1, n - k):  # the first of equal candidates; NaN is never greater
                greater = size[:, i] > best
                best[greater], row[greater] = size[greater, i], k + i
            regular &= best > least
            smallest = np.where(best < smallest, best, smallest)
            for a in (jacobian, r):
                upper, lower = a[every, k].copy(), a[every, row].copy()
                a[every, k], a[every, row] = lower, upper
            factors = jacobian[:, k + 1 :, k] * (1.0 / jacobian[:, k, k])[:, None]
            jacobian[:, k + 1 :, k] = factors
            zero = factors == 0.0
            reduced = r[:, k + 1 :] - factors * r[:, k : k + 1]
            r[:, k + 1 :] = np.where(zero & skipping, r[:, k + 1 :], reduced)
            rest = jacobian[:, k + 1 :, k + 1 :]
            changed = rest - factors[:, :, None] * jacobian[:, k : k + 1, k + 1 :]
            rest[...] = np.where(zero[:, :, None], rest, changed)
        for k in range(n - 1, -1, -1):
            for j in range(n - 1, k, -1):
                r[:, k] -= jacobian[:, k, j] * r[:, j]
            r[:, k] /= jacobian[:, k, k]
    return jacobian, r, smallest, regular


def pivot_order(matrix: np.ndarray) -> list[int]:
    """The rows in the order in which partial pivoting takes them, so that those near it are seldom exchanged."""
    rest, order = np.array(matrix), list(range(len(matrix)))
    for k in range(len(order)):
        size = np.abs(rest[k:, k])
        row = k + int(np.argmax(size >= NEARLY * np.max(size)))
        order[k], order[row] = order[row], order[k]
        rest[[k, row]] = rest[[row, k]]
        with np.errstate(all="ignore"):
            rest[k + 1 :, k:] -= np.outer(rest[k + 1 :, k] / rest[k, k], rest[k, k:])
    return order


def _keep(
    status: np.ndarray, rows: np.ndarray, good: np.ndarray, otherwise: Status, *arrays: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Rows that go on, with their part of the arrays; the others get their status."""
    status[rows[~good]] = otherwise
    return (rows[good], *[a[good] for a in arrays])
