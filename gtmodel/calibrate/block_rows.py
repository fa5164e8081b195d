"""Whitened rows of a block, evaluated some thousand poses at a time; the whole Jacobian is never stored."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .blocks import Block
from .implicit import Adjustment, Begin

# number of poses evaluated together, so that their Jacobians stay in the cache
PART = 8192


def parts(poses: int) -> list[slice]:
    """Slices that cover this number of poses; at least one."""
    return [slice(k, min(k + PART, poses)) for k in range(0, max(poses, 1), PART)]


class BlockRows:
    """Rows [J r] (c * k, n + 1) of a block at x, in parts of c poses, divided by `sigma`.

    With a `covariance` (N or 1, ny, ny) the rows are those of its Adjustment from `start`; otherwise those of the
    closure equations. If all poses fit into one part, the last rows are cached.
    """

    def __init__(
        self,
        block: Block,
        data: np.ndarray,
        sigma: float,
        covariance: np.ndarray | None = None,
        start: Begin = (None, None),
    ) -> None:
        self.block, self.sigma = block, sigma
        self.columns = block.columns
        slices = parts(data.shape[1])
        self.data = [data[:, s] for s in slices]
        self.adjustments: list[Adjustment] = []
        if covariance is not None:
            y, z = start
            covariances = [covariance if len(covariance) == 1 else covariance[s] for s in slices]
            begin: list[Begin] = [(y if y is None else y[s], z if z is None else z[s]) for s in slices]
            self.adjustments = [Adjustment(block, *each) for each in zip(self.data, covariances, begin, strict=True)]
        self._cached: tuple[np.ndarray, np.ndarray] | None = None

    def __call__(self, x: np.ndarray) -> Iterator[np.ndarray]:
        for k in range(len(self.data)):
            yield self._part(k, x)

    def with_noise(self, x: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the rows and their Jacobian with respect to the noise of all signals (c, k, ny)."""
        for k, data in enumerate(self.data):
            rows = self._part(k, x)
            if self.adjustments:
                yield rows, self.adjustments[k].by_noise(x)
            else:
                yield rows, self.block.evaluate_all(data, x)[2] / self.sigma

    def _part(self, k: int, x: np.ndarray) -> np.ndarray:
        if self._cached is not None and np.array_equal(self._cached[0], x):
            return self._cached[1]
        if self.adjustments:
            r, J = self.adjustments[k].per_pose(x)
            rows = np.concatenate([J, r[..., None]], axis=2).reshape(-1, len(x) + 1)
        else:
            rows = self.block.appended(self.data[k], x)
        if self.sigma != 1.0:
            rows = rows / self.sigma
        if len(self.data) == 1:
            self._cached = x.copy(), rows
        return rows

    @property
    def unclosed(self) -> np.ndarray:
        """Poses (from 0) that do not close at the last x."""
        closed = [a.closed for a in self.adjustments]
        return np.flatnonzero(~np.concatenate(closed)) if closed else np.zeros(0, int)


class JointRows:
    """Rows [J r] of blocks of several measurements that share unknowns, stacked over all their `columns`.

    `parts`: for each block the number of its measurements."""

    def __init__(self, members: Sequence[BlockRows], parts: Sequence[int]) -> None:
        self.members, self.parts = tuple(members), tuple(parts)
        self.columns = members[0].columns
        if len(members) > 1:
            self.columns = np.unique(np.concatenate([m.columns for m in members]))
        self.places = [np.searchsorted(self.columns, m.columns) for m in members]

    def __call__(self, x: np.ndarray) -> Iterator[np.ndarray]:
        for member, columns in zip(self.members, self.places, strict=True):
            for rows in member(x[columns]):
                yield self.placed(rows, columns)

    def of_member(self, k: int, x: np.ndarray) -> Iterator[np.ndarray]:
        """Rows of one member, over all columns."""
        for rows in self.members[k](x[self.places[k]]):
            yield self.placed(rows, self.places[k])

    def with_noise(self, k: int, x: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Rows of one member, and their Jacobian with respect to the noise of all its signals (c, k, ny)."""
        for rows, B in self.members[k].with_noise(x[self.places[k]]):
            yield self.placed(rows, self.places[k]), B

    def placed(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        if len(columns) == len(self.columns):
            return rows
        full = np.zeros((len(rows), len(self.columns) + 1))
        full[:, columns], full[:, -1] = rows[:, :-1], rows[:, -1]
        return full
