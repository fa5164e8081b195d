"""What the conditions of a model with events compare, and what each waits for while discrete variables are known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...compiler.analysis.events import FlatEvents, Logic
from ...compiler.analysis.switching import comparisons_in
from ...compiler.flat import FlatModel
from ...lang.source import ModelError, SourceLocation

# places at which two comparisons that are one agree to round-off
PLACES, ROUND_OFF = 4, 1e-12
Truth = Callable[[int], bool | None]


@dataclass(frozen=True)
class Waits:
    """A condition that is true on one side of a threshold: 1 where its quantity is positive, -1 where negative."""

    threshold: int
    side: int


class Thresholds:
    """The comparisons of a model by what they compare: `x >= 1` and `x < 1` have one threshold, x - 1.

    of: for each comparison the number of its threshold, and the side of it on which it is true.
    expressions: of the thresholds; zero there. discrete: of those that change at events only, None.
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
        for n, own in enumerate(values):
            for number, known in enumerate(self.first):
                sign = next((s for s in (1, -1) if _same(own, s * values[known])), 0)
                if sign and events.comparisons[known].discrete == events.comparisons[n].discrete:
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
        """The comparison as it was written, with its line."""
        c = self._events.comparisons[self.first[threshold]]
        return f"{c.text} ({c.where})"

    def discrete_truth(self, numbers: Mapping[int, float | None]) -> Truth:
        """Of comparisons that change at events only, by the values of discrete variables; None for all others.

        Raises ModelError for one that what the optimisation chooses decides on.
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
                    f"'{c.text}' decides on an event by what the optimisation chooses; give it numbers, or write the "
                    "phases yourself as gt.Phases",
                    c.where,
                )
            value = float(ca.Function("value", [flat.p], [c.expression])(p))
            truth[n] = value > 0 if c.strict else value >= 0
        return truth.get

    def waits(self, logic: Logic, truth: Truth, where: SourceLocation) -> Waits | bool:
        """What a condition waits for where discrete variables are known, or whether it is true or false whatever moves.

        Raises ModelError for one that several moving quantities decide on.
        """
        moving = sorted({self.of[n][0] for n in _deciding(logic, truth)})
        if len(moving) > 1:
            texts = " and ".join(self._events.comparisons[self.first[t]].text for t in moving)
            raise ModelError(
                f"a condition of {texts} joins what moves independently, and the order of events does not say which of "
                "them changes it: one gt.when or gt.If compares one moving quantity; or write gt.Phases yourself",
                where,
            )
        if not moving:
            return bool(decided(logic, truth))
        positive, negative = (decided(logic, self.sided(truth, {moving[0]: side})) for side in (1, -1))
        assert positive is not None
        assert negative is not None
        return positive if positive == negative else Waits(moving[0], 1 if positive else -1)

    def sided(self, truth: Truth, sides: Mapping[int, int]) -> Truth:
        """Also of comparisons whose thresholds' sides are known."""

        def value(n: int) -> bool | None:
            threshold, sign = self.of[n]
            return truth(n) if threshold not in sides else sign * sides[threshold] > 0

        return value


def decided(logic: Logic, truth: Truth) -> bool | None:
    """Whether a condition is true; None where what is known does not tell."""
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
    """Numbers of the comparisons that a condition still depends on."""
    if decided(logic, truth) is not None:
        return []
    if logic[0] == "atom":
        return comparisons_in(logic)
    return [n for part in logic[1:] for n in _deciding(part, truth)]


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    size = np.max(np.abs([a, b]), initial=0.0)
    return bool(np.all(np.isfinite(a)) and np.max(np.abs(a - b), initial=0.0) <= ROUND_OFF * size)
