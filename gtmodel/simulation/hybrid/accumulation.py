"""Events that come closer and closer: where they accumulate, and when they no longer lead on."""

from __future__ import annotations

import numpy as np

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
