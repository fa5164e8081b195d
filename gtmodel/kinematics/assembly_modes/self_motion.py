"""Does a singular solution lie on a curve of solutions, or stand alone?

At a singular point the equations leave a tangent direction free. A step along it is corrected back onto the
equations; if it gets there and has moved, the platform can move with all its legs fixed: a self-motion. At an
isolated multiple mode the correction fails or returns.
"""

from __future__ import annotations

import numpy as np

from .study import EQUATIONS, VARIABLES, Array, gradients

SINGULAR = 1e-10  # smallest singular value over the largest on a curve
WEAK = 1e-5  # the same at an endpoint near a curve, which is known to about 1e-6
FINITE = 1e-6  # |x.x| / |z|^2 below it: a curve at infinity, along which no platform moves
STEP = 0.03  # along the tangent, |z| = 1; at an isolated mode of multiplicity m its power m remains of the equations
ITERATIONS = 60  # halving, where the solutions on a curve are multiple themselves
ON_THE_EQUATIONS = 1e-12  # of |F| with |z| = 1
PROJECTIONS = 4  # of a singular endpoint onto the equations


def on_a_curve(C: Array, z: Array) -> bool:
    """True when finite solutions of the system C (7, 18) go on from the singular point z (8,), |z| = 1, as a curve."""
    z = _settled(C, z, np.conj(z)[None])
    values, directions = _tangent(C, z)
    finite = abs(np.sum(z[:4] ** 2)) > FINITE
    if not finite or values[-1] > SINGULAR * values[0] or _residual(C, z) > ON_THE_EQUATIONS:
        return False
    tangent = np.conj(directions[-1])
    across = np.stack([np.conj(z), np.conj(tangent)])
    ends = [_settled(C, z + sign * STEP * tangent, across) for sign in (1, -1, 1j, -1j)]
    return all(_residual(C, w) <= ON_THE_EQUATIONS for w in ends)


def _settled(C: Array, z: Array, plane: Array) -> Array:
    """The point z (8,) moved onto the system C, within the plane of rows (k, 8), by Levenberg-Marquardt steps.

    The damping goes down with the residual, after Fan and Yuan, Computing 74 (2005): quick across a curve, too.
    """
    for _ in range(ITERATIONS):
        J = C @ gradients(z)
        F = 0.5 * J @ z
        damping = np.linalg.norm(F) * np.eye(VARIABLES)
        rows = np.vstack([J, plane, damping])
        z = z + np.linalg.lstsq(rows, np.concatenate([-F, np.zeros(len(plane) + VARIABLES)]))[0]
    return z / np.linalg.norm(z)


def onto_equations(C: Array, z: Array) -> Array:
    """Points z (m, 8) moved onto the systems C (m, 7, 18) by Gauss-Newton steps of least norm; |z| = 1.

    A direction that the equations hardly determine is left alone, so that a point does not run along a curve.
    """
    for _ in range(PROJECTIONS):
        J = C @ gradients(z)
        F = 0.5 * (J @ z[:, :, None])
        z = z - (np.linalg.pinv(J, rcond=WEAK) @ F)[..., 0]
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
