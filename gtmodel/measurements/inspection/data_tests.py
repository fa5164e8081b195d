"""Tests of the data of every run, such as for measurements that were copied.

All studies of measured data pass them through `tested`. A new test is a function of `Data` with the decorator
`every_run`; its name in `EveryAlarm` lets `accept` take it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...results.suspicion import Suspicion

Array = np.ndarray

# share of a column's spread within which numbers count as equal; covers means of a copied stretch
SAME = 1e-9
STRETCH = 32  # least consecutive samples of a copy; shorter stretches of quantised readings agree by chance
CHANGING = 0.5  # least share of changing samples in a stretch: a quantised reading repeats itself at standstill


class Stretch(NamedTuple):
    """`rows` samples of recording `again` from its row `at` repeat those of recording `first` from its row `of`."""

    again: int
    at: int
    first: int
    of: int
    rows: int


def copies(rows: Array, same: float = 0.0) -> Array:
    """Return the rows that equal an earlier row, as pairs (k, 2): the row, and the earlier row.

    Sensor noise does not repeat, so equal rows are one measurement counted twice.

    Args:
        rows: (n, k).
        same: largest difference of equal numbers, as a share of their column's spread; 0: equal in every digit.

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
    """Return the first stretch of evenly sampled recordings (n, k) that repeats an earlier one in every digit, or None.

    The copy may lie in the same or in another recording. A stretch has at least `stretch` samples, or the length of the
    shortest recording. Most of its samples differ from the previous one, because a reading at rest may be constant. At
    least a share `distinct` of its samples are different values, because a coarse reading may alternate between a few.

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
        copy, source = int(places[k]), int(places[original[k]])
        # windows with equal hashes may differ
        if not np.array_equal(everything[copy : copy + length], everything[source : source + length]):
            continue
        if len(np.unique(everything[copy : copy + length], axis=0)) < distinct * length:
            continue
        again, first_run = (int(np.searchsorted(starts, x, side="right")) - 1 for x in (copy, source))
        most = min(starts[again + 1] - copy, starts[first_run + 1] - source)
        differ = np.flatnonzero(np.any(everything[copy : copy + most] != everything[source : source + most], axis=1))
        count = int(differ[0]) if differ.size else int(most)
        return Stretch(again, copy - int(starts[again]), first_run, source - int(starts[first_run]), count)
    return None


def _windows(everything: Array, starts: Array, length: int) -> tuple[Array, Array]:
    """Return a hash of each window of `length` samples that lies in one recording and changes, and its first row."""
    # a fixed seed: equal rows have equal hashes in every run
    weights = np.random.default_rng(0).integers(1, 2**63, (length + everything.shape[1]), dtype=np.uint64) * 2 + 1
    # turns -0.0 into 0.0
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


DISTINCT = 0.5  # least share of distinct samples in a copied stretch of one signal: a coarse reading repeats itself
DIGITS, FEW = 6, 1e-12  # numbers that agree with their rounding to DIGITS, to a share FEW, were written with few digits
COUNTED_TWICE = "noise does not repeat itself, and copies make the intervals too narrow: remove the copies"


@dataclass(frozen=True, eq=False)
class Data:
    """The data of a run; fields that are left out are not tested.

    columns: name -> readings (n,) or (n, k). noise: names of the columns with independent noise in every row, written
        with all digits; the other columns may differ between copies by a constant. row: term for a row; place, numbers:
        how messages point to a row, such as "line" 7; default: term and number from 1.
    recordings: name and times [s] of each recording, for rows that follow each other in time.
    residuals: (n, k), residuals of a fit, in units of their noise if that differs.
    """

    columns: Mapping[str, ArrayLike] = field(default_factory=dict)
    noise: Sequence[str] = ()
    row: str = "row"
    place: str = ""
    numbers: Sequence[int] | np.ndarray | None = None
    recordings: Sequence[tuple[str, np.ndarray]] = ()
    residuals: np.ndarray | None = None

    def rows(self, names: Iterable[str]) -> np.ndarray:
        """Return columns side by side (n, k)."""
        columns = [np.asarray(self.columns[name], float) for name in names]
        return np.hstack([column.reshape(len(column), -1) for column in columns])


Test = Callable[[Data], Iterable[Suspicion]]
EVERY_RUN: list[Test] = []


def every_run(test: Test) -> Test:
    """Register a test that every run makes."""
    EVERY_RUN.append(test)
    return test


def tested(*data: Data) -> list[Suspicion]:
    """Return the suspicions of all tests of the data of one run.

    >>> rng = np.random.default_rng(1)  # synthetic: seed 1
    >>> q = rng.normal(size=(20, 3))
    >>> q[7] = q[4]
    >>> [suspicion.evidence for suspicion in tested(Data({"q": q}, noise=["q"], row="pose"))]
    ['1 of 20 poses are copies of others in every digit, the first pose 8 of pose 5']
    """
    return [suspicion for test in EVERY_RUN for one in data for suspicion in test(one)]


@every_run
def copied(data: Data) -> Iterator[Suspicion]:
    """Find rows, or stretches of a recording, that repeat earlier ones: sensor noise does not repeat."""
    if not data.noise:
        return
    every, noisy = data.rows(data.columns), data.rows(data.noise)
    if data.recordings:
        ends = np.cumsum([len(time) for _, time in data.recordings])[:-1]
        stretch = copied_stretch(np.split(every, ends)) or copied_stretch(np.split(noisy, ends), distinct=DISTINCT)
        if stretch is not None:
            (again, times), (first, first_times) = data.recordings[stretch.again], data.recordings[stretch.first]
            yield Suspicion(
                "copied_rows",
                f"from {times[stretch.at]:g} s, {stretch.rows} samples of '{again}' repeat in every digit those of "
                f"'{first}' from {first_times[stretch.of]:g} s",
                remedy=COUNTED_TWICE,
            )
        return
    pairs = copies(every, SAME)
    if not len(pairs) and noisy.shape[1] < every.shape[1]:  # numbers written with few digits may agree by chance
        fine = np.flatnonzero(np.any(np.abs(noisy - _rounded(noisy)) > FEW * np.abs(noisy), axis=1))
        pairs = fine[copies(noisy[fine], SAME)] if len(fine) else pairs
    if len(pairs):
        numbers = np.arange(1, len(every) + 1) if data.numbers is None else np.asarray(data.numbers)
        (again, first), place = numbers[pairs[0]], data.place or data.row
        evidence = f"{len(pairs)} of {len(every)} {data.row}s are copies of others in every digit"
        yield Suspicion("copied_rows", f"{evidence}, the first {place} {again} of {place} {first}",
                        remedy=COUNTED_TWICE)  # fmt: skip


def _rounded(values: np.ndarray) -> np.ndarray:
    size = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), np.finfo(float).tiny))) - DIGITS + 1)
    return np.round(values / size) * size
