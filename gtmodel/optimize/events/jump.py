"""What happens at the instant where two phases meet, in symbols of what was before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from ...compiler.analysis.events import FlatEvents, FlatWhen, Pair
from ...compiler.analysis.switching import acting_together, keys_of, values_of
from ...compiler.flat import FlatModel
from ...lang.source import ModelError


@dataclass(frozen=True, eq=False)
class Jump:
    """assigned: new values of discrete variables by their places in `flat.p`; restarted: of variables' derivatives;
    forces: those of them that an impulse brings about. Discrete variables stand for their values before."""

    assigned: dict[int, ca.SX]
    restarted: dict[Pair, ca.SX]
    forces: dict[Pair, Pair]

    @property
    def moves(self) -> bool:
        """Does anything change at once?"""
        return bool(self.assigned or self.restarted)


def jump_of(
    flat: FlatModel, events: FlatEvents, rounds: Sequence[Sequence[int]], modes: Sequence[Sequence[bool]]
) -> Jump:
    """Of events that act one round after the other at one instant; modes: of gt.If in each round, from then on.

    Raises ModelError for two that set the same, and for one that reads what another one has just restarted.
    """
    symbols = {place: flat.parameters[place].symbol for place in events.discrete}
    now: dict[int, ca.SX] = dict(symbols)
    jump = Jump({}, {}, {})
    for fired, sides in zip(rounds, modes, strict=True):
        whens = [events.whens[n] for n in fired]
        column = ca.SX(acting_together(flat, whens))
        if events.modes:
            numbers = ca.DM([float(v) for v in sides])
            column = ca.substitute(column, ca.vertcat(*[m.symbol for m in events.modes]), numbers)
        if events.discrete:
            own = ca.vertcat(*[symbols[place] for place in events.discrete])
            new = ca.vertcat(*[now[place] for place in events.discrete])
            column = ca.substitute(column, ca.vertcat(own, events.before), ca.vertcat(new, new))
        if jump.restarted and flat.scope.symbols_in(column):
            raise ModelError(
                "this event follows from another one at the same instant and reads what that one restarts; join both",
                whens[0].where,
            )
        _take(flat, whens, ca.vertsplit(column) if column.numel() else [], jump)
        now |= jump.assigned
    return jump


def _take(flat: FlatModel, whens: Sequence[FlatWhen], values: Sequence[ca.SX], jump: Jump) -> None:
    """Add what events of one round do."""
    owner: dict[int | Pair, FlatWhen] = {}
    left = list(values)
    for when in whens:
        own, left = left[: len(values_of(when))], left[len(values_of(when)) :]
        for key, value in zip(keys_of(when), own, strict=False):
            taken: dict[int, ca.SX] | dict[Pair, ca.SX] = jump.restarted if isinstance(key, tuple) else jump.assigned
            if key in owner and not ca.is_equal(taken[key], value, 100):  # type: ignore[index]
                name = flat.symbol_name(*key) if isinstance(key, tuple) else flat.parameters[key].name
                raise ModelError(
                    f"{owner[key].name} ({owner[key].where}) and {when.name} both set '{name}' at one instant; let one "
                    "of them decide",
                    when.where,
                )
            owner[key] = when
            taken[key] = value  # type: ignore[index]
        jump.forces.update(when.forces)
