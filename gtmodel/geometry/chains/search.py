"""Numerical inverse kinematics of any serial chain from many starts, for many poses at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .chain import Chain

TABLE = 512  # stored joint positions, of which the nearest in pose are starts
NEAREST = 16  # starts from the table for each pose, in order of distance
OTHERS = 48  # starts after these: the first of the table, wherever they are
ITERATIONS = 40  # of one descent
LONGEST = 0.5  # rad, or of the chain's length: the longest step of a joint
REACHED = 1e-9  # relative size of a remaining pose error
HOPELESS = 0.3  # a descent whose error is larger after HALFWAY iterations is left
HALFWAY = 15
DAMPING, LESS, MORE = 1e-2, 0.2, 4.0  # at the start, and factors after a good and a bad step
REGULAR = 0.02  # ratio of singular values of the Jacobian, below which a start is nearly singular
NEIGHBOURHOODS, TRIED = (0.15, 0.3, 0.6, 1.0), 32  # rad, or of half the chain's length; points tried in each
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29)


@dataclass(frozen=True, eq=False)
class Search:
    """Joint coordinates for poses of a chain, by damped least squares from declared starts and from a table.

    `limits` (n, 2) of the coordinates, infinite without one; `starts` (k, n): tried first, in order; `oriented`: the
    rotation is known besides the position. The same pose has the same result, whatever other poses are asked for.
    """

    chain: Chain
    limits: np.ndarray
    starts: np.ndarray
    oriented: bool = True

    def solve(self, T: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return q (m, n) for poses T (m, 3), R (m, 3, 3), NaN where none was found, and whether q is within limits.

        Coordinates within limits are preferred to those found first. R is not used if the chain is not `oriented`.
        """
        m = len(T)
        q, inside = np.full((m, len(self.chain)), np.nan), np.zeros(m, dtype=bool)
        order = np.argsort(self._distances(T, R), axis=1, kind="stable")[:, :NEAREST]
        for k in range(len(self.starts) + NEAREST + OTHERS):
            rows = np.flatnonzero(~inside)
            if not rows.size:
                break
            here = k - len(self.starts)
            if here < 0:
                start = np.tile(self.starts[k], (len(rows), 1))
            elif here < NEAREST:
                start = self._table[order[rows, here]]
            else:
                start = np.tile(self._table[here - NEAREST], (len(rows), 1))
            found, reached = self._descend(start, T[rows], R[rows])
            found = self.without_turns(found)
            better = reached & (np.isnan(q[rows, 0]) | self.within(found))
            q[rows[better]] = found[better]
            inside[rows[better]] = self.within(found[better])
        return q, inside

    def without_turns(self, q: np.ndarray) -> np.ndarray:
        """Return q with the full turns that bring angles nearest to the middle of their limits, or to the start."""
        turns = np.round((q - self._middle) / (2 * np.pi))
        return np.where(self.chain.revolute, q - 2 * np.pi * turns, q)

    def within(self, q: np.ndarray) -> np.ndarray:
        """Return which rows of q (m, n) are within the limits."""
        return np.all((q >= self.limits[:, 0]) & (q <= self.limits[:, 1]), axis=1)

    def regular(self, q: np.ndarray) -> np.ndarray:
        """Return joint coordinates (n,) at which the chain is not nearly singular: q itself, or the best within the
        limits in the smallest neighbourhood of q that has any."""
        if self._conditioning(q[None])[0] >= REGULAR:
            return q
        half = np.where(self.chain.revolute, 1.0, self.chain.size / 2)
        best, most = q, 0.0
        for part in NEIGHBOURHOODS:
            low = np.maximum(self.limits[:, 0], q - part * half)
            high = np.minimum(self.limits[:, 1], q + part * half)
            points = low + _spread(TRIED, len(q)) * (high - low)
            values = self._conditioning(points)
            if np.max(values) > most:
                best, most = points[int(np.argmax(values))], float(np.max(values))
            if most >= REGULAR:
                break
        return best

    def _conditioning(self, q: np.ndarray) -> np.ndarray:
        """Return the ratio of the smallest to the largest singular value of the Jacobian at q (m, n)."""
        rows, unit = 6 if self.oriented else 3, np.where(self.chain.revolute, 1.0, self.chain.size)
        weight = np.concatenate([np.full(3, 1 / self.chain.size), np.ones(3)])[:rows, None]
        s = np.linalg.svd(self.chain.jacobian(q)[:, :rows] * weight * unit, compute_uv=False)
        return s[:, min(rows, len(self.chain)) - 1] / s[:, 0]

    @cached_property
    def _middle(self) -> np.ndarray:
        middle = self.limits.mean(axis=1) if np.isfinite(self.limits).any() else np.full(len(self.chain), np.nan)
        return np.where(np.isfinite(middle), middle, self.starts[0] if len(self.starts) else 0.0)

    @cached_property
    def _table(self) -> np.ndarray:
        """Joint positions of low discrepancy (TABLE, n): within the limits, and within half a turn or a chain's length
        of the middle."""
        n = len(self.chain)
        half = np.where(self.chain.revolute, np.pi, self.chain.size)
        low = np.maximum(self.limits[:, 0], self._middle - half)
        high = np.minimum(self.limits[:, 1], self._middle + half)
        return low + _spread(TABLE, n) * (high - low)

    @cached_property
    def _poses(self) -> tuple[np.ndarray, np.ndarray]:
        return self.chain.pose(self._table)

    def _distances(self, T: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Return squares of distances (m, TABLE) in pose: 1 for the chain's length, or for half a turn."""
        at, turned = self._poses
        off = np.sum((T[:, None] - at) ** 2, axis=2) / self.chain.size**2
        if self.oriented:
            off += np.maximum(3.0 - np.einsum("mij,kij->mk", R, turned), 0.0) / 4.0
        return off

    def _error(self, q: np.ndarray, T: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Return the pose error (m, 3 or 6): position relative to the chain's length, then the rotation vector."""
        at, turned = self.chain.pose(q)
        off = (T - at) / self.chain.size
        if not self.oriented:
            return off
        turn = R @ turned.transpose(0, 2, 1)
        axis = np.array([turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]]).T
        sine = np.linalg.norm(axis, axis=1) / 2
        angle = np.arctan2(sine, (np.trace(turn, axis1=1, axis2=2) - 1) / 2)
        factor = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), np.where(angle > 1.0, np.nan, 1.0))
        return np.hstack([off, axis / 2 * factor[:, None]])

    def _descend(self, q: np.ndarray, T: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Descend from q (m, n); return the ends and whether the pose is reached."""
        n = len(self.chain)
        q = q.copy()
        rows = 6 if self.oriented else 3
        weight = np.concatenate([np.full(3, 1 / self.chain.size), np.ones(3)])[:rows, None]
        unit = np.where(self.chain.revolute, 1.0, self.chain.size)
        e = self._error(q, T, R)
        square = np.sum(e * e, axis=1)
        damping = np.full(len(q), DAMPING)
        open_ = np.isfinite(square) & (square > REACHED**2)
        for iteration in range(ITERATIONS):
            k = np.flatnonzero(open_)
            if not k.size:
                break
            J = self.chain.jacobian(q[k])[:, :rows] * weight * unit
            normal = J.transpose(0, 2, 1) @ J + damping[k, None, None] * np.eye(n)
            step = np.linalg.solve(normal, np.einsum("mij,mi->mj", J, e[k])[:, :, None])[:, :, 0]
            size = np.max(np.abs(step), axis=1, keepdims=True)
            trial = q[k] + step * np.minimum(1.0, LONGEST / np.maximum(size, LONGEST)) * unit
            new = self._error(trial, T[k], R[k])
            total = np.sum(new * new, axis=1)
            good = total < square[k]
            q[k[good]], e[k[good]], square[k[good]] = trial[good], new[good], total[good]
            damping[k] *= np.where(good, LESS, MORE)
            open_[k] = (square[k] > REACHED**2) & (damping[k] < 1e6)
            if iteration == HALFWAY:
                open_ &= square < HOPELESS**2
        return q, square <= REACHED**2


def _spread(count: int, n: int) -> np.ndarray:
    """Return points of low discrepancy (count, n) in the unit cube (Halton 1960)."""
    return np.array([[_radical_inverse(k, PRIMES[j % len(PRIMES)]) for j in range(n)] for k in range(1, count + 1)])


def _radical_inverse(k: int, base: int) -> float:
    """Return the k-th number of the van der Corput sequence."""
    value, part = 0.0, 1.0
    while k:
        part /= base
        value += part * (k % base)
        k //= base
    return value
