"""The sides of comparisons at one instant, the modes that agree with them, and switches at which one side ends."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from contextlib import suppress
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compiler.analysis.events import Logic, holds
from ...compiler.flat import FlatModel
from ...lang.source import ModelError
from ...results.status import SolveStatus
from ..judgement import Ended
from ..systems import SimulatedSystem
from .actions import Changes
from .clock import Event
from .comparisons import WatchedIntegration

# rates that would move a comparison by less than ZERO of its size in this part of the run do not decide on its side
SLOW = 1e-6
# different comparisons of one instant whose sides are looked for together
MOST_TOGETHER = 10
# what an event changes beside rows and books, put back where its rounds do not settle
CHANGED = ("truth", "held", "system", "audit", "_time", "_x", "_z", "_p", "_systems", "_values", "_pace", "_calls",
           "_audited", "_broken")  # fmt: skip


class Unsettled(Ended):
    """Events of one instant call each other for ever."""


class SidesAtInstant(WatchedIntegration):
    """Where a simulation is at an instant at which something changes."""

    if TYPE_CHECKING:
        _flat: FlatModel
        _values: tuple[bool, ...]

        def _restart(self, values: tuple[bool, ...], changes: Changes) -> dict[str, float]: ...
        def _straight_on(self, span: float) -> np.ndarray: ...

    def _kept(self) -> dict[str, Any]:
        """What the rounds of an event change."""
        return {name: getattr(self, name) for name in CHANGED} | {"parameters": dict(self._inputs.parameters)}

    def _put_back(self, kept: dict[str, Any]) -> None:
        for name in CHANGED:
            setattr(self, name, kept[name])
        self._inputs.parameters.update(kept["parameters"])

    def _agreeing(self, jumped: Sequence[int], zero: np.ndarray, anew: np.ndarray) -> tuple[bool, ...] | None:
        """Modes that their own comparisons lead to, looked for among the sides of those that jumped; None without any.

        A mode may set the force that decides on it, as dry friction does: then going from mode to mode ends nowhere,
        and the sides are unknowns of the instant's equations. All of them false, which is where nothing breaks away,
        is tried first. What jumped and reads the same has one side; what decides on no mode, whatever the others are,
        as the torque of another clutch that slides on, is none of them.
        """
        groups: dict[str, list[int]] = {}
        free = {n for n in jumped if self._flat.scope.symbols_in(self._declared.comparisons[n].expression)}
        logics = (_deciding(m.logic, self.truth, free) for m in self._declared.modes)
        for n in sorted(set[int]().union(*(decide for decide in logics if isinstance(decide, set)))):
            c = self._declared.comparisons[n]
            groups.setdefault(f"{c.expression} {c.strict}", []).append(n)
        if not groups or len(groups) > MOST_TOGETHER:
            return None
        begin, tried = self._kept(), set[tuple[bool, ...]]()
        for choice in product((False, True), repeat=len(groups)):
            truth = begin["truth"].copy()
            for numbers, side in zip(groups.values(), choice, strict=True):
                truth[numbers] = side
            values = tuple(holds(m.logic, truth) for m in self._declared.modes)
            if values in tried:
                continue
            tried.add(values)
            try:
                self._restart(values, Changes())
                self.truth = truth
                reached, _ = self._sides((), zero, self._compared(), anew)
                agrees = values == tuple(holds(m.logic, reached) for m in self._declared.modes)
            except (Ended, ModelError):
                agrees = False
            self._put_back(begin)
            if agrees:
                self.truth = truth
                return values
        return None

    def _sides(
        self, forced: Sequence[int], zero: np.ndarray, was: np.ndarray, anew: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Truth of the comparisons from now on, and their values: by these, at zero by their rates, where these are
        zero too by those a moment later. Where nothing shows it, what jumped to zero from the values that there `was`
        or was set there `anew` is equal there, and what else is there is as it was."""
        if not self._declared.comparisons:
            return self.truth, was
        values, rates = (a[0] for a in self._comparisons(self._x[None, :], self._z[None, :], np.array([self._time])))
        self._largest = np.maximum(self._largest, np.abs(values))
        slow = self._slow(zero)
        # what the rate makes up for within one instant is of the instant: a mode may show it a million times larger
        zero = np.maximum(zero, np.abs(rates) * self._slack)
        near = np.abs(values) <= zero
        near[list(forced)] = False
        if near.any() and not self._z.size:
            moment, later = self._rates_later()
            # a rate that moves nothing beyond round-off is round-off
            still = np.abs(rates) * moment <= zero
            rates = np.where(near & still & (np.abs(later) > 2 * np.abs(rates)), later, rates)
        before = np.where(near & (anew | (np.abs(values - was) > zero)), self._modes.at_equality, self.truth)
        truth = self._modes.sides(values, rates, zero, slow, before)
        for n in forced:
            truth[n] = not self.truth[n]
        return truth, values

    def _slow(self, zero: np.ndarray) -> np.ndarray:
        """Rates of the comparisons that do not decide on a side, where nearer to 0 than `zero` no value does."""
        return zero / (SLOW * (self._end - self._begin))

    def _compared_anew(self, changes: Changes) -> np.ndarray:
        """Which comparisons read what starts anew."""
        resolve = self.system.plan.alias.resolve
        states = {resolve(*pair)[1:] for pair in changes.restarted}
        read = [self._flat.scope.symbols_in(c.expression) if states else () for c in self._declared.comparisons]
        return np.array([any(resolve(*pair)[1:] in states for pair in pairs) for pairs in read], dtype=bool)

    def _rates_later(self) -> tuple[float, np.ndarray]:
        """A moment [s], and rates of the comparisons then: a force that grows through what friction holds accelerates
        by nothing at the instant itself."""
        moment = min(SLOW * (self._end - self._begin), self._stepper.likely / 100)
        x = self._straight_on(moment)
        return moment, self._comparisons(x[None, :], self._z[None, :], np.array([self._time + moment]))[1][0]

    def _left_over(self) -> np.ndarray:
        """Of each comparison twice by how much its value is still on the side that it leaves; else 0."""
        return 2 * np.maximum(-self._compared() * self._signs(), 0.0)

    def _unsettled(self, causes: list[str]) -> Unsettled:
        shown = "; ".join(causes[-4:])
        # a sign() that switches is the law of dry friction
        between = ", as stuck is between two directions of sliding" if "sign()" in shown else ""
        return Unsettled(
            SolveStatus.FAILED,
            f"at {self._time:.6g} s events never settle: {shown} call each other for ever; where both sides of a "
            f"switch push back to it, give it a hysteresis, or a mode of its own in between{between}",
        )


def _deciding(logic: Logic, truth: np.ndarray, free: Container[int]) -> bool | set[int]:
    """Whether a condition is true where its comparisons are; the numbers of those that decide on it where that depends
    on what is free."""
    operation, *parts = logic
    if operation == "atom":
        return {parts[0]} if parts[0] in free else bool(truth[parts[0]])
    if operation == "sample":
        return False
    made = [_deciding(part, truth, free) for part in parts]
    if operation == "not":
        return made[0] if isinstance(made[0], set) else not made[0]
    alone = operation == "or"  # what one part alone makes of it
    if any(part is alone for part in made):
        return alone
    return set[int]().union(*(part for part in made if isinstance(part, set))) or not alone


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
