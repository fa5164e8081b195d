"""The sides of comparisons at one instant, the modes consistent with them, and switches at which equations end."""

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

# a rate that changes a comparison by less than ZERO of its size in this share of the run does not determine its side
SLOW = 1e-6
# largest number of different comparisons of one instant whose sides are searched together
MOST_TOGETHER = 10
# attributes that an event changes, apart from rows and energies; restored if its rounds do not settle
CHANGED = ("truth", "held", "system", "audit", "_time", "_x", "_z", "_p", "_systems", "_values", "_pace", "_calls",
           "_audited", "_broken")  # fmt: skip


class Unsettled(Ended):
    """The events of one instant trigger each other without end."""


class SidesAtInstant(WatchedIntegration):
    """A running simulation at an instant with events."""

    if TYPE_CHECKING:
        _flat: FlatModel
        _values: tuple[bool, ...]

        def _restart(self, values: tuple[bool, ...], changes: Changes) -> dict[str, float]: ...
        def _straight_on(self, span: float) -> np.ndarray: ...

    def _snapshot(self) -> dict[str, Any]:
        """Return all values that the rounds of an event change."""
        return {name: getattr(self, name) for name in CHANGED} | {"parameters": dict(self._inputs.parameters)}

    def _restore(self, snapshot: dict[str, Any]) -> None:
        for name in CHANGED:
            setattr(self, name, snapshot[name])
        self._inputs.parameters.update(snapshot["parameters"])

    def _agreeing(self, jumped: Sequence[int], zero: np.ndarray, reset: np.ndarray) -> tuple[bool, ...] | None:
        """Return modes that are consistent with their own comparisons, searched over the sides of those that jumped;
        None if there are none.

        A mode may determine the force that selects it, as in dry friction. Switching from mode to mode then does not
        settle: the sides are unknowns of the equations at this instant. The search begins with all false, which means
        that nothing breaks away. Comparisons with equal expressions have a common side. Comparisons that cannot affect
        a mode, such as the torque of a clutch that keeps sliding, are left out.
        """
        groups: dict[str, list[int]] = {}
        free = {n for n in jumped if self._flat.scope.symbols_in(self._declared.comparisons[n].expression)}
        logics = (_deciding(m.logic, self.truth, free) for m in self._declared.modes)
        for n in sorted(set[int]().union(*(decide for decide in logics if isinstance(decide, set)))):
            c = self._declared.comparisons[n]
            groups.setdefault(f"{c.expression} {c.strict}", []).append(n)
        if not groups or len(groups) > MOST_TOGETHER:
            return None
        begin, tried = self._snapshot(), set[tuple[bool, ...]]()
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
                reached, _ = self._sides((), zero, self._compared(), reset)
                agrees = values == tuple(holds(m.logic, reached) for m in self._declared.modes)
            except (Ended, ModelError):
                agrees = False
            self._restore(begin)
            if agrees:
                self.truth = truth
                return values
        return None

    def _sides(
        self, forced: Sequence[int], zero: np.ndarray, previous: np.ndarray, reset: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the truth of the comparisons from now on, and their values. Values away from zero determine the side;
        at zero the rates do, and at zero rate the rates a moment later. If none does, a comparison that jumped to zero
        from its value `previous`, or was set to zero `reset`, counts as equality, and any other keeps its side."""
        if not self._declared.comparisons:
            return self.truth, previous
        values, rates = (a[0] for a in self._comparisons(self._x[None, :], self._z[None, :], np.array([self._time])))
        self._largest = np.maximum(self._largest, np.abs(values))
        slow = self._slow(zero)
        # a value that the rate covers within the round-off of time is zero at this instant
        zero = np.maximum(zero, np.abs(rates) * self._slack)
        near = np.abs(values) <= zero
        near[list(forced)] = False
        if near.any() and not self._z.size:
            moment, later = self._rates_later()
            # a rate that does not change the value beyond round-off is round-off
            still = np.abs(rates) * moment <= zero
            rates = np.where(near & still & (np.abs(later) > 2 * np.abs(rates)), later, rates)
        before = np.where(near & (reset | (np.abs(values - previous) > zero)), self._modes.at_equality, self.truth)
        truth = self._modes.sides(values, rates, zero, slow, before)
        for n in forced:
            truth[n] = not self.truth[n]
        return truth, values

    def _slow(self, zero: np.ndarray) -> np.ndarray:
        """Return the rates below which a comparison's side is undetermined, for the limits `zero` of its value."""
        return zero / (SLOW * (self._end - self._begin))

    def _compares_reset(self, changes: Changes) -> np.ndarray:
        """Return which comparisons read reinitialised variables."""
        resolve = self.system.plan.alias.resolve
        states = {resolve(*pair)[1:] for pair in changes.restarted}
        read = [self._flat.scope.symbols_in(c.expression) if states else () for c in self._declared.comparisons]
        return np.array([any(resolve(*pair)[1:] in states for pair in pairs) for pairs in read], dtype=bool)

    def _rates_later(self) -> tuple[float, np.ndarray]:
        """Return a short time [s], and the rates of the comparisons after it. Example: if a growing force just reaches
        the break-away force, the acceleration is still zero."""
        moment = min(SLOW * (self._end - self._begin), self._stepper.likely / 100)
        x = self._straight_on(moment)
        return moment, self._comparisons(x[None, :], self._z[None, :], np.array([self._time + moment]))[1][0]

    def _remainder(self) -> np.ndarray:
        """Return twice the value by which each comparison is still on its previous side, else 0."""
        return 2 * np.maximum(-self._compared() * self._signs(), 0.0)

    def _unsettled(self, causes: list[str]) -> Unsettled:
        shown = "; ".join(causes[-4:])
        # a sign() that switches is the law of dry friction
        between = ", such as a stuck state between two directions of sliding" if "sign()" in shown else ""
        return Unsettled(
            SolveStatus.FAILED,
            f"at {self._time:.6g} s events do not settle: {shown} trigger each other without end; if both sides of a "
            f"switch lead back to it, give it a hysteresis, or add a mode in between{between}",
        )


def _deciding(logic: Logic, truth: np.ndarray, free: Container[int]) -> bool | set[int]:
    """Return the truth of a condition for these comparisons; or, if it depends on `free` comparisons, their numbers."""
    operation, *parts = logic
    if operation == "atom":
        return {parts[0]} if parts[0] in free else bool(truth[parts[0]])
    if operation == "sample":
        return False
    results = [_deciding(part, truth, free) for part in parts]
    if operation == "not":
        return results[0] if isinstance(results[0], set) else not results[0]
    dominant = operation == "or"  # the value of one part that determines the result
    if any(result is dominant for result in results):
        return dominant
    return set[int]().union(*(result for result in results if isinstance(result, set))) or not dominant


Restarted = tuple[SimulatedSystem, np.ndarray, np.ndarray]

# largest distance of a switch that the integrator cannot reach, in shortest intervals: rates extrapolate over it
EDGE = 100.0
# if values at a switch are not finite because of round-off, times at 1, 2, 4, ... times the round-off are tried
FURTHER = 12


class OverEdges(SidesAtInstant):
    """A running simulation that goes over a switch beyond which the equations of the old side are undefined."""

    if TYPE_CHECKING:
        events: list[Event]

        def _event(self, forced: Sequence[int]) -> None: ...

    def _over_failure(self) -> bool:
        """After a failure of the integrator just before such a switch, go over it; return whether that succeeds."""
        far = self._stepper.far
        if far is None or not self._declared.comparisons:
            return False
        span, x, work = far
        time, no_z = self._time + span, np.zeros((1, 0))
        remaining = self._next_change(x, time)[1]
        beyond = remaining + self._slack * 2.0**FURTHER
        if not remaining <= EDGE * self._shortest or self._defined(self._straight_on(beyond, x, time), time + beyond):
            return False
        count = len(self.events)
        if time > self._time and not self._accept(np.array([time]), x[None, :], no_z, work[None, :]):
            return False
        # an event before the switch comes first
        return len(self.events) > count or self._over_edge()

    def _next_change(self, x: np.ndarray, time: float) -> tuple[int, float]:
        """Return the comparison that changes next according to the rates, and the time [s] until then."""
        values, rates = self._comparisons(x[None, :], self._z[None, :], np.array([time]))
        s, ds = values[0] * self._signs(), rates[0] * self._signs()
        with np.errstate(all="ignore"):
            remaining = np.where(ds < 0, np.maximum(s / -ds, 0.0), np.inf)
        return int(np.argmin(remaining)), float(np.min(remaining))

    def _over_edge(self) -> bool:
        """If a comparison changes within a few shortest intervals, advance to it, handle its event, return True."""
        if not self._declared.comparisons or self._z.size:
            return False
        n, remaining = self._next_change(self._x, self._time)
        if not remaining <= EDGE * self._shortest:
            return False
        # use the equations of the old side only where they are defined
        candidates = (remaining, *(remaining - self._slack * 2.0**k for k in range(FURTHER)))
        spans = (span for span in candidates if span > 0.0)
        span = next((span for span in spans if self._defined(self._straight_on(span), self._time + span)), 0.0)
        if self._time + span > self._time:
            self._take(self._time + span, self._straight_on(span), self._z, self._work)
        self._event([n])
        return True

    def _defined(self, x: np.ndarray, time: float) -> bool:
        """Return whether all values at a point are finite."""
        row = self.system.reduced.row(x[None, :], self._z[None, :], np.array([[time]]), self._p)[0]
        rate = np.asarray(self.system.reduced.rate(x, self._z, time, self._p).full())
        return bool(np.all(np.isfinite(row)) and np.all(np.isfinite(rate)))

    def _straight_on(self, span: float, x: np.ndarray | None = None, time: float | None = None) -> np.ndarray:
        """Extrapolate the states over a short span [s], by default from the present point."""
        x, time = self._x if x is None else x, self._time if time is None else time
        rate = self.system.reduced.rate(x, self._z, time, self._p)
        return x + span * np.asarray(rate.full()).reshape(-1)

    def _on_new_side(
        self, restart: Callable[[np.ndarray, float], Restarted], point: np.ndarray
    ) -> tuple[float, Restarted]:
        """Restart at this point, and return the time and the result. If values on the new side are not finite due to
        round-off, such as the root of -1e-17, restart slightly later."""
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
                later = self._points(x[None, :], self._z[None, :], np.array([time]))[0]
                with suppress(Ended, ModelError):
                    return time, restart(later, time)
            raise
