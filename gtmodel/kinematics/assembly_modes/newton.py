"""Newton's method for the seven equations in a patch of projective space, many points at once."""

from __future__ import annotations

import numpy as np

from .study import EQUATIONS, VARIABLES, Array, gradients


def newton_step(C: Array, z: Array, patch: Array) -> Array:
    """The Newton correction (m, 8) of F = C b(z) at z within the patch (m, 8): it leaves patch.z unchanged."""
    J = C @ gradients(z)
    return solve_rows(J, patch, -0.5 * (J @ z[:, :, None])[..., 0])


def solve_rows(J: Array, patch: Array, right: Array) -> Array:
    """Solve [J; patch] dz = [right; 0] for J (m, 7, 8), patch (m, 8), right (m, 7); NaN where it is singular."""
    matrix = np.empty((len(J), VARIABLES, VARIABLES), dtype=complex)
    matrix[:, :EQUATIONS] = J
    matrix[:, EQUATIONS] = patch
    full = np.zeros((len(J), VARIABLES, 1), dtype=complex)
    full[:, :EQUATIONS, 0] = right
    try:
        return np.linalg.solve(matrix, full)[..., 0]
    except np.linalg.LinAlgError:  # one exactly singular matrix spoils the whole batch
        singular = np.linalg.det(matrix) == 0
        matrix[singular] = np.eye(VARIABLES)
        full[singular] = np.nan
        return np.linalg.solve(matrix, full)[..., 0]


def refined(C: Array, z: Array, iterations: int = 6) -> Array:
    """Points z (m, 8) after Newton steps on the system C (7, 18) or (m, 7, 18), scaled to |z| = 1."""
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    C = np.broadcast_to(C, (len(z), *C.shape[-2:]))
    for _ in range(iterations):
        z = z + newton_step(C, z, np.conj(z))
        z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return z
