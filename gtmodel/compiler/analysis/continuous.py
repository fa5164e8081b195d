"""What goes on as it was where the equations change: of names for one quantity, those that the model differentiates."""

from __future__ import annotations

from collections.abc import Iterable

from ..alias import AliasResult
from ..flat import FlatModel

Pair = tuple[int, int]


def differentiated(flat: FlatModel) -> list[Pair]:
    """The variables' derivatives whose own derivative stands in an equation of a model in one mode: these are
    continuous. Another name of such a quantity is not, where an equation of another mode gives it to something else."""
    if "differentiated" not in flat.cache:
        highest: dict[int, int] = {}
        for pairs in flat.scope.symbols_in_each([e.residual for e in flat.equations]):
            for index, order in pairs:
                highest[index] = max(highest.get(index, 0), order)
        flat.cache["differentiated"] = [(i, k) for i in sorted(highest) for k in range(highest[i])]
    return flat.cache["differentiated"]


def names_of(continuous: Iterable[Pair], alias: AliasResult) -> dict[Pair, list[Pair]]:
    """Those of the continuous quantities that stand for each kept one, its own name first."""
    names: dict[Pair, list[Pair]] = {}
    for pair in continuous:
        names.setdefault(alias.resolve(*pair)[1:], []).append(pair)
    return {kept: sorted(own, key=lambda pair: pair != kept) for kept, own in names.items()}
