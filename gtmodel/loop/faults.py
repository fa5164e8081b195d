"""A channel that loses, delays, repeats, reorders and spoils datagrams, with a seed; and what a loop has to count."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Faults:
    """What a channel does to datagrams: shares from 0 to 1 that are lost, delayed, repeated or joined by garbage.

    Each fault is drawn on its own, with the seed; a delay is 1 to `longest_delay` cycles.
    """

    lost: float = 0.0
    delayed: float = 0.0
    repeated: float = 0.0
    garbage: float = 0.0
    longest_delay: int = 3
    seed: int = 0


@dataclass
class Channel:
    """One direction of a connection with faults.

    `put` takes a datagram in its cycle; `due` gives the datagrams that arrive in a cycle, those sent first before
    others. `history` keeps their numbers, cycle by cycle, for `expected_counters`.

    >>> channel = gt.loop.Channel(gt.loop.Faults(lost=1.0))
    >>> channel.put(0, 7, b"datagram")
    >>> channel.due(0)
    []
    """

    faults: Faults = field(default_factory=Faults)
    history: list[list[int | None]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._random = random.Random(self.faults.seed)
        self._waiting: list[tuple[int, int | None, bytes]] = []  # due in this cycle; number, None for garbage; bytes

    def put(self, cycle: int, number: int, data: bytes) -> None:
        """Send a datagram."""
        f, draw = self.faults, self._random.random
        lost, delayed, repeated, garbage = (draw() < share for share in (f.lost, f.delayed, f.repeated, f.garbage))
        delay = self._random.randint(1, f.longest_delay) if delayed else 0
        if garbage:
            self._waiting.append((cycle, None, self._spoilt(data)))
        if not lost:
            self._waiting.append((cycle + delay, number, data))
        if repeated and not lost:
            self._waiting.append((cycle + delay + self._random.randint(0, f.longest_delay), number, data))

    def due(self, cycle: int) -> list[bytes]:
        """Datagrams that arrive in this cycle."""
        here = [d for d in self._waiting if d[0] <= cycle]
        self._waiting = [d for d in self._waiting if d[0] > cycle]
        self.history.append([number for _, number, _ in here])
        return [data for _, _, data in here]

    def _spoilt(self, data: bytes) -> bytes:
        """Random bytes or a datagram that is cut; neither can be read as a whole one."""
        if self._random.random() < 0.5:
            return b"\xff" + self._random.randbytes(self._random.randint(0, 200))
        return data[: self._random.randint(1, max(1, len(data) // 3))]


def expected_counters(history: Iterable[list[int | None]]) -> dict[str, int]:
    """What a loop has to count, from the numbers of the datagrams that arrived in each cycle; None stands for garbage.

    An independent count by sets, for comparison with the loop's own, which keeps a window of numbers. A cycle in which
    no newer datagram arrives counts as late; numbers before the first one as stale; numbers never seen as lost.

    >>> history = [[1], [2, 2], [], [5], [4, None]]
    >>> counted = gt.loop.expected_counters(history)
    >>> counted["lost"], counted["repeated"], counted["reordered"], counted["garbage"], counted["late"]
    (1, 1, 1, 1, 2)
    """
    seen: set[int] = set()
    count = dict.fromkeys(("late", "repeated", "reordered", "stale", "garbage"), 0)
    newest = first = None
    for numbers in history:
        before = newest
        for number in numbers:
            if number is None:
                count["garbage"] += 1
            elif first is None or newest is None:
                first = newest = number
                seen.add(number)
            elif number < first:
                count["stale"] += 1
            elif number in seen:
                count["repeated"] += 1
            else:
                seen.add(number)
                count["reordered"] += number < newest
                newest = max(newest, number)
        count["late"] += newest is not None and newest == before
    span = 0 if newest is None or first is None else newest - first + 1
    return {**count, "lost": span - len(seen)}
