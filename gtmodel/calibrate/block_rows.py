"""Whitened rows of a block, some thousand poses at a time: what an iteration sums and never holds as a whole."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .blocks import Block
from .implicit import Adjustment

# poses that are evaluated together: Jacobians of so many stay near a core
PART = 8192


def parts(poses: int) -> list[slice]:
    """Slices of so many poses; at least one."""
    return [slice(k, min(k + PART, poses)) for k in range(0, max(poses, 1), PART)]


class BlockRows:
    """Rows [J r] (c * k, n + 1) of a block at x, in parts of c poses, divided by `sigma`.

    With a `covariance` (N or 1, ny, ny) they are those of its Adjustment, of the closures otherwise. Of poses that fit
    into one part the last rows are kept.
    """

    def __init__(
        self, block: Block, data: np.ndarray, sigma: float, covariance: np.ndarray | None = None, latent: int = 0
    ) -> None:
        self.block, self.sigma = block, sigma
        slices = parts(data.shape[1])
        self.data = [data[:, s] for s in slices]
        self.adjustments: list[Adjustment] = []
        if covariance is not None:
            own = [covariance if len(covariance) == 1 else covariance[s] for s in slices]
            self.adjustments = [Adjustment(block, d, c, latent) for d, c in zip(self.data, own, strict=True)]
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
