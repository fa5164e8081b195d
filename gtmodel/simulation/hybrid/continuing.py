"""Values that go on through an event."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ...compiler.alias import AliasResult
from ...compiler.analysis.continuous import names_of
from ..systems import SimulatedSystem

Pair = tuple[int, int]


class ValuesIn:
    """Values of any variable's derivative at a point of a system; NaN where the system does not compute it."""

    def __init__(self, system: SimulatedSystem, point: np.ndarray) -> None:
        self._alias, self._point = system.plan.alias, point
        self._place = {pair: n for n, pair in enumerate(system.plan.pairs)}

    def __call__(self, pair: Pair) -> float:
        sign, kept, order = self._alias.resolve(*pair)
        place = self._place.get((kept, order))
        return np.nan if place is None else sign * float(self._point[place])


def carried_over(
    pairs: Iterable[Pair], alias: AliasResult, value: ValuesIn, before: Sequence[Pair], after: Sequence[Pair]
) -> np.ndarray:
    """Values of the quantities of a system after an event, from those before it. A quantity has the value of a name
    that was continuous `before`, else of one that is `after`, else of the name under which it is kept; 0 of none."""
    sources = [names_of(continuous, alias) for continuous in (before, after)]
    numbers: list[float] = []
    for pair in pairs:
        names = [*(name for own in sources for name in own.get(pair, ())), pair]
        known = (alias.resolve(*name)[0] * number for name in names if np.isfinite(number := value(name)))
        numbers.append(next(known, 0.0))
    return np.array(numbers)
