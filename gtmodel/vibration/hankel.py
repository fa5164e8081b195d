"""Block Hankel matrices of a record and their LQ factor, from which every subspace method starts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..results import ArgumentError
from .record import Record

EXCITED = 1e-9  # of the largest: a smaller singular value of the inputs' Hankel matrix says that they excite too little


class Projection(NamedTuple):
    """The LQ factor of [U_f; U_p; Y_p; Y_f] and the block sizes: `blocks` rows of m inputs and p outputs each.

    L (rows, rows) lower triangular, divided by the root of the number of columns; `inputs`, `past`, `future` slice it.
    """

    L: np.ndarray
    blocks: int
    m: int
    p: int

    @property
    def inputs(self) -> slice:
        return slice(0, self.m * self.blocks)

    @property
    def past(self) -> slice:
        return slice(self.m * self.blocks, (2 * self.m + self.p) * self.blocks)

    @property
    def future(self) -> slice:
        return slice((2 * self.m + self.p) * self.blocks, 2 * (self.m + self.p) * self.blocks)


def block_hankel(values: np.ndarray, blocks: int) -> np.ndarray:
    """(blocks * k, N - blocks + 1) of values (N, k): row block b holds the samples from b on."""
    width = len(values) - blocks + 1
    return np.vstack([values[b : b + width].T for b in range(blocks)])


def project(record: Record, blocks: int) -> Projection:
    """LQ factor of past and future with `blocks` block rows each, every row without its mean.

    A constant that is added to an input or an output, such as where a robot stands, then does not count.

    Raises ArgumentError: too few samples for so many rows, inputs that do not excite so many rows.
    """
    m, p = record.u.shape[1], record.y.shape[1]
    rows = 2 * blocks * (m + p)
    wide = len(record) - 2 * blocks + 1
    if wide < rows:
        raise ArgumentError(
            f"{len(record)} samples are too few for {blocks} block rows of {m} inputs and {p} outputs; expected at "
            f"least {rows + 2 * blocks - 1}: record longer, or take fewer block rows (a lower order)"
        )
    U, Y = (x - x.mean(axis=1, keepdims=True) for x in (block_hankel(v, 2 * blocks) for v in (record.u, record.y)))
    size = np.linalg.svd(np.linalg.qr(U.T, mode="r"), compute_uv=False)
    if size[0] == 0 or size[-1] < EXCITED * size[0]:
        rank = int(np.sum(size > EXCITED * max(size[0], 1e-300)))
        raise ArgumentError(
            f"the inputs excite {rank} of the {2 * blocks * m} directions that {blocks} block rows need; expected a "
            "rich signal such as a pseudo-random binary one, so excite anew or take fewer block rows"
        )
    mi, pi = m * blocks, p * blocks
    stacked = np.vstack([U[mi:], U[:mi], Y[:pi], Y[pi:]])
    L = np.asarray(np.linalg.qr(stacked.T, mode="r")).T / np.sqrt(wide)
    return Projection(L, blocks, m, p)
