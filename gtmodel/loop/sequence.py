"""Which datagram is new, and what the others are. gt_sequence in Python."""

from __future__ import annotations

from dataclasses import dataclass

WINDOW = 64
_SEEN = (1 << WINDOW) - 1
_UINT32 = (1 << 32) - 1


def near(last: int, low: int) -> int:
    """The number nearest to `last` whose low 32 bits are `low`; it may lie below zero."""
    ahead = (low - last) & _UINT32
    return last + ahead if ahead <= _UINT32 // 2 else last + ahead - (_UINT32 + 1)


@dataclass
class Sequence:
    """Counters: lost (not come, between the first and the newest), repeated, reordered (came after a newer one),
    stale (older than the first or by more than 63 numbers)."""

    first: int | None = None
    newest: int = 0
    seen: int = 0
    lost: int = 0
    repeated: int = 0
    reordered: int = 0
    stale: int = 0

    def take_32(self, low: int) -> int | None:
        """`take` for a counter of 32 bits: the number that it goes on with if that is newer than all before."""
        number = low if self.first is None else near(self.newest, low)
        if number < 0:
            self.stale += 1
            return None
        return number if self.take(number) else None

    def take(self, number: int) -> bool:
        """Count a datagram of this number; True if it is newer than all before."""
        if self.first is None:
            self.first = self.newest = number
            self.seen = 1
            return True
        if number > self.newest:
            gap = number - self.newest
            self.lost += gap - 1
            self.seen = (self.seen << gap | 1) & _SEEN if gap < WINDOW else 1
            self.newest = number
            return True
        age = self.newest - number
        if age >= WINDOW or number < self.first:
            self.stale += 1
        elif self.seen >> age & 1:
            self.repeated += 1
        else:
            self.seen |= 1 << age
            self.reordered += 1
            self.lost -= 1
        return False
