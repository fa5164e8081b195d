"""Whitened rows of a block, some thousand poses at a time: what an iteration sums and never holds as a whole."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .blocks import Block
from .implicit import Adjustment, Begin

# poses that are evaluated together: Jacobians of so many stay near a core
PART = 8192


def parts(poses: int) -> list[slice]:
    """Slices of so many poses; at least one."""
    return [slice(k, min(k + PART, poses)) for k in range(0, max(poses, 1), PART)]


class BlockRows:
    """Rows [J r] (c * k, n + 1) of a block at x, in parts of c poses, divided by `sigma`.

    With a `covariance` (N or 1, ny, ny) they are those of its Adjustment, from `start`, of the closures otherwise. Of
    poses that fit into one part the last rows are kept.
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
            own = [covariance if len(covariance) == 1 else covariance[s] for s in slices]
            begin: list[Begin] = [(y if y is None else y[s], z if z is None else z[s]) for s in slices]
            self.adjustments = [Adjustment(block, *each) for each in zip(self.data, own, begin, strict=True)]
        self._kept: tuple[np.ndarray, np.ndarray] | None = None

    def __call__(self, x: np.ndarray) -> Iterator[np.ndarray]:
        for k in range(len(self.data)):
            yield self._part(k, x)

    def with_noise(self, x: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The same rows, and their Jacobian in the noise of all signals (c, k, ny)."""
        for k, data in enumerate(self.data):
            rows = self._part(k, x)
            if self.adjustments:
                yield rows, self.adjustments[k].by_noise(x)
            else:
                yield rows, self.block.evaluate_all(data, x)[2] / self.sigma

    def _part(self, k: int, x: np.ndarray) -> np.ndarray:
        if self._kept is not None and np.array_equal(self._kept[0], x):
            return self._kept[1]
        if self.adjustments:
            r, J = self.adjustments[k].per_pose(x)
            rows = np.concatenate([J, r[..., None]], axis=2).reshape(-1, len(x) + 1)
        else:
            rows = self.block.appended(self.data[k], x)
        if self.sigma != 1.0:
            rows = rows / self.sigma
        if len(self.data) == 1:
            self._kept = x.copy(), rows
        return rows

    @property
    def unclosed(self) -> np.ndarray:
        """Poses (from 0) that did not close at the last x."""
        closed = [a.closed for a in self.adjustments]
        return np.flatnonzero(~np.concatenate(closed)) if closed else np.zeros(0, int)


class JointRows:
    """Rows [J r] of blocks of several measurements that share unknowns: one below the other, over all their
    `columns`; `parts`: the number of the measurements of each."""

    def __init__(self, members: Sequence[BlockRows], parts: Sequence[int]) -> None:
        self.members, self.parts = tuple(members), tuple(parts)
        self.columns = members[0].columns
        if len(members) > 1:
            self.columns = np.unique(np.concatenate([m.columns for m in members]))
        self.places = [np.searchsorted(self.columns, m.columns) for m in members]

    def __call__(self, x: np.ndarray) -> Iterator[np.ndarray]:
        for member, own in zip(self.members, self.places, strict=True):
            for rows in member(x[own]):
                yield self.placed(rows, own)

    def of_member(self, k: int, x: np.ndarray) -> Iterator[np.ndarray]:
        """Those of one member, over all columns."""
        for rows in self.members[k](x[self.places[k]]):
            yield self.placed(rows, self.places[k])

    def with_noise(self, k: int, x: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The same, and their Jacobian in the noise of all signals of those measurements (c, k, ny)."""
        for rows, B in self.members[k].with_noise(x[self.places[k]]):
            yield self.placed(rows, self.places[k]), B

    def placed(self, rows: np.ndarray, own: np.ndarray) -> np.ndarray:
        if len(own) == len(self.columns):
            return rows
        full = np.zeros((len(rows), len(self.columns) + 1))
        full[:, own], full[:, -1] = rows[:, :-1], rows[:, -1]
        return full
