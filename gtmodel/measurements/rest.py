"""Test of rest: block means of a recording against its noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

BLOCKS = 16  # parts of the rows whose means are compared
ROUNDS = 4.5  # standard deviations of a block mean: at rest, one of 96 exceeds this once in 1,500 logs


class MovedBlock(NamedTuple):
    """Rows `begin` to `end` of a log, whose mean is off the mean of the log by `difference` in a component.

    noise: standard deviation of one row in this component.
    """

    begin: int
    end: int
    component: int
    difference: float
    noise: float


def motion_at_rest(
    rows: np.ndarray, allowed: float = 0.0, allowed_deviations: float = 0.0
) -> tuple[MovedBlock | None, np.ndarray]:
    """Return the block of rows (n, k) that moves most, None if the log is at rest, and the means of all blocks (b, k).

    A block moves if its mean is off the mean of the log by more than its noise plus `allowed`, in the unit of the rows,
    plus `allowed_deviations` standard deviations of one row. The means are relative to that of the log.
    """
    noise = np.sqrt(np.mean(np.diff(rows, axis=0) ** 2, axis=0) / 2)  # of one row; slow motion cancels
    blocks = np.array_split(rows, min(BLOCKS, len(rows) // 4))
    means = np.array([b.mean(axis=0) for b in blocks]) - rows.mean(axis=0)
    excess = np.abs(means) - ROUNDS * noise / np.sqrt(len(blocks[-1])) - allowed_deviations * noise
    b, k = (int(i) for i in np.unravel_index(int(np.argmax(excess)), excess.shape))
    if excess[b, k] <= allowed:
        return None, means
    begin = sum(len(block) for block in blocks[:b])
    return MovedBlock(begin, begin + len(blocks[b]), k, float(means[b, k]), float(noise[k])), means
