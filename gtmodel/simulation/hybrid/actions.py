"""What gt.when does, on numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ...compiler.analysis.events import FlatEvents, FlatWhen
from ...compiler.flat import FlatModel
from ...lang.source import ModelError

Pair = tuple[int, int]


def read_by(events: FlatEvents, flat: FlatModel) -> list[Pair]:
    """What actions and sampled blocks read of the continuous variables."""
    expressions = [v for w in events.whens for v in [*(x for _, x in w.assigns), *(x for _, x in w.reinits), *_loss(w)]]
    pairs = set(flat.scope.symbols_in(ca.vertcat(*expressions))) if expressions else set()
    pairs |= {pair for w in events.whens for pair, _ in w.reinits}
    pairs |= {(i, 0) for b in events.blocks for s in b.inputs for i in s.places}
    return sorted(pairs)


def _loss(when: FlatWhen) -> list[ca.SX]:
    return [] if when.loss is None else [when.loss]


@dataclass
class Changes:
    """What events at one instant ask for: places in `flat.p`, variables that start anew, energy [J] that goes."""

    discrete: dict[int, float]
    restarted: dict[Pair, float]
    loss: float | None


class Actions:
    """The actions of all events of a model as functions of numbers."""

    def __init__(self, flat: FlatModel, events: FlatEvents, pairs: Sequence[Pair]) -> None:
        self._flat, self._events = flat, events
        self._symbols = [flat.scope.symbol(*pair) for pair in pairs]
        self._modes = ca.vertcat(*[m.symbol for m in events.modes]) if events.modes else ca.SX(0, 1)
        self._made: dict[int, ca.Function] = {}

    @cached_property
    def _arguments(self) -> list[ca.SX]:
        column = ca.vertcat(*self._symbols) if self._symbols else ca.SX(0, 1)
        return [column, self._flat.p, self._events.before, self._modes, self._flat.scope.time]

    def _function(self, n: int) -> ca.Function:
        """New values of discrete variables one after the other, then of what starts anew, then the loss."""
        if n not in self._made:
            when = self._events.whens[n]
            new = [value for _, value in when.assigns]
            # those that come later read the new values of those before
            for k, (place, _) in enumerate(when.assigns):
                symbol = self._flat.parameters[place].symbol
                new[k + 1 :] = [ca.substitute(v, symbol, new[k]) for v in new[k + 1 :]]
            after = [value for _, value in when.reinits] + _loss(when)
            for (place, _), value in zip(when.assigns, new, strict=True):
                after = [ca.substitute(v, self._flat.parameters[place].symbol, value) for v in after]
            column = ca.densify(ca.vertcat(*new, *after))
            self._made[n] = ca.Function("actions", self._arguments, [column])
        return self._made[n]

    def __call__(
        self, fired: Sequence[int], values: np.ndarray, p: np.ndarray, modes: Sequence[bool], time: float
    ) -> Changes:
        """What the events of these numbers do together at a point.

        Raises ModelError where two of them give one variable different values, or a value is not finite.
        """
        changes = Changes({}, {}, None)
        before = p[self._events.discrete]
        owner: dict[int | Pair, FlatWhen] = {}
        for n in fired:
            when = self._events.whens[n]
            results = self._function(n)(values, p, before, np.array(modes, float), time)
            numbers = np.asarray(results).reshape(-1).tolist()
            count = len(when.assigns)
            keys = [place for place, _ in when.assigns] + [pair for pair, _ in when.reinits]
            for key, number in zip(keys, numbers[: len(keys)], strict=True):
                name = self.name_of(key)
                if not np.isfinite(number):
                    raise ModelError(f"{when.name} gives '{name}' no finite value at {time:.6g} s", when.where)
                if key in owner and self._taken(changes, key) != number:
                    first = owner[key]
                    raise ModelError(
                        f"at {time:.6g} s {first.name} ({first.where}) and {when.name} both set '{name}', to "
                        f"{self._taken(changes, key):g} and {number:g}; let one of them decide",
                        when.where,
                    )
                owner[key] = when
            changes.discrete |= dict(zip([place for place, _ in when.assigns], numbers[:count], strict=True))
            changes.restarted |= dict(zip([pair for pair, _ in when.reinits], numbers[count : len(keys)], strict=True))
            if when.loss is not None:
                changes.loss = (changes.loss or 0.0) + numbers[-1]
        return changes

    @staticmethod
    def _taken(changes: Changes, key: int | Pair) -> float:
        return changes.restarted[key] if isinstance(key, tuple) else changes.discrete[key]

    def name_of(self, key: int | Pair) -> str:
        """Of a place in `flat.p` or of a variable's derivative."""
        return self._flat.symbol_name(*key) if isinstance(key, tuple) else self._flat.parameters[key].name
