"""Several starts of one search: which optima they end in, when they only repeat, and what a message says of that."""

from __future__ import annotations

from dataclasses import dataclass, field

# costs that differ by a smaller part of them are of one optimum
SAME_COST = 1e-5


def local_optimum(here: int, starts: int) -> str:
    """What is known of an optimum that several starts looked for: no more than where they ended.

    >>> local_optimum(3, 4)
    'local optimum; 3 of 4 starts ended here'
    """
    return f"local optimum; {here} of {starts} starts ended here"


@dataclass
class ReachedOptima:
    """Costs of the optima that starts ended in, one after the other, None for a start that ended in none.

    repeated: how many of the last ones brought no optimum that was not known.

    >>> reached = ReachedOptima()
    >>> for cost in (2.0, None, 1.0, 2.0, 2.0):
    ...     reached.add(cost)
    >>> reached.different, reached.repeated, reached.message(2.0)
    ([1.0, 2.0], 2, 'local optimum; 3 of 5 starts ended here')
    """

    costs: list[float | None] = field(default_factory=list)
    repeated: int = 0

    def add(self, cost: float | None) -> None:
        new = cost is not None and not self.ended_at(cost)
        self.repeated = 0 if new else self.repeated + 1
        self.costs.append(cost)

    def ended_at(self, cost: float) -> int:
        """Number of the starts that ended at this cost."""
        return sum(c is not None and abs(c - cost) <= SAME_COST * max(abs(c), abs(cost)) for c in self.costs)

    @property
    def different(self) -> list[float]:
        """Costs of the different optima, best first."""
        optima: list[float] = []
        for cost in sorted(c for c in self.costs if c is not None):
            if not optima or cost - optima[-1] > SAME_COST * max(abs(cost), abs(optima[-1])):
                optima.append(cost)
        return optima

    def message(self, cost: float) -> str:
        """Of the optimum with this cost; empty after a single start."""
        return local_optimum(self.ended_at(cost), len(self.costs)) if len(self.costs) > 1 else ""
