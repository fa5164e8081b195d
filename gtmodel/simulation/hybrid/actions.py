"""What gt.when does, on numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ...compiler.analysis.event_actions import acting_together, keys_of, values_of
from ...compiler.analysis.events import FlatEvents
from ...compiler.flat import FlatModel
from ...lang.source import ModelError
from ...results.status import SolveStatus
from ..ending import Ended

Pair = tuple[int, int]


def read_by(events: FlatEvents, flat: FlatModel) -> list[Pair]:
    """What actions and sampled blocks read of the continuous variables."""
    expressions = [x for w in events.whens for x in values_of(w)]
    pairs = set(flat.scope.symbols_in(ca.vertcat(*expressions))) if expressions else set()
    pairs |= {pair for w in events.whens for pair, _ in w.reinits}
    pairs |= {(i, 0) for b in events.blocks for s in b.inputs for i in s.places}
    return sorted(pairs)


@dataclass
class Changes:
    """What events at one instant ask for: places in `flat.p`, variables that start anew, by which forces' impulses;
    energy [J] that goes, None where nobody says."""

    discrete: dict[int, float] = field(default_factory=dict)
    restarted: dict[Pair, float] = field(default_factory=dict)
    forces: dict[Pair, Pair] = field(default_factory=dict)
    loss: float | None = None


class Actions:
    """The actions of all events of a model as functions of numbers."""

    def __init__(self, flat: FlatModel, events: FlatEvents, pairs: Sequence[Pair]) -> None:
        self._flat, self._events = flat, events
        self._symbols = [flat.scope.symbol(*pair) for pair in pairs]
        self._modes = ca.vertcat(*[m.symbol for m in events.modes]) if events.modes else ca.SX(0, 1)
        self._made: dict[tuple[int, ...], ca.Function] = {}

    @cached_property
    def _arguments(self) -> list[ca.SX]:
        column = ca.vertcat(*self._symbols) if self._symbols else ca.SX(0, 1)
        return [column, self._flat.p, self._events.before, self._modes, self._flat.scope.time]

    def _function(self, fired: tuple[int, ...]) -> ca.Function:
        """Of events that happen together: new values of each one's discrete variables, of what starts anew, its loss.
        Values read the new ones of discrete variables that any of them sets."""
        if fired not in self._made:
            column = acting_together(self._flat, [self._events.whens[n] for n in fired])
            self._made[fired] = ca.Function("actions", self._arguments, [ca.densify(column)])
        return self._made[fired]

    def __call__(
        self, fired: Sequence[int], values: np.ndarray, p: np.ndarray, modes: Sequence[bool], time: float
    ) -> Changes:
        """What the events of these numbers do together at a point.

        Raises ModelError where two of them give one variable different values, and Ended where one is not finite.
        """
        before = p[self._events.discrete]
        results = self._function(tuple(fired))(values, p, before, np.array(modes, float), time)
        numbers = iter(np.asarray(results).reshape(-1).tolist())
        changes, owner = Changes(), {}
        for n in fired:
            when = self._events.whens[n]
            for key, number in zip(keys_of(when), numbers, strict=False):
                taken: dict[Any, float] = changes.restarted if isinstance(key, tuple) else changes.discrete
                name = self.name_of(key)
                if not np.isfinite(number):
                    sentence = f"{when.name} gives '{name}' no finite value at {time:.6g} s ({when.where})"
                    raise Ended(SolveStatus.FAILED, sentence)
                if key in owner and taken[key] != number:
                    first = owner[key]
                    raise ModelError(
                        f"at {time:.6g} s {first.name} ({first.where}) and {when.name} both set '{name}', to "
                        f"{taken[key]:g} and {number:g}; let one of them decide",
                        when.where,
                    )
                owner[key], taken[key] = when, number
            changes.forces |= when.forces
            if when.loss is not None:
                changes.loss = (changes.loss or 0.0) + next(numbers)
        return changes

    def name_of(self, key: int | Pair) -> str:
        """Of a place in `flat.p` or of a variable's derivative."""
        return self._flat.symbol_name(*key) if isinstance(key, tuple) else self._flat.parameters[key].name
