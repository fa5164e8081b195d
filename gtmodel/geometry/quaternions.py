"""Quaternions, scalar first: products, conversion to matrices and rotation vectors, small rotations."""

from __future__ import annotations

from math import isfinite
from typing import Any, Literal

import numpy as np

from .entries import entries, is_column, matrix, vector

# below this square of an angle [rad2] sine and arc tangent use their series: the next term is 1e-16 of the first
SMALL_SQUARE = 1e-8
# below this cosine of half the angle the sign of a rotation is round-off
HALF_TURN = 1e-15


def product(p: Any, q: Any) -> Any:
    """Return the Hamilton product p q of quaternions (..., 4): first the rotation q, then p, in outer coordinates."""
    (a, b, c, d), (e, f, g, h) = entries(p), entries(q)
    return vector(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ]
    )


def conjugate(q: Any) -> Any:
    """Return the inverse of a unit quaternion (..., 4)."""
    a, b, c, d = entries(q)
    return vector([a, -b, -c, -d])


def quaternion_matrix(q: Any) -> Any:
    """Return the rotation matrix (..., 3, 3) of a quaternion (..., 4); times |q|^2 if |q| is not 1."""
    if isinstance(q, np.ndarray) and q.ndim > 1:
        return _matrix_of_rows(q)
    e = entries(q)

    def p(i: int, k: int) -> Any:
        return e[i] * e[k]

    return matrix(
        [
            [p(0, 0) + p(1, 1) - p(2, 2) - p(3, 3), 2 * (p(1, 2) - p(0, 3)), 2 * (p(1, 3) + p(0, 2))],
            [2 * (p(1, 2) + p(0, 3)), p(0, 0) - p(1, 1) + p(2, 2) - p(3, 3), 2 * (p(2, 3) - p(0, 1))],
            [2 * (p(1, 3) - p(0, 2)), 2 * (p(2, 3) + p(0, 1)), p(0, 0) - p(1, 1) - p(2, 2) + p(3, 3)],
        ]
    )


