"""Study coordinates: six leg equations as quadrics in the projective 7-space, linear in 18 fixed basis quadrics.

A point z = (x, y) holds two quaternions, scalar first. With x.x = 1 and x.y = 0, x is the attitude and
T = 2 y x* the position. Leg i with cart joint A, platform joint B, length L and c = A.A + B.B - L^2 closes when

    h_i = c x.x + 4 y.y - 4 A.vec(y x*) + 4 B.vec(x* y) - 2 A'N(x)B = 0,    N(x) = (x.x) R(x),

which is x.x (|T + R B - A|^2 - L^2). So every equation is a combination of the basis quadrics b(z): x.x,
vec(y x*), vec(x* y), the nine entries of N(x), y.y and x.y; their gradients D(z) only copy entries of z with a
sign. A system is a coefficient matrix C (7, 18): F(z) = C b(z), its Jacobian C D(z), and by Euler F = J z / 2.
Source: M. Husty, "An algorithm for solving the direct kinematics of general Stewart-Gough platforms",
Mechanism and Machine Theory 31 (1996), in the quaternion form of Wampler, same journal and volume.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # of float or complex numbers

VARIABLES = 8
EQUATIONS = 7  # six legs and x.y = 0; a patch makes the eighth
BASIS = 18
MODES = 40  # of a general platform, counted over the complex numbers


def _basis_rows() -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Of each gradient D(z)[k, i] = sign[k, i] * z[index[k, i]]: index and sign, both (18, 8)."""
    index = np.zeros((BASIS, VARIABLES), dtype=np.intp)
    sign = np.zeros((BASIS, VARIABLES))

    def product(k: int, i: int, j: int, factor: float) -> None:
        """Add factor z_i z_j to quadric k; no variable stands in two products of one quadric."""
        index[k, i], index[k, j] = j, i
        sign[k, i] = sign[k, j] = 2 * factor if i == j else factor

    for i in range(4):
        product(0, i, i, 1)
        product(16, 4 + i, 4 + i, 1)
        product(17, i, 4 + i, 1)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for k, turn in ((1 + a, 1.0), (4 + a, -1.0)):  # vec(y x*) and vec(x* y) differ in the cross product
            product(k, 5 + a, 0, 1)
            product(k, 4, 1 + a, -1)
            product(k, 5 + b, 1 + c, -turn)
            product(k, 5 + c, 1 + b, turn)
        for i in range(4):
            product(7 + 4 * a, i, i, 1 if i in (0, 1 + a) else -1)
        product(7 + 3 * a + b, 1 + a, 1 + b, 2)
        product(7 + 3 * a + b, 0, 1 + c, -2)
        product(7 + 3 * b + a, 1 + a, 1 + b, 2)
        product(7 + 3 * b + a, 0, 1 + c, 2)
    return index, sign


_INDEX, _SIGN = _basis_rows()


def gradients(z: Array) -> Array:
    """D(z), the gradients of the 18 basis quadrics at z (..., 8); shape (..., 18, 8)."""
    return _SIGN * z[..., _INDEX]


def basis(z: Array) -> Array:
    """b(z), the values of the 18 basis quadrics at z (..., 8); shape (..., 18)."""
    return 0.5 * (gradients(z) @ z[..., None])[..., 0]


def leg_rows(A: Array, B: Array, c: Array) -> Array:
    """Coefficients (..., 6, 18) of the leg equations for A, B (..., 6, 3) and c = A.A + B.B - L^2 (..., 6)."""
    rows = np.zeros((*c.shape, BASIS), dtype=np.result_type(A, B, c))
    rows[..., 0] = c
    rows[..., 1:4] = -4 * A
    rows[..., 4:7] = 4 * B
    rows[..., 7:16] = -2 * (A[..., :, None] * B[..., None, :]).reshape(*c.shape, 9)
    rows[..., 16] = 4
    return rows


def closed_system(rows: Array) -> Array:
    """The seven equations C (..., 7, 18) of leg rows (..., 6, 18): leg 1, the others less leg 1, and x.y.

    The difference removes the common y.y, which scales the equations better.
    """
    system = np.zeros((*rows.shape[:-2], EQUATIONS, BASIS), dtype=rows.dtype)
    system[..., 0, :] = rows[..., 0, :]
    system[..., 1:6, :] = rows[..., 1:, :] - rows[..., :1, :]
    system[..., 6, 17] = 1
    return system


def rotation_and_position(z: Array) -> tuple[Array, Array]:
    """R (..., 3, 3) and T (..., 3) of points z (..., 8); z may have any scale, but x.x must not be zero."""
    b = basis(z)
    n = b[..., 0, None]
    return (b[..., 7:16] / n).reshape(*b.shape[:-1], 3, 3), 2 * b[..., 1:4] / n
