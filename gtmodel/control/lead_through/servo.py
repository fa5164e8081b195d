"""How a robot follows a velocity command: delay, lag and mode, exact from sample to sample; the force loop of it."""

from __future__ import annotations

import numpy as np

from ..delayed import DelayedLoop
from .options import ServoChain


def force_loop(servo: ServoChain, cycle: float = 0.004) -> DelayedLoop:
    """The force loop along the normal, in contact, whose gain is force_gain times contact stiffness [1/s].

    `gt.control.delayed.gain_limit` gives the gain and the frequency at which it oscillates. cycle [s].

    >>> limit = gt.control.delayed.gain_limit(gt.control.lead_through.force_loop(gt.control.lead_through.ServoChain()))
    >>> round(limit.gain, 1), round(limit.frequency, 1)  # [1/s], [Hz]
    (112.1, 12.8)
    """
    return DelayedLoop(servo.plant(), cycle, servo.delay)


class ServoRun:
    """Axes that follow their commands by one chain, cycle by cycle; `position` (n,) [m], `velocity` (n,) [m/s] and
    `acceleration` (n,) [m/s2] are those at the sample, before a new command acts."""

    def __init__(self, servo: ServoChain, cycle: float, start: np.ndarray) -> None:
        loop = force_loop(servo, cycle)
        (self._whole, rest), (self._a, self._early, self._late) = loop.split, loop.transition
        self._parts, self._plant, self._acting = rest > 0, loop.plant, np.zeros_like(start)
        self._x = np.zeros((len(self._a), len(start)))
        self._x[0] = start
        self._ahead = np.zeros((self._whole + self._parts + 1, len(start)))  # on their way, youngest first

    @property
    def position(self) -> np.ndarray:
        """At the sample."""
        return self._x[0]

    @property
    def velocity(self) -> np.ndarray:
        """At the sample."""
        return self._x[1]

    @property
    def acceleration(self) -> np.ndarray:
        """At the sample, under the command that acted up to it."""
        return self._plant.A[1] @ self._x + self._plant.B[1] * self._acting

    def advance(self, command: np.ndarray) -> None:
        """One cycle, with a new command (n,) given at its beginning."""
        self._ahead = np.vstack([[command], self._ahead[:-1]])
        self._acting = self._ahead[self._whole]
        self._x = self._a @ self._x + np.outer(self._late, self._acting)
        if self._parts:
            self._x += np.outer(self._early, self._ahead[self._whole + 1])
