"""Rotation matrices of the language; each takes frame coordinates to the coordinates the frame is given in."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import lang as gt


def rotation_about(axis: Any, angle: Any) -> Any:
    """Rodrigues' formula, (3, 3): rotation by `angle` [rad] about `axis` (3,), which must have length 1."""
    rows = gt.vector if isinstance(axis, gt.Expr) else np.array
    n = axis
    dyad = rows([n[i] * n for i in range(3)])
    cross = rows([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    return gt.cos(angle) * (np.eye(3) - dyad) + gt.sin(angle) * cross + dyad


def quaternion_matrix(e: Any) -> Any:
    """Rotation (3, 3) of a quaternion e (4,), scalar first; times |e|^2 if e is not of length 1."""
    a, b, c, d = e
    rows = gt.vector if any(isinstance(x, gt.Expr) for x in (a, b, c, d)) else np.array
    return rows(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
        ]
    )


def quaternion_velocity(e: Any) -> Any:
    """Angular velocity (3,) [rad/s] in outer coordinates, 2 vec(e' e*); times |e|^2 if e is not of length 1."""
    rate = gt.der(e)
    return 2 * (e[0] * rate[1:] - rate[0] * e[1:] + gt.cross(e[1:], rate[1:]))
