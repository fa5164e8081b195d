"""Inverse kinematics by iteration: Levenberg-Marquardt steps with a gain test, from many deterministic starts."""

from __future__ import annotations

import numpy as np

from ..quaternions import logarithm, quaternion_of
from .chain import Chain

ITERATIONS = 80
LEAST = 1e-13  # damping at the solution, against a singular matrix
SOLVED = 1e-9  # relative length and angle of the remaining pose error
TURNING, SHORT = 30.0, 24  # weight of the rotation, and starts, for poses out of reach
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
    chain: Chain, T: np.ndarray, R: np.ndarray | None, q: np.ndarray, iterations: int = ITERATIONS, *,
    turning: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return joint coordinates (m, n) after damped steps, and the largest entry (m,) of their pose error.

    turning: weight of the rotation against the position, for poses that are out of reach.
    """
    q = np.array(q, float)
    if not len(q):
        return q, np.zeros(0)
    scale = np.where(chain.revolute, 1.0, chain.size)
    weights = np.array([1.0] * 3 + [turning] * (0 if R is None else 3))
    error = weights * pose_error(chain, T, R, q)
    cost, damping = (error**2).sum(axis=1), np.full(len(q), DAMPING)
    settled = np.zeros(len(q), int)
    for _ in range(iterations):
        open_ = np.flatnonzero((settled < 2) & (damping < 1e8))
        if not len(open_):
            break
        J = weights[:, None] * jacobian(chain, q[open_], R is not None)
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
        new = weights * pose_error(chain, T[open_], of, trial)
        value = (new**2).sum(axis=1)
        better = value < cost[open_]
        rows = open_[better]
        q[rows], error[rows], cost[rows] = trial[better], new[better], value[better]
        damping[open_] = np.where(better, damping[open_] / 5, damping[open_] * 10)
        # two more steps below the limit, or no gain there
        done = cost[open_] < (1e-2 * SOLVED) ** 2
        settled[open_] += done * np.where(better, 1, 2)
    return q, np.abs(error).max(axis=1)


def shortfall(chain: Chain, T: np.ndarray, R: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return how far (m,) [m] each position is from the nearest one that the chain reaches with the same orientation,
    and by what angle (m,) [rad] that orientation is missed if the chain does not have it.

    The nearest of the local minima from `SHORT` stored poses, a quarter of them with the position alone in mind.
    """
    first = nearest_starts(chain, T, R, SHORT)
    if R is not None:
        first = np.concatenate([first[:, : -SHORT // 4], nearest_starts(chain, T, None, SHORT // 4)], axis=1)
    m, k, n = first.shape
    of, at = None if R is None else np.repeat(R, k, axis=0), np.repeat(T, k, axis=0)
    q, _ = polished(chain, at, of, first.reshape(-1, n), turning=TURNING)
    off = pose_error(chain, at, of, q)
    distance, angle = np.linalg.norm(off[:, :3], axis=1), np.linalg.norm(off[:, 3:], axis=1)
    best = np.argmin((distance + TURNING * angle).reshape(m, k), axis=1)
    rows = np.arange(m), best
    return chain.size * distance.reshape(m, k)[rows], angle.reshape(m, k)[rows]


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
    """Return finite limits (n, 2): at most a turn about the middle, or twice the chain's size; from the limit inwards
    if there is one only."""
    reach = np.where(chain.revolute, np.pi, chain.size)
    if limits is None:
        return np.column_stack([-reach, reach])
    low, high = limits.T
    least, most = np.isfinite(low), np.isfinite(high)
    middle = np.where(least & most, (np.where(least, low, 0.0) + np.where(most, high, 0.0)) / 2, 0.0)
    middle = np.where(least & ~most, low + reach, np.where(most & ~least, high - reach, middle))
    half = np.where(least & most, np.minimum((np.where(most, high, 0.0) - np.where(least, low, 0.0)) / 2, reach), reach)
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
