"""Measurements that were counted twice: no sensor gives the same noise again, and copies narrow every interval."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

Array = np.ndarray

# of a column's spread: numbers that agree to this are one number, also after a mean was taken of a copied stretch
SAME = 1e-9
STRETCH = 32  # samples in a row that repeat in every digit while they change: quantised readings agree in a few
CHANGING = 0.5  # of a stretch: at standstill a quantised reading repeats itself and is no copy


class Stretch(NamedTuple):
    """`rows` samples of recording `again` from its row `at` repeat those of recording `first` from its row `of`."""

    again: int
    at: int
    first: int
    of: int
    rows: int


def copies(rows: Array, same: float = 0.0) -> Array:
    """Rows that equal an earlier one, as pairs (k, 2): the row, and the earlier one.

    No sensor gives the same noise twice, so that equal rows are one measurement that was counted twice.

    Args:
        rows: (n, k).
        same: how far numbers may differ, as a share of their column's spread; 0: in no digit.

    >>> gt.measurements.copies(np.array([[1.0, 2.0], [3.0, 4.0], [1.0, 2.0]])).tolist()
    [[2, 0]]
    """
    rows = np.asarray(rows, dtype=float)
    if same > 0 and len(rows):
        spread = np.ptp(rows, axis=0)
        rows = np.round((rows - rows[0]) / np.where(spread > 0, same * spread, 1.0))
    _, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    original = first[which.reshape(-1)]
    again = np.flatnonzero(original != np.arange(len(rows)))
    return np.column_stack([again, original[again]])


def copied_stretch(recordings: Sequence[Array], stretch: int = STRETCH, distinct: float = 0.0) -> Stretch | None:
    """The first stretch of evenly sampled recordings (n, k) that repeats an earlier one in every digit; None for none.

    Within a recording or between two. A stretch is at least `stretch` samples long, or as long as the shortest
    recording, and most of its samples differ from the one before: a reading at rest may stand still. At least a share
    `distinct` of them differ from each other: a coarse reading may go to and fro between a few numbers.

    >>> noise = np.random.default_rng(1).standard_normal((200, 2))  # synthetic: seed 1
    >>> pasted = np.vstack([noise, noise[50:100]])
    >>> gt.measurements.copied_stretch([pasted])
    Stretch(again=0, at=200, first=0, of=50, rows=50)
    """
    recordings = [np.asarray(r, dtype=float).reshape(len(r), -1) for r in recordings]
    length = min(stretch, *(len(r) for r in recordings))
    if length < 2:
        return None
    starts = np.cumsum([0, *(len(r) for r in recordings)])
    everything = np.vstack(recordings)
    windows, places = _windows(everything, starts, length)
    _, first, which = np.unique(windows, return_index=True, return_inverse=True)
    original = first[which]
    for k in np.flatnonzero(original != np.arange(len(windows))).tolist():
        at, of = int(places[k]), int(places[original[k]])
        # two windows of one number need not be the same
        if not np.array_equal(everything[at : at + length], everything[of : of + length]):
            continue
        if len(np.unique(everything[at : at + length], axis=0)) < distinct * length:
            continue
        again, one = (int(np.searchsorted(starts, x, side="right")) - 1 for x in (at, of))
        most = min(starts[again + 1] - at, starts[one + 1] - of)
        differ = np.flatnonzero(np.any(everything[at : at + most] != everything[of : of + most], axis=1))
        count = int(differ[0]) if differ.size else int(most)
        return Stretch(again, at - int(starts[again]), one, of - int(starts[one]), count)
    return None


def _windows(everything: Array, starts: Array, length: int) -> tuple[Array, Array]:
    """One number for each window of so many samples that lies within a recording and changes, and where it begins."""
    # a fixed seed: the same rows have the same number in every run
    weights = np.random.default_rng(0).integers(1, 2**63, (length + everything.shape[1]), dtype=np.uint64) * 2 + 1
    # -0.0 is 0.0
    bits = np.ascontiguousarray(everything + 0.0).view(np.uint64)
    bits = bits ^ (bits >> np.uint64(29))
    each = (bits * weights[: bits.shape[1]]).sum(axis=1, dtype=np.uint64)
    each = each ^ (each >> np.uint64(32))
    count = len(each) - length + 1
    numbers = np.zeros(count, dtype=np.uint64)
    for j, w in enumerate(weights[bits.shape[1] :]):
        numbers += each[j : j + count] * w
    moves = np.concatenate([[0], np.cumsum(np.any(np.diff(everything, axis=0) != 0, axis=1))])
    changing = moves[length - 1 :] - moves[:count] >= CHANGING * (length - 1)
    ends = np.repeat(starts[1:], np.diff(starts))[:count]
    places = np.flatnonzero(changing & (np.arange(count) + length <= ends))
    return numbers[places], places
