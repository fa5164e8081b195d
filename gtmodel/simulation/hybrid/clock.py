"""Instants of samples, counted exactly: what is due at one instant is due there, whatever rounding says."""

from __future__ import annotations

import heapq
from fractions import Fraction
from typing import Any, NamedTuple


class Due(NamedTuple):
    """Something that happens at an instant: "sample" of a block or a condition by number, or "outputs" of a block."""

    kind: str
    number: int
    values: Any = None


class SampleClock:
    """What is due when, in the order of time."""

    def __init__(self) -> None:
        self._heap: list[tuple[Fraction, int, Due]] = []
        self._count = 0

    def add(self, time: Fraction, due: Due) -> None:
        heapq.heappush(self._heap, (time, self._count, due))
        self._count += 1

    @property
    def next(self) -> Fraction | None:
        """The next instant."""
        return self._heap[0][0] if self._heap else None

    def take(self) -> tuple[Fraction, list[Due]]:
        """The next instant and all that is due at it, in the order in which it was added."""
        time = self._heap[0][0]
        due = []
        while self._heap and self._heap[0][0] == time:
            due.append(heapq.heappop(self._heap)[2])
        return time, due


def exact(seconds: float) -> Fraction:
    """A time as it is written in decimals: 0.004 is 1/250."""
    return Fraction(repr(float(seconds)))
