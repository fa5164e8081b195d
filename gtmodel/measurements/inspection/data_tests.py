"""Tests that look at the data of every run: what was measured, and what a fit leaves of it.

Poses, readings of a force sensor, runs, logs, corners, filters and tables all go through `tested`. A new test is a
function of `Data` marked by `every_run`; its name in `EveryAlarm` lets each of them accept it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ...results.suspicion import Suspicion
from .copies import SAME, copied_stretch, copies

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
