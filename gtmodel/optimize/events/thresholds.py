"""Thresholds in the conditions of a model with events, and the threshold each condition waits for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...compiler.analysis.events import FlatEvents, Logic
from ...compiler.analysis.switching import comparisons_in
from ...compiler.flat import FlatModel
from ...lang.source import ModelError, SourceLocation

# random points at which equal comparisons agree to rounding
PLACES, ROUND_OFF = 4, 1e-12
Truth = Callable[[int], bool | None]


@dataclass(frozen=True)
class Waits:
    """A condition that is true on one side of a threshold: 1 if its quantity is positive there, -1 if negative."""

    threshold: int
    side: int


class Thresholds:
    """The comparisons of a model grouped by threshold: `x >= 1` and `x < 1` share the threshold x - 1.

    of: for each comparison, the number of its threshold and the side on which it is true.
    expressions: of the thresholds, zero at the threshold. discrete(): whether a threshold changes at events only.
    """

    def __init__(self, flat: FlatModel, events: FlatEvents) -> None:
        self._flat, self._events = flat, events
        self.of: list[tuple[int, int]] = []
        self.first: list[int] = []
        column = ca.SX(ca.vertcat(*[c.expression for c in events.comparisons])) if events.comparisons else ca.SX(0, 1)
        symbols = ca.vertcat(*ca.symvar(column)) if ca.symvar(column) else ca.SX(0, 1)
        f = ca.Function("compared", [symbols], [ca.densify(column)])
        places = np.random.default_rng(0).uniform(0.5, 1.5, (PLACES, symbols.numel()))
        values = np.array([np.asarray(f(place)).reshape(-1) for place in places]).reshape(PLACES, -1).T
        for n, value in enumerate(values):
            for number, first in enumerate(self.first):
                sign = next((s for s in (1, -1) if _same(value, s * values[first])), 0)
                if sign and events.comparisons[first].discrete == events.comparisons[n].discrete:
                    self.of.append((number, sign))
                    break
            else:
                self.of.append((len(self.first), 1))
                self.first.append(n)

    @property
    def expressions(self) -> list[ca.SX]:
        return [self._events.comparisons[n].expression for n in self.first]

    def discrete(self, threshold: int) -> bool:
        return self._events.comparisons[self.first[threshold]].discrete

    def text(self, threshold: int) -> str:
        """Return the comparison in the source with its line."""
        c = self._events.comparisons[self.first[threshold]]
        return f"{c.text} ({c.where})"

    def discrete_truth(self, numbers: Mapping[int, float | None]) -> Truth:
        """Return the truth of discrete comparisons for values of discrete variables; None for all other comparisons.

        Raises ModelError for a discrete comparison that depends on optimised quantities.
        """
        flat = self._flat
        unknown = {flat.parameters[n].symbol.element_hash() for n, v in numbers.items() if v is None}
        unknown |= {q.symbol.element_hash() for q in flat.parameters if q.free}
        p = flat.p0
        for n, value in numbers.items():
            p[n] = np.nan if value is None else value
        truth: dict[int, bool] = {}
        for n, c in enumerate(self._events.comparisons):
            if not c.discrete:
                continue
            if any(s.element_hash() in unknown for s in ca.symvar(c.expression)):
                raise ModelError(
                    f"'{c.text}' makes an event depend on optimised quantities; give it numbers, or use gt.Phases "
                    "directly",
                    c.where,
                )
            value = float(ca.Function("value", [flat.p], [c.expression])(p))
            truth[n] = value > 0 if c.strict else value >= 0
        return truth.get

    def waits(self, logic: Logic, truth: Truth, where: SourceLocation) -> Waits | bool:
        """Return the threshold that a condition waits for, or its truth if it depends on discrete variables only.

        Raises ModelError for a condition on several continuous quantities.
        """
        moving = sorted({self.of[n][0] for n in _deciding(logic, truth)})
        if len(moving) > 1:
            texts = " and ".join(self._events.comparisons[self.first[t]].text for t in moving)
            raise ModelError(
                f"a condition combines {texts}, which vary independently, so the order of events does not determine "
                "which of them switches it; compare one continuous quantity per gt.when or gt.If, or use gt.Phases "
                "directly",
                where,
            )
        if not moving:
            return bool(decided(logic, truth))
        positive, negative = (decided(logic, self.sided(truth, {moving[0]: side})) for side in (1, -1))
        assert positive is not None
        assert negative is not None
        return positive if positive == negative else Waits(moving[0], 1 if positive else -1)

    def sided(self, truth: Truth, sides: Mapping[int, int]) -> Truth:
        """Extend a truth by comparisons whose thresholds have a known side."""

        def value(n: int) -> bool | None:
            threshold, sign = self.of[n]
            return truth(n) if threshold not in sides else sign * sides[threshold] > 0

        return value


def decided(logic: Logic, truth: Truth) -> bool | None:
    """Return whether a condition is true; None if the known comparisons do not decide it."""
    operation, *parts = logic
    if operation == "atom":
        return truth(parts[0])
    values = [decided(part, truth) for part in parts]
    if operation == "not":
        return None if values[0] is None else not values[0]
    if operation == "and":
        return False if False in values else None if None in values else True
    return True if True in values else None if None in values else False


def _deciding(logic: Logic, truth: Truth) -> Sequence[int]:
    """Return the numbers of the comparisons that a condition still depends on."""
    if decided(logic, truth) is not None:
        return []
    if logic[0] == "atom":
        return comparisons_in(logic)
    return [n for part in logic[1:] for n in _deciding(part, truth)]


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    size = np.max(np.abs([a, b]), initial=0.0)
    return bool(np.all(np.isfinite(a)) and np.max(np.abs(a - b), initial=0.0) <= ROUND_OFF * size)
