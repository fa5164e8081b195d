"""What gt.when does, in symbols: the new values of what acts together at one instant."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from ...lang.source import ModelError
from ..flat import FlatModel
from .events import FlatWhen, Pair


def keys_of(when: FlatWhen) -> list[int | Pair]:
    """What an event gives new values: places in `flat.p`, derivatives of variables."""
    return [*(place for place, _ in when.assigns), *(pair for pair, _ in when.reinits)]


def values_of(when: FlatWhen) -> list[ca.SX]:
    """The new values, as many as keys, and behind them the energy that it takes where that is said."""
    loss = [] if when.loss is None else [when.loss]
    return [*(x for _, x in when.assigns), *(x for _, x in when.reinits), *loss]


def acting_together(flat: FlatModel, whens: Sequence[FlatWhen]) -> ca.SX:
    """The values of all of them as one column, in which the new values of discrete variables that any of them sets
    stand for these variables; what they were before stands under `FlatEvents.before`.

    Raises ModelError where new values depend on each other in a loop.
    """
    column = ca.SX(ca.vertcat(*[x for w in whens for x in values_of(w)]))
    new: dict[int, ca.SX] = {}
    for when in whens:
        for place, value in when.assigns:
            new.setdefault(place, value)
    symbols = {place: flat.parameters[place].symbol for place in new}
    # each substitution settles one link of a chain
    for _ in new:
        column = ca.substitute(column, ca.vertcat(*symbols.values()), ca.vertcat(*new.values()))
    if new and ca.depends_on(column, ca.vertcat(*symbols.values())):
        names = ", ".join(str(s) for s in symbols.values())
        raise ModelError(
            f"the new values of {names} depend on each other in a loop of events; write gt.pre(...) where the value "
            "before the event is meant",
            whens[-1].where,
        )
    return column