def _matrix_of_rows(q: np.ndarray) -> np.ndarray:
    """Rotation matrices of rows (..., 4), computing each product once and with little memory."""
    w, *u = entries(q)
    R = np.empty((*w.shape, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        R[..., i, i] = w * w + u[i] * u[i] - u[j] * u[j] - u[k] * u[k]
        symmetric, skew = 2 * u[i] * u[j], 2 * w * u[k]
        np.subtract(symmetric, skew, out=R[..., i, j])
        np.add(symmetric, skew, out=R[..., j, i])
    return R


def quaternion_of(R: np.ndarray, positive: Literal["scalar", "largest"] = "scalar") -> np.ndarray:
    """Return unit quaternions (..., 4) of rotations (..., 3, 3), with all entries exact to round-off at any angle.

    positive: the entry with positive sign, either the scalar or the entry with the largest absolute value. For half
    turns the scalar is zero; with "scalar" the first nonzero entry of the vector is then positive. Rows that are not
    finite become NaN.
    """
    R = np.asarray(R, float)
    q = _nearest(R.reshape(3, 3))[None] if R.size == 9 else _of_rows(R.reshape(-1, 3, 3))
    rows = np.arange(len(q))
    if positive == "largest":
        first = q[rows, np.abs(q).argmax(axis=1)]
    else:
        first = q[:, 0]
        half = np.abs(first) < HALF_TURN
        if half.any():
            first = np.where(half, q[rows, 1 + np.argmax(np.abs(q[:, 1:]) > HALF_TURN, axis=1)], first)
            q[half, 0] = 0.0
    return (q * np.copysign(1.0, first)[:, None]).reshape(*R.shape[:-2], 4)


def _nearest(R: np.ndarray) -> np.ndarray:
    """Quaternion of the rotation nearest to one matrix, from an eigenvector (Bar-Itzhack 2000)."""
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    if not isfinite(a + b + c + d + e + f + g + h + i):
        return np.full(4, np.nan)
    K = np.array(
        [a + e + i, h - f, c - g, d - b,
         0.0, a - e - i, b + d, c + g,
         0.0, 0.0, e - a - i, f + h,
         0.0, 0.0, 0.0, i - a - e]
    ).reshape(4, 4)  # fmt: skip
    return np.linalg.eigh(K, UPLO="U")[1][:, -1]


def _of_rows(R: np.ndarray) -> np.ndarray:
    """Quaternions of rotations (n, 3, 3) from their largest entry; three times faster than `_nearest` for many rows."""
    diagonal = R[:, 0, 0], R[:, 1, 1], R[:, 2, 2]
    trace = diagonal[0] + diagonal[1] + diagonal[2]
    Q = np.empty((len(R), 4, 4))  # row i: four times the quaternion times its entry i
    Q[:, 0, 0] = 1 + trace
    for k, (i, j) in enumerate(((2, 1), (0, 2), (1, 0)), 1):
        Q[:, k, k] = 1 - trace + 2 * diagonal[k - 1]
        Q[:, 0, k] = Q[:, k, 0] = R[:, i, j] - R[:, j, i]
        Q[:, i + 1, j + 1] = Q[:, j + 1, i + 1] = R[:, i, j] + R[:, j, i]
    q = Q[np.arange(len(Q)), np.argmax(np.einsum("nkk->nk", Q), axis=1)]
    with np.errstate(invalid="ignore", divide="ignore"):
        return q / np.sqrt(np.sum(q * q, axis=1, keepdims=True))


def zyz_quaternion(alpha: float, beta: float, gamma: float) -> np.ndarray:
    """Return the unit quaternion, scalar first, of rotations about z, the new y and the new z [rad]."""
    half_sum, half_difference = (alpha + gamma) / 2, (alpha - gamma) / 2
    c, s = np.cos(beta / 2), np.sin(beta / 2)
    return np.array(
        [c * np.cos(half_sum), -s * np.sin(half_difference), s * np.cos(half_difference), c * np.sin(half_sum)]
    )


def rpy_quaternion(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the unit quaternion, scalar first, of rotations about fixed x, then y, then z [rad]."""
    (a, b), (c, d), (e, g) = ((np.cos(v / 2), np.sin(v / 2)) for v in (roll, pitch, yaw))
    return np.array([a * c * e + b * d * g, b * c * e - a * d * g, a * d * e + b * c * g, a * c * g - b * d * e])


def exponential(v: Any) -> Any:
    """Return the unit quaternion (..., 4) of a rotation vector (..., 3) [rad]; for symbols it is smooth at zero."""
    if not is_column(v):
        import scipy

        return scipy.spatial.transform.Rotation.from_rotvec(np.asarray(v, float)).as_quat(scalar_first=True)
    import casadi as ca

    square = ca.dot(v, v) / 4
    small, safe = guarded(square)
    half = ca.sqrt(safe)
    scalar = ca.if_else(small, 1 - square / 2, ca.cos(half))
    factor = ca.if_else(small, 1 - square / 6, ca.sin(half) / half) / 2
    return ca.vertcat(scalar, factor * v)


def logarithm(q: Any) -> Any:
    """Return the rotation vector (..., 3) [rad], at most half a turn, of a unit quaternion (..., 4) of either sign."""
    if is_column(q):
        import casadi as ca

        sign = ca.if_else(q[0] < 0, -1.0, 1.0)
        scalar, v = sign * q[0], sign * q[1:4]
        square = ca.dot(v, v)
        small, safe = guarded(square)
        sine = ca.sqrt(safe)
        whole = ca.if_else(small, scalar, 1.0)
        near = (2 - 2 * square / (3 * whole * whole)) / whole
        return ca.if_else(small, near, 2 * ca.atan2(sine, scalar) / sine) * v
    q = q * np.where(q[..., :1] < 0, -1.0, 1.0)
    sine = np.sqrt(np.einsum("...k,...k->...", q[..., 1:], q[..., 1:]))[..., None]
    return 2 * np.arctan2(sine, q[..., :1]) / (sine + (sine == 0)) * q[..., 1:]


def guarded(square: Any) -> tuple[Any, Any]:
    """Return whether the square of a symbolic angle is small, and the square, or 1 if small, for a safe square root."""
    import casadi as ca

    small = square < SMALL_SQUARE
    return small, ca.if_else(small, 1.0, square)


def angle_between(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the angle [rad] between orientations given by quaternions (..., 4) of any nonzero length; accurate also
    near zero."""
    p, q = (x / np.linalg.norm(x, axis=-1, keepdims=True) for x in (p, q))
    nearer = np.minimum(np.linalg.norm(p - q, axis=-1), np.linalg.norm(p + q, axis=-1))
    return 4 * np.arcsin(np.minimum(nearer / 2, 1.0))


def small_turn(q: Any, half: Any) -> Any:
    """Return q (1, half): q rotated by a small rotation vector, 2 `half` (..., 3) [rad], in its own frame; its length
    exceeds that of q to second order."""
    (a, b, c, d), (x, y, z) = entries(q), entries(half)
    return vector(
        [
            a - (b * x + c * y + d * z),
            a * x + b + (c * z - d * y),
            a * y + c + (d * x - b * z),
            a * z + d + (b * y - c * x),
        ]
    )


def turned(q: Any, turn: Any) -> Any:
    """Return a unit quaternion rotated by a small rotation vector (..., 3) [rad] in its own frame: q (1, turn / 2) over
    its length, smooth up to half a turn."""
    half = turn / 2
    p = small_turn(q, half)
    if isinstance(p, np.ndarray):
        return p / np.linalg.norm(p, axis=-1, keepdims=True)
    import casadi as ca

    return p / ca.sqrt(1 + ca.dot(half, half))


def turn_matrix(q: Any) -> Any:
    """Return (..., 4, 3), from a small rotation [rad] in its own frame to the change of a quaternion (..., 4); 4 times
    the transpose is the inverse map."""
    a, b, c, d = entries(q)
    return matrix([[-b, -c, -d], [a, -d, c], [d, a, -b], [-c, b, a]]) / 2
