"""How many cycles of the robot a datagram lies behind the law's last command. gt_pace in Python."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from .exchange import RobotFeedback

SKEW_MOST = 1_000_000  # ms: any more says no more


class Arrival(Enum):
    """Whether the law may answer a datagram."""

    GOOD = auto()
    MISS = auto()  # a clock that stands or went back, or a robot that falls behind by more than may be held
    FALSE = auto()  # clocks that disagree by more than a cycle, or time that the loop never saw


@dataclass
class LoopPace:
    """The robot's numbers and its stamps, from the law's last command on.

    elapsed_ms: time of the law [ms]; cycles: by which it goes on now. faults: datagrams whose stamp stands, goes back,
    or disagrees with the numbers by more than a cycle. skew_ms: stamps over numbers [ms], of which a millisecond is
    forgotten with each datagram. held: cycles since the law's last command that went on without one.
    lead: cycles that the law is ahead of `number`.
    """

    number: int = 0
    time_ms: int = 0
    elapsed_ms: int = 0
    cycles: int = 0
    faults: int = 0
    lead: int = 0
    held: int = 0
    skew_ms: int = 0
    false_stamp: bool = False

    def begin(self, first: RobotFeedback) -> None:
        """The law begins with this datagram."""
        self.number, self.time_ms = first.sequence, first.time_ms
        self.elapsed_ms = self.cycles = self.lead = self.held = self.skew_ms = 0
        self.false_stamp = False

    def note(self, before: RobotFeedback, newer: RobotFeedback, cycle_ms: int) -> None:
        """Look at the stamp of a newer datagram, beside the newest one before it."""
        clock = _difference(newer.time_ms, before.time_ms)
        skew = self.skew_ms + clock - _difference(newer.sequence * cycle_ms, before.sequence * cycle_ms)
        disagrees = abs(skew) > cycle_ms
        self.false_stamp |= disagrees
        self.skew_ms = 0 if disagrees else skew - (skew > 0) + (skew < 0)
        self.faults += disagrees or clock <= 0

    def verdict(self, now: RobotFeedback, cycle_ms: int, hold_cycles: int, *, answered: bool) -> Arrival:
        """Whether the law may answer this datagram; then `cycles` says how far it goes on.

        hold_cycles: as many may go on without a command. answered: a cycle without a datagram got an answer (EGM).
        """
        numbers, own = now.sequence - self.number, self.held + 1
        self.cycles = own if numbers else 0  # 0: the law's first cycle
        if numbers == 0:
            return Arrival.GOOD
        if now.time_ms <= self.time_ms:
            return Arrival.MISS
        if self.false_stamp:
            return Arrival.FALSE
        if numbers > self.lead + self.held:
            lesser = min(numbers, (now.time_ms - self.time_ms) // cycle_ms)
            self.cycles = max(lesser, self.lead + own) - self.lead
            return Arrival.FALSE if self.cycles > own + hold_cycles else Arrival.GOOD
        if not answered:  # what was not sent is not ahead
            self.cycles = numbers
            return Arrival.GOOD
        return Arrival.MISS if self.lead + own > numbers + hold_cycles else Arrival.GOOD

    @property
    def moved(self) -> int:
        """Cycles that the law's command moves the carts on from where they are, 1 at least."""
        return max(1, self.cycles - self.held)

    def take(self, now: RobotFeedback, cycle_ms: int) -> None:
        """The law's command for this datagram counts."""
        self.elapsed_ms += self.cycles * cycle_ms
        self.lead = max(0, self.lead + self.cycles - (now.sequence - self.number))
        self.number, self.time_ms = now.sequence, now.time_ms
        self.held = 0


def _difference(a: int, b: int) -> int:
    """a - b of two counters, as far as it says anything."""
    return max(-SKEW_MOST, min(a - b, SKEW_MOST))
