"""Kinematics and inverse dynamics of the L1 prototype by hand in NumPy, on contiguous columns, with a status.

Eqs. (6.3)-(6.8) of Dressler 2012 with what a careful user knows of this robot: guideways along x, massless links, a
point of a plate. Temporaries are written over where that is easy. Status codes are those of gtmodel: 0, out of reach 1,
singular 2, numbers that are not finite 5.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gtmodel.results.status import Status

from .l1_by_hand import FRICTION_SPEED, GRAVITY, Data

Array = np.ndarray
By = Callable[..., tuple[Array, Array]]
TOLERANCE = 1e-7
BLOCK = 4096


def _root(d: Data, i: int, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Offsets along y and z of link i, and the square of its extent along x."""
    dy, dz = y - d.A[i, 1], z - d.A[i, 2]
    square = d.L[i] ** 2 - dy * dy
    square -= dz * dz
    return dy, dz, square


def _settled(values: Array, status: Array, reached: Array, regular: Array | None, finite: Array) -> None:
    """Status codes, first cause first, and NaN where there is no answer."""
    if regular is not None:
        status[~regular] = Status.SINGULAR
    status[~reached] = Status.OUT_OF_RANGE
    status[~finite] = Status.NOT_FINITE
    values[:, status != 0] = np.nan


def inverse_kinematics(d: Data, T: Array) -> tuple[Array, Array]:
    """T (3, n) -> q (3, n), status (n,)."""
    x, y, z = T
    q, status = np.empty_like(T), np.zeros(len(x), int)
    lowest = np.full(len(x), np.inf)
    for i in range(3):
        _, _, square = _root(d, i, y, z)
        np.minimum(lowest, square, out=lowest)
        np.sqrt(square, out=square)
        square *= d.ahead[i]
        square += d.A[i, 0]
        np.subtract(x, square, out=q[i])
    if not (lowest.min() >= 0 and np.isfinite(q.sum())):
        _settled(q, status, lowest >= 0, None, np.isfinite(T).all(axis=0))
    return q, status


def forward_kinematics(d: Data, q: Array) -> tuple[Array, Array]:
    """q (3, n) -> T (3, n), status (n,): differences of the spheres are linear in y and z, with constant factors."""
    T, status = np.empty_like(q), np.zeros(q.shape[1], int)
    c = [q[i] + d.A[i, 0] for i in range(3)]
    M = np.linalg.inv(2 * (d.A[1:, 1:] - d.A[0, 1:]))
    outside = np.sum(d.A[:, 1:] ** 2, axis=1) - d.L**2
    by_x, right = [], []
    for i in (1, 2):
        by_x.append(-2 * (c[i] - c[0]))
        r = c[i] * c[i]
        r -= c[0] * c[0]
        r += outside[i] - outside[0]
        right.append(r)
    # y = y0 + y1 x and z = z0 + z1 x
    y0, y1 = M[0, 0] * right[0] + M[0, 1] * right[1], M[0, 0] * by_x[0] + M[0, 1] * by_x[1]
    z0, z1 = M[1, 0] * right[0] + M[1, 1] * right[1], M[1, 0] * by_x[0] + M[1, 1] * by_x[1]
    dy, dz = y0 - d.A[0, 1], z0 - d.A[0, 2]
    a = 1 + y1 * y1 + z1 * z1
    b = y1 * dy + z1 * dz - c[0]
    e = c[0] * c[0] + dy * dy + dz * dz - d.L[0] ** 2
    square = b * b - a * e
    x = T[0]
    np.sqrt(square, out=x)
    x *= d.ahead[0]
    x -= b
    x /= a
    np.multiply(y1, x, out=T[1])
    T[1] += y0
    np.multiply(z1, x, out=T[2])
    T[2] += z0
    if not (square.min() >= 0 and np.isfinite(T.sum())):
        _settled(T, status, square >= 0, None, np.isfinite(q).all(axis=0))
    return T, status


def inverse_dynamics(d: Data, T: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """T, its rate and acceleration (3, n) -> tau (3, n), status (n,)."""
    x, y, z = T
    tau, status = np.empty_like(T), np.zeros(len(x), int)
    lowest = np.full(len(x), np.inf)
    by_y, by_z = [], []
    across = v[1] * v[1]
    across += v[2] * v[2]
    for i in range(3):
        dy, dz, square = _root(d, i, y, z)
        np.minimum(lowest, square, out=lowest)
        along = np.sqrt(square, out=square)
        along *= d.ahead[i]
        dy /= along
        dz /= along
        speed = v[0] + dy * v[1]
        speed += dz * v[2]
        square = v[0] - speed
        square *= square
        square += across
        square /= along
        square += a[0]
        square += dy * a[1]
        square += dz * a[2]
        square *= d.m_c[i]
        np.divide(speed, FRICTION_SPEED, out=along)
        np.tanh(along, out=along)
        along *= d.coulomb[i]
        square += along
        speed *= d.viscous[i]
        np.add(square, speed, out=tau[i])
        by_y.append(dy)
        by_z.append(dz)
    # J^T f = m (a + g): its first row is the sum of the forces
    y1, y2, z1, z2 = by_y[1] - by_y[0], by_y[2] - by_y[0], by_z[1] - by_z[0], by_z[2] - by_z[0]
    det = y1 * z2
    det -= y2 * z1
    sum_ = d.m_p * a[0]
    ry = d.m_p * a[1] - by_y[0] * sum_
    rz = d.m_p * (a[2] + GRAVITY) - by_z[0] * sum_
    f1 = ry * z2
    f1 -= y2 * rz
    f1 /= det
    f2 = y1 * rz
    f2 -= ry * z1
    f2 /= det
    tau[1] += f1
    tau[2] += f2
    sum_ -= f1
    sum_ -= f2
    tau[0] += sum_
    np.abs(det, out=det)
    if not (lowest.min() >= 0 and det.min() > TOLERANCE and np.isfinite(tau.sum())):
        finite = np.all([np.isfinite(c).all(axis=0) for c in (T, v, a)], axis=0)
        _settled(tau, status, lowest >= 0, det > TOLERANCE, finite)
    return tau, status


def in_blocks(function: By, d: Data, *columns: Array) -> tuple[Array, Array]:
    """The same, a block after the other: temporaries stay in the cache."""
    n = columns[0].shape[1]
    values, status = np.empty((3, n)), np.empty(n, int)
    for k in range(0, n, BLOCK):
        part = slice(k, k + BLOCK)
        values[:, part], status[part] = function(d, *[np.ascontiguousarray(c[:, part]) for c in columns])
    return values, status
