"""Instants of samples in exact arithmetic, events, and the detection of accumulating or chattering events."""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np


class Due(NamedTuple):
    """An item due at an instant, by number: "block" or its delayed "outputs", or "sample" of a condition."""

    kind: str
    number: int
    values: Any = None


class SampleClock:
    """A queue of due items in the order of time."""

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
        """Remove and return the next instant with all its items, in the order in which they were added."""
        time = self._heap[0][0]
        due = []
        while self._heap and self._heap[0][0] == time:
            due.append(heapq.heappop(self._heap)[2])
        return time, due


def exact(seconds: float) -> Fraction:
    """Return a time as the exact value of its decimal form: 0.004 is 1/250."""
    return Fraction(repr(float(seconds)))


@dataclass(frozen=True)
class Event:
    """An event: an instant at which a `gt.when` acted or a mode switched.

    time: [s]. causes: the `gt.when` that acted and the `gt.If` that switched, with the lines that declare them.
    discrete: discrete variables that changed, by name, with their values before and after. restarted: reinitialised
    continuous variables, with their values before and after. impulses: integrals of impulsive forces over the instant
    [unit of the force times s]. energy: change of the declared stored energies [J].

    >>> class Lamp(gt.Model):
    ...     x = gt.variable(start=0.0, fixed=True)
    ...     on = gt.discrete(0.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == 1.0
    ...         yield gt.when(self.x >= 0.5, self.on == 1.0)
    >>> (event,) = gt.simulate(Lamp(), 1.0).events
    >>> round(event.time, 9), event.discrete["on"]
    (0.5, (0.0, 1.0))
    """

    time: float
    causes: tuple[str, ...]
    discrete: Mapping[str, tuple[float, float]]
    restarted: Mapping[str, tuple[float, float]]
    energy: float = 0.0
    impulses: Mapping[str, float] = field(default_factory=dict)


# events accumulate if this many successive intervals shrink by nearly the same ratio, down to this share of the run
SHRINKING, SAME_RATIO, SHORT = 10, 0.05, 1e-6
# largest number of different events that may alternate in it
LARGEST_GROUP = 4
# events chatter if there are this many within this share of the run
CHATTERING, INSTANT = 100, 1e-12


class Accumulation:
    """Detects accumulating and chattering events in a run of a given length [s]."""

    def __init__(self, length: float) -> None:
        self._length = length
        self._times: list[float] = []
        self._causes: list[str] = []

    def add(self, time: float, causes: tuple[str, ...]) -> float:
        """Add an event; return the time since the last one [s], infinite for the first."""
        since = time - self._times[-1] if self._times else np.inf
        self._times.append(time)
        self._causes.append(" and ".join(causes))
        return since

    @property
    def point(self) -> float | None:
        """The time [s] at which the events accumulate, from the geometric series of the last intervals, or of groups of
        intervals if different events alternate; None if they do not accumulate."""
        for group in range(1, LARGEST_GROUP + 1):
            d = np.diff(self._times[-SHRINKING - group - 1 :])
            if len(d) < SHRINKING + group or not 0 < d[-1] <= SHORT * self._length or not np.all(d > 0):
                continue
            ratios = d[group:] / d[:-group]
            ratio = float(ratios[-1])
            if np.all(ratios < 1) and np.ptp(ratios) <= SAME_RATIO * ratio:
                return self._times[-1] + float(np.sum(d[-group:])) * ratio / (1 - ratio)
        return None

    def sentence(self) -> str | None:
        """Return a sentence if the events accumulate or chatter, else None."""
        if (point := self.point) is not None:
            return (
                f"events accumulate at {point:.10g} s, {len(self._times)} of them until {self._times[-1]:.10g} s, from "
                f"{self._causes[-1]}; model the motion after that as another mode, such as rest: set a discrete "
                "variable when the speed becomes small, and choose the equations with gt.If"
            )
        last = self._times[-CHATTERING:]
        if len(last) == CHATTERING and last[-1] - last[0] <= INSTANT * self._length:
            causes = "; ".join(list(dict.fromkeys(self._causes[-CHATTERING:]))[:3])
            return (
                f"{CHATTERING} events chatter at {last[-1]:.10g} s: {causes}; give the switch a hysteresis or a mode "
                "in between"
            )
        return None
