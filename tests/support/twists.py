"""Mobility by hand: a twist for each body, rows for each joint, rank by singular values. Uses nothing of gtmodel."""

from __future__ import annotations

import numpy as np

GROUND = 0


def across(n):
    n = np.asarray(n, float) / np.linalg.norm(n)
    first = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    first /= np.linalg.norm(first)
    return n, first, np.cross(n, first)


def rows(kind, point, *axes):
    """Rows (k, 6) on the relative twist (velocity at the world's origin, angular velocity) of a joint at a point."""
    x, y, z = point
    velocity = np.hstack([np.eye(3), -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])])  # v + w x p = v - p x w
    turning = np.hstack([np.zeros((3, 3)), np.eye(3)])
    if kind == "S":
        return velocity
    if kind == "U":
        return np.vstack([velocity, np.cross(*axes) @ turning])
    n, first, second = across(axes[0])
    e = np.array([first, second])
    return {
        "R": lambda: np.vstack([velocity, e @ turning]),
        "C": lambda: np.vstack([e @ velocity, e @ turning]),
        "P": lambda: np.vstack([e @ velocity, turning]),
        "E": lambda: np.vstack([n @ velocity, e @ turning]),
    }[kind]()


def counted(joints):
    """Return (equations, rank, freedoms, redundant) of joints (body, body, kind, point, axes...); body 0 is fixed."""
    bodies = max(max(i, j) for i, j, *_ in joints)
    blocks = []
    for i, j, kind, point, *axes in joints:
        part = rows(kind, point, *axes)
        block = np.zeros((len(part), 6 * (bodies + 1)))
        block[:, 6 * j : 6 * j + 6] += part
        block[:, 6 * i : 6 * i + 6] -= part
        blocks.append(block[:, 6:])
    matrix = np.vstack(blocks)
    rank = int(np.sum(np.linalg.svd(matrix, compute_uv=False) > 1e-9))
    return len(matrix), rank, 6 * bodies - rank, len(matrix) - rank
