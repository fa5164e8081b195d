"""Does a singular solution lie on a curve of solutions, or stand alone?

At a singular point the equations leave a tangent direction free. A step along it is corrected back onto the
equations; if it gets there and has moved, the platform can move with all its legs fixed: a self-motion. At an
isolated multiple mode the correction fails or returns.
"""

from __future__ import annotations

import numpy as np

from .study import EQUATIONS, VARIABLES, Array, gradients

SINGULAR = 1e-5  # smallest singular value over the largest at a point known to about 1e-6
STEP = 1e-2  # along the tangent, |z| = 1
ITERATIONS = 12  # from there back onto the equations
PROJECTIONS = 4  # of a singular endpoint onto the equations
ON_THE_EQUATIONS = 1e-13  # of |F| with |z| = 1


def on_a_curve(C: Array, z: Array) -> bool:
    """True when solutions of the system C (7, 18) go on from the singular point z (8,), |z| = 1, as a curve."""
    z = onto_equations(C[None], z[None])[0]
    values, directions = _tangent(C, z)
    if values[-1] > SINGULAR * values[0] or _residual(C, z) > ON_THE_EQUATIONS:
        return False
    tangent = np.conj(directions[-1])
    for sign in (1, -1, 1j, -1j):
        w = z + sign * STEP * tangent
        for _ in range(ITERATIONS):  # in the plane across the tangent
            J = C @ gradients(w)
            rows = np.vstack([J, np.conj(z), np.conj(tangent)])
            right = np.concatenate([-0.5 * J @ w, [0, 0]])
            w = w + np.linalg.lstsq(rows, right, rcond=1e-12)[0]
        if _residual(C, w / np.linalg.norm(w)) > ON_THE_EQUATIONS:
            return False
    return True


def onto_equations(C: Array, z: Array) -> Array:
    """Points z (m, 8) moved onto the systems C (m, 7, 18) by Gauss-Newton steps of least norm; |z| = 1.

    A direction that the equations hardly determine is left alone, so that a point does not run along a curve.
    """
    for _ in range(PROJECTIONS):
        J = C @ gradients(z)
        F = 0.5 * (J @ z[:, :, None])
        z = z - (np.linalg.pinv(J, rcond=SINGULAR) @ F)[..., 0]
        z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return z


def _tangent(C: Array, z: Array) -> tuple[Array, Array]:
    """Singular values and right vectors (conjugated rows) of [J; z*]."""
    matrix = np.empty((VARIABLES, VARIABLES), dtype=complex)
    matrix[:EQUATIONS] = C @ gradients(z)
    matrix[EQUATIONS] = np.conj(z)
    _, values, directions = np.linalg.svd(matrix)
    return values, directions


def _residual(C: Array, z: Array) -> float:
    return float(np.max(np.abs(0.5 * C @ (gradients(z) @ z))))
