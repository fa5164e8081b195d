"""Tests that look at the data of every run: what was measured, what a fit leaves of it, and measurements that were
counted twice.

Poses, readings of a force sensor, runs, logs, corners, filters and tables all go through `tested`. A new test is
a function of `Data` marked by `every_run`; its name in `EveryAlarm` lets each of them accept it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...results.suspicion import Suspicion

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


DISTINCT = 0.5  # of a stretch of one signal that is taken for a copy: a coarse reading repeats itself
DIGITS, FEW = 6, 1e-12  # of a number that was written down, not a mean; how far the rounding of that is off
COUNTED_TWICE = "noise does not repeat itself, and a copy counts twice and narrows the intervals: take copies out"


@dataclass(frozen=True, eq=False)
class Data:
    """What a run knows of its data; what is left out is not looked at.

    columns: name -> readings (n,) or (n, k). noise: names of those of which each row has noise of its own, written in
        all its digits; the others may have been moved by a constant. row: what a row is called; place, numbers: how it
        is pointed to, "line" 7, by default row and its number from 1.
    recordings: name and times [s] of each recording, where the rows follow each other in time.
    residuals: (n, k), what a fit leaves, in units of their noise where that differs.
    """

    columns: Mapping[str, ArrayLike] = field(default_factory=dict)
    noise: Sequence[str] = ()
    row: str = "row"
    place: str = ""
    numbers: Sequence[int] | np.ndarray | None = None
    recordings: Sequence[tuple[str, np.ndarray]] = ()
    residuals: np.ndarray | None = None

    def rows(self, names: Iterable[str]) -> np.ndarray:
        """Some columns side by side (n, k)."""
        given = [np.asarray(self.columns[name], float) for name in names]
        return np.hstack([one.reshape(len(one), -1) for one in given])


Test = Callable[[Data], Iterable[Suspicion]]
EVERY_RUN: list[Test] = []


def every_run(test: Test) -> Test:
    """A test that every run makes."""
    EVERY_RUN.append(test)
    return test


def tested(*data: Data) -> list[Suspicion]:
    """What the tests find in the data of one run; those that clean data cannot fail are there only where they did.

    >>> rng = np.random.default_rng(1)  # synthetic: seed 1
    >>> q = rng.normal(size=(20, 3))
    >>> q[7] = q[4]
    >>> [found.evidence for found in tested(Data({"q": q}, noise=["q"], row="pose"))]
    ['1 of 20 poses are copies of others in every digit, the first pose 8 of pose 5']
    """
    return [suspicion for test in EVERY_RUN for one in data for suspicion in test(one)]


@every_run
def copied(data: Data) -> Iterator[Suspicion]:
    """Rows, or stretches of a recording, that repeat earlier ones: no sensor gives the same noise again."""
    if not data.noise:
        return
    every, own = data.rows(data.columns), data.rows(data.noise)
    if data.recordings:
        ends = np.cumsum([len(time) for _, time in data.recordings])[:-1]
        stretch = copied_stretch(np.split(every, ends)) or copied_stretch(np.split(own, ends), distinct=DISTINCT)
        if stretch is not None:
            (again, at), (first, of) = data.recordings[stretch.again], data.recordings[stretch.first]
            yield Suspicion(
                "copied_rows",
                f"'{again}' repeats from {at[stretch.at]:g} s on, in {stretch.rows} samples and every digit, what "
                f"'{first}' holds from {of[stretch.of]:g} s on",
                remedy=COUNTED_TWICE,
            )
        return
    pairs = copies(every, SAME)
    if not len(pairs) and own.shape[1] < every.shape[1]:  # where numbers are given in few digits, two may well agree
        fine = np.flatnonzero(np.any(np.abs(own - _rounded(own)) > FEW * np.abs(own), axis=1))
        pairs = fine[copies(own[fine], SAME)] if len(fine) else pairs
    if len(pairs):
        numbers = np.arange(1, len(every) + 1) if data.numbers is None else np.asarray(data.numbers)
        (again, first), place = numbers[pairs[0]], data.place or data.row
        evidence = f"{len(pairs)} of {len(every)} {data.row}s are copies of others in every digit"
        yield Suspicion("copied_rows", f"{evidence}, the first {place} {again} of {place} {first}",
                        remedy=COUNTED_TWICE)  # fmt: skip


def _rounded(values: np.ndarray) -> np.ndarray:
    size = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), np.finfo(float).tiny))) - DIGITS + 1)
    return np.round(values / size) * size
