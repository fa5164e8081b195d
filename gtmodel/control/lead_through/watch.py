"""A contact that oscillates is seen in the tool force; the gain of the force control is then reduced."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from ...results.options import Options, Unit, Within

Watched = tuple[float, float, float]
CALM: Watched = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class OscillationWatch(Options):
    """Reduces the gain of the force control while the tool force oscillates.

    The energy of the force above `corner` over a sliding window, with weights that fade with its age: above the square
    of `level` the gain falls, without contact it recovers. With a level of 0 nothing is watched.

    >>> watch = gt.control.lead_through.OscillationWatch(level=0.5)
    >>> seen = (0.0, 0.0, 1.0)
    >>> for k in range(250):  # 2 N and an oscillation of 1 N at 62.5 Hz
    ...     seen = watch.step(seen, 2.0 + (0.0, 1.0, 0.0, -1.0)[k % 4], True, 0.004)
    >>> bool(seen[2] < 0.1)  # share of the gain that is left
    True
    """

    level: Annotated[float, Unit("N"), Within(least=0.0), "root mean square above it is oscillation; 0: off"] = 0.0
    corner: Annotated[float, Unit("Hz"), Within(above=0.0), "slower changes of the force do not count"] = 5.0
    window: Annotated[float, Unit("s"), Within(above=0.0), "time constant of the sliding window"] = 0.3
    fall: Annotated[float, Unit("s"), Within(above=0.0), "time constant at which the gain falls"] = 0.2
    recovery: Annotated[float, Unit("s"), Within(above=0.0), "time constant at which it recovers, free of contact"] = (
        5.0
    )
    least_share: Annotated[float, Within(above=0.0, most=1.0), "of the gain that stays"] = 0.02

    def step(self, seen: Watched, force: float, contact: bool, cycle: float) -> Watched:
        """Slow part of the force [N], energy [N2] and share of the gain, a cycle [s] on."""
        if self.level == 0.0:
            return seen
        slow, energy, share = seen
        constant = 1.0 / (2.0 * math.pi * self.corner)
        slow = slow + cycle / (constant + cycle) * (force - slow)
        fast = force - slow
        energy = energy + cycle / (self.window + cycle) * (fast * fast - energy)
        if energy > self.level * self.level:
            share = max(share - cycle / (self.fall + cycle) * share, self.least_share)
        elif not contact:
            share = share + cycle / (self.recovery + cycle) * (1.0 - share)
        return slow, energy, share
