"""Instants: those of samples, counted exactly; what happened at one; and events that come closer and closer."""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np


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


@dataclass(frozen=True)
class Event:
    """An instant at which a model changed: something switched, a `gt.when` acted.

    time: [s]. causes: events by name with the lines that declare them, and `gt.If` that switched. discrete: discrete
    variables that changed, by name, with their values before and after. restarted: continuous variables that started
    anew, with their values before and after. impulses: of the forces that brought it about, their integrals over the
    instant [unit of the force times s]. energy: change of the declared stored energies [J].

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


# so many intervals in a row that shrink by nearly one ratio, down to this part of the run, accumulate
SHRINKING, SAME_RATIO, SHORT = 10, 0.05, 1e-6
# so many different events may take turns in it
LARGEST_GROUP = 4
# so many events within this part of the run lead nowhere
CHATTERING, INSTANT = 100, 1e-12


class Accumulation:
    """Watches the times of events in a run of some length [s]."""

    def __init__(self, length: float) -> None:
        self._length = length
        self._times: list[float] = []
        self._causes: list[str] = []

    def add(self, time: float, causes: tuple[str, ...]) -> float:
        """An event; the time since the last one [s], infinite for the first."""
        since = time - self._times[-1] if self._times else np.inf
        self._times.append(time)
        self._causes.append(" and ".join(causes))
        return since

    @property
    def point(self) -> float | None:
        """The time at which the events accumulate [s], as a geometric series of their last intervals, or of groups of
        them where different events take turns; None where they do not."""
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
        """Why the events lead nowhere; None where they lead on."""
        if (point := self.point) is not None:
            return (
                f"events come closer and closer and accumulate at {point:.10g} s, {len(self._times)} of them until "
                f"{self._times[-1]:.10g} s, by {self._causes[-1]}; what comes after that is another mode, such as rest:"
                " let an event set a discrete variable where the speed becomes small, and gt.If choose its equations"
            )
        last = self._times[-CHATTERING:]
        if len(last) == CHATTERING and last[-1] - last[0] <= INSTANT * self._length:
            causes = "; ".join(list(dict.fromkeys(self._causes[-CHATTERING:]))[:3])
            return (
                f"{CHATTERING} events at {last[-1]:.10g} s lead nowhere: {causes} chatter; give the switch a hysteresis"
                " or a mode of its own in between"
            )
        return None
