"""Switches at which one side ends: no numbers come out of it beyond, as of a root of what becomes negative."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from ...lang.source import ModelError
from ..ending import Ended
from ..systems import SimulatedSystem
from .event import Event
from .sides import SidesAtInstant

Restarted = tuple[SimulatedSystem, np.ndarray, np.ndarray]

# so many of the shortest intervals are gone over by the rates where the integrator cannot go over the switch
EDGE = 100.0
# where no numbers come out at a switch by round-off, once, twice, four times that time of round-off away, and so on
FURTHER = 12


class OverEdges(SidesAtInstant):
    """Where a simulation is that goes from a side that ends to one that begins."""

    if TYPE_CHECKING:
        events: list[Event]

        def _event(self, forced: Sequence[int]) -> None: ...

    def _over_failure(self) -> bool:
        """Whether the integrator, to which no numbers come beyond a switch where one side ends, is taken over it."""
        far = self._stepper.far
        if far is None or not self._declared.comparisons:
            return False
        span, x, work = far
        time, no_z = self._time + span, np.zeros((1, 0))
        left = self._left(x, time)[1]
        beyond = left + self._slack * 2.0**FURTHER
        if not left <= EDGE * self._shortest or self._defined(self._straight_on(beyond, x, time), time + beyond):
            return False
        happened = len(self.events)
        if time > self._time and not self._accept(np.array([time]), x[None, :], no_z, work[None, :]):
            return False
        # what changed on the way there comes first
        return len(self.events) > happened or self._over_edge()

    def _left(self, x: np.ndarray, time: float) -> tuple[int, float]:
        """The comparison that changes next by the rates, and the time [s] until then."""
        values, rates = self._comparisons(x[None, :], self._z[None, :], np.array([time]))
        s, ds = values[0] * self._signs(), rates[0] * self._signs()
        with np.errstate(all="ignore"):
            left = np.where(ds < 0, np.maximum(s / -ds, 0.0), np.inf)
        return int(np.argmin(left)), float(np.min(left))

    def _over_edge(self) -> bool:
        """Whether a comparison changes within a few of the shortest intervals; then its event has happened."""
        if not self._declared.comparisons or self._z.size:
            return False
        n, left = self._left(self._x, self._time)
        if not left <= EDGE * self._shortest:
            return False
        # the old side is asked no further than it is there
        spans = (span for span in (left, *(left - self._slack * 2.0**k for k in range(FURTHER))) if span > 0.0)
        span = next((span for span in spans if self._defined(self._straight_on(span), self._time + span)), 0.0)
        if self._time + span > self._time:
            self._take(self._time + span, self._straight_on(span), self._z, self._work)
        self._event([n])
        return True

    def _defined(self, x: np.ndarray, time: float) -> bool:
        """Whether numbers come out at a point."""
        row = self.system.reduced.row(x[None, :], self._z[None, :], np.array([[time]]), self._p)[0]
        rate = np.asarray(self.system.reduced.rate(x, self._z, time, self._p).full())
        return bool(np.all(np.isfinite(row)) and np.all(np.isfinite(rate)))

    def _straight_on(self, span: float, x: np.ndarray | None = None, time: float | None = None) -> np.ndarray:
        """The states after so short a span [s], from here if left out."""
        x, time = self._x if x is None else x, self._time if time is None else time
        rate = self.system.reduced.rate(x, self._z, time, self._p)
        return x + span * np.asarray(rate.full()).reshape(-1)

    def _on_new_side(
        self, restart: Callable[[np.ndarray, float], Restarted], point: np.ndarray
    ) -> tuple[float, Restarted]:
        """What a restart at this point gives, and its time: where no numbers come out of the new side by round-off, as
        of the root of -1e-17, so much later that they do."""
        try:
            return self._time, restart(point, self._time)
        except Ended:
            after = self._grid[np.searchsorted(self._grid, self._time, side="right") :]
            for k in range(0 if self._z.size else FURTHER):
                span = self._slack * 2.0**k
                time = float(self._time + span)
                if after.size and time >= after[0]:
                    break
                x = self._straight_on(span)
                there = self._points(x[None, :], self._z[None, :], np.array([time]))[0]
                with suppress(Ended, ModelError):
                    return time, restart(there, time)
            raise
