"""Compare sets of modes, and roads to a mode that share nothing with the package."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation


def pair_up(R: np.ndarray, T: np.ndarray, R_other: np.ndarray, T_other: np.ndarray) -> float:
    """Largest difference, in entries of R and T, between two sets of as many modes matched one to one.

    Raises AssertionError when the sets are of different size or two modes have the same partner.
    """
    assert len(T) == len(T_other)
    gap = np.maximum(
        np.abs(R[:, None] - R_other[None]).max(axis=(2, 3)), np.abs(T[:, None] - T_other[None]).max(axis=2)
    )
    partner = gap.argmin(axis=1)
    assert len(set(partner.tolist())) == len(T)
    return float(gap.min(axis=1).max())


def leg_lengths(A: np.ndarray, B: np.ndarray, R: np.ndarray, T: np.ndarray) -> np.ndarray:
    """|T + R B_i - A_i| for one pose, (6,)."""
    return np.linalg.norm(T + B @ R.T - A, axis=1)


def newton_forward(
    A: np.ndarray, B: np.ndarray, L: np.ndarray, R: np.ndarray, T: np.ndarray, steps: int = 8
) -> tuple[np.ndarray, np.ndarray]:
    """Forward kinematics by Newton on T and a unit quaternion, seven equations, from the start R, T."""
    q = np.roll(Rotation.from_matrix(R).as_quat(), 1)
    T = T.copy()
    for _ in range(steps):
        attitude = Rotation.from_quat(np.roll(q, -1)).as_matrix()
        d = T + B @ attitude.T - A
        F = np.append(np.sum(d * d, axis=1) - L**2, q @ q - 1)
        # dR/dq of the unit quaternion's rotation, by turning q in its tangent space
        J = np.zeros((7, 7))
        J[:6, :3] = 2 * d
        w, x, y, z = q
        E = 2 * np.array([[-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])  # omega = E dq
        J[:6, 3:] = 2 * np.cross(B @ attitude.T, d) @ E
        J[6, 3:] = 2 * q
        step = np.linalg.solve(J, -F)
        T = T + step[:3]
        q = q + step[3:]
        q = q / np.linalg.norm(q)
    return Rotation.from_quat(np.roll(q, -1)).as_matrix(), T
