"""Numerical inverse kinematics of any serial chain within limits, from many starts, for many poses at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .chain import Chain
from .numerical import SOLVED, jacobian, nearest_starts, polished, starts

NEAREST = 16  # starts from stored poses, in order of distance
OTHERS = 48  # starts after these, spread over all joint coordinates
ITERATIONS = 40  # of one descent
REGULAR = 0.02  # ratio of singular values of the Jacobian, below which a start is nearly singular
NEIGHBOURHOODS, TRIED = (0.15, 0.3, 0.6, 1.0), 32  # rad, or of half the chain's length; points tried in each


@dataclass(frozen=True, eq=False)
class ChainSearch:
    """Joint coordinates for poses of a chain, by damped steps from declared starts, then from stored ones.

    `limits` (n, 2) of the coordinates, infinite without one; `declared` (k, n): starts tried first, in order;
    `oriented`: the rotation is known besides the position. The same pose has the same result, whatever other poses are
    asked for.
    """

    chain: Chain
    limits: np.ndarray
    declared: np.ndarray
    oriented: bool = True

    def solve(self, T: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Return q (m, n) for poses T (m, 3), R (m, 3, 3), NaN where none was found.

        Coordinates within limits are preferred to those found first. R is not used if the chain is not `oriented`.
        """
        q, inside = np.full((len(T), len(self.chain)), np.nan), np.zeros(len(T), dtype=bool)
        turned = R if self.oriented else None
        near = nearest_starts(self.chain, T, turned, NEAREST, self.limits) if len(T) else np.zeros((0, NEAREST, 0))
        others = starts(self.chain, OTHERS, self.limits)
        for k in range(len(self.declared) + NEAREST + OTHERS):
            rows, here = np.flatnonzero(~inside), k - len(self.declared)
            if not rows.size:
                break
            if 0 <= here < NEAREST:
                start = near[rows, here]
            else:
                start = np.tile(self.declared[k] if here < 0 else others[here - NEAREST], (len(rows), 1))
            ends, error = polished(self.chain, T[rows], R[rows] if self.oriented else None, start, ITERATIONS)
            ends = self.without_turns(ends)
            better = (error <= SOLVED) & (np.isnan(q[rows, 0]) | self.within(ends))
            q[rows[better]] = ends[better]
            inside[rows[better]] = self.within(ends[better])
        return q

    def without_turns(self, q: np.ndarray) -> np.ndarray:
        """Return q with the full turns that bring angles nearest to the middle of their limits, or to the first
        declared start."""
        finite = np.where(np.isfinite(self.limits), self.limits, np.nan)
        middle = finite.mean(axis=1)  # NaN for a joint without both limits
        middle = np.where(np.isnan(middle), self.declared[0], middle)
        return np.where(self.chain.revolute, q - 2 * np.pi * np.round((q - middle) / (2 * np.pi)), q)

    def within(self, q: np.ndarray) -> np.ndarray:
        """Return which rows of q (m, n) are within the limits; false for NaN."""
        return np.all((q >= self.limits[:, 0]) & (q <= self.limits[:, 1]), axis=1)

    def regular(self, q: np.ndarray) -> np.ndarray:
        """Return joint coordinates (n,) at which the chain is not nearly singular: q itself, or the best within the
        limits in the smallest neighbourhood of q that has any."""
        if self._conditioning(q[None])[0] >= REGULAR:
            return q
        best, most = q, 0.0
        for part in NEIGHBOURHOODS:
            half = part * self._unit / np.where(self.chain.revolute, 1.0, 2.0)
            box = np.column_stack([np.maximum(self.limits[:, 0], q - half), np.minimum(self.limits[:, 1], q + half)])
            points = starts(self.chain, TRIED, box)
            values = self._conditioning(points)
            if np.max(values) > most:
                best, most = points[int(np.argmax(values))], float(np.max(values))
            if most >= REGULAR:
                break
        return best

    @cached_property
    def _unit(self) -> np.ndarray:
        return np.where(self.chain.revolute, 1.0, self.chain.size)

    def _conditioning(self, q: np.ndarray) -> np.ndarray:
        """Return the ratio of the smallest to the largest singular value of the Jacobian at q (m, n)."""
        s = np.linalg.svd(jacobian(self.chain, q, self.oriented), compute_uv=False)
        return s[:, -1] / s[:, 0]
