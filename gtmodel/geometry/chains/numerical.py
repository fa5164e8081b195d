"""Inverse kinematics by iteration: Levenberg-Marquardt steps with a gain test, from many deterministic starts."""

from __future__ import annotations

import numpy as np

from ..quaternions import logarithm, quaternion_of
from .chain import Chain

ITERATIONS = 80
LEAST = 1e-13  # damping at the solution, against a singular matrix
SOLVED = 1e-9  # relative length and angle of the remaining pose error
DAMPING = 1e-2  # of the first step, relative to the squared size of the Jacobian


def pose_error(chain: Chain, T: np.ndarray, R: np.ndarray | None, q: np.ndarray) -> np.ndarray:
    """Return (m, 6) or without R (m, 3): position relative to the chain's size, and rotation vector, in the base."""
    at, turned = chain.pose(q)
    off = (T - at) / chain.size
    if R is None:
        return off
    return np.hstack([off, logarithm(quaternion_of(R @ turned.transpose(0, 2, 1)))])


def jacobian(chain: Chain, q: np.ndarray, oriented: bool) -> np.ndarray:
    """Return the Jacobian of `pose_error`'s quantities, with prismatic joints relative to the chain's size too."""
    J = chain.jacobian(q)
    J[:, :3] /= chain.size
    J[:, :, ~np.array(chain.revolute)] *= chain.size
    return J if oriented else J[:, :3]


def polished(
    chain: Chain, T: np.ndarray, R: np.ndarray | None, q: np.ndarray, iterations: int = ITERATIONS
) -> tuple[np.ndarray, np.ndarray]:
    """Return joint coordinates (m, n) after damped steps, and the largest entry (m,) of their pose error."""
    q = np.array(q, float)
    if not len(q):
        return q, np.zeros(0)
    scale = np.where(chain.revolute, 1.0, chain.size)
    error = pose_error(chain, T, R, q)
    cost, damping = (error**2).sum(axis=1), np.full(len(q), DAMPING)
    settled = np.zeros(len(q), int)
    for _ in range(iterations):
        open_ = np.flatnonzero((settled < 2) & (damping < 1e8))
        if not len(open_):
            break
        J = jacobian(chain, q[open_], R is not None)
        JT = J.transpose(0, 2, 1)
        # damping in proportion to the error: quadratic convergence at the end
        weight = (damping[open_] * np.minimum(cost[open_], 1.0) + LEAST)[:, None, None]
        off = error[open_][:, :, None]
        if J.shape[2] > J.shape[1]:
            step = (JT @ np.linalg.solve(J @ JT + weight * np.eye(J.shape[1]), off))[:, :, 0]
        else:
            step = np.linalg.solve(JT @ J + weight * np.eye(J.shape[2]), JT @ off)[:, :, 0]
        largest = np.abs(step).max(axis=1, keepdims=True)
        step = step / np.maximum(1.0, largest)
        trial = q[open_] + step * scale
        of = R if R is None else R[open_]
        new = pose_error(chain, T[open_], of, trial)
        value = (new**2).sum(axis=1)
        better = value < cost[open_]
        rows = open_[better]
        q[rows], error[rows], cost[rows] = trial[better], new[better], value[better]
        damping[open_] = np.where(better, damping[open_] / 5, damping[open_] * 10)
        # two more steps below the limit, or no gain there
        done = cost[open_] < (1e-2 * SOLVED) ** 2
        settled[open_] += done * np.where(better, 1, 2)
    return q, np.abs(error).max(axis=1)


def starts(chain: Chain, count: int, limits: np.ndarray | None = None) -> np.ndarray:
    """Return a fixed low-discrepancy list (count, n) of joint coordinates: multiples of powers of a root, modulo 1.

    The root solves x^(n + 1) = x + 1 (Roberts, The unreasonable effectiveness of quasirandom sequences, 2018).
    """
    n, root = len(chain), 1.5
    for _ in range(60):
        root = (1 + root) ** (1 / (n + 1))
    part = (0.5 + np.arange(1, count + 1)[:, None] * root ** -np.arange(1.0, n + 1)) % 1
    low, high = bounds(chain, limits).T
    return low + part * (high - low)


def bounds(chain: Chain, limits: np.ndarray | None) -> np.ndarray:
    """Return finite limits (n, 2): at most a turn about the middle, or the chain's size."""
    reach = np.where(chain.revolute, np.pi, chain.size)
    low, high = (-reach, reach) if limits is None else (np.maximum(limits[:, 0], -1e3), np.minimum(limits[:, 1], 1e3))
    middle, half = (low + high) / 2, np.minimum((high - low) / 2, reach)
    middle = np.where(np.isfinite(middle), middle, 0.0)
    return np.column_stack([middle - half, middle + half])


def nearest_starts(
    chain: Chain, T: np.ndarray, R: np.ndarray | None, count: int, limits: np.ndarray | None = None, stored: int = 2000
) -> np.ndarray:
    """Return for each pose (m) the joint coordinates (m, count, n) of the stored poses that are nearest to it."""
    table = starts(chain, stored, limits)
    at, turned = chain.pose(table)
    distance = ((T[:, None] / chain.size - at / chain.size) ** 2).sum(axis=2)
    if R is not None:
        distance = distance + (6 - 2 * np.einsum("mij,nij->mn", R, turned)) / 2
    return table[np.argsort(distance, axis=1, kind="stable")[:, :count]]
