"""Numeric actions of gt.when and sampled blocks, and transfer of values through an event."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ...compiler.alias import AliasResult
from ...compiler.analysis.events import BlockSignal, FlatBlock, FlatEvents, block_numbers
from ...compiler.analysis.switching import acting_together, keys_of, names_of, values_of
from ...compiler.flat import FlatModel
from ...lang.slips import floats, line_of, persons_code
from ...lang.source import ModelError
from ...results.status import SolveStatus
from ...results.trajectory import Trajectory
from ..judgement import Ended
from ..systems import SimulatedSystem
from .clock import exact

Pair = tuple[int, int]


class ValuesIn:
    """Values of variables' derivatives at a point of a system; NaN for those that the system does not compute."""

    def __init__(self, system: SimulatedSystem, point: np.ndarray) -> None:
        self._alias, self._point = system.plan.alias, point
        self._place = {pair: n for n, pair in enumerate(system.plan.pairs)}

    def __call__(self, pair: Pair) -> float:
        sign, index, order = self._alias.resolve(*pair)
        place = self._place.get((index, order))
        return np.nan if place is None else sign * float(self._point[place])


def carried_over(
    pairs: Iterable[Pair], alias: AliasResult, value: ValuesIn, before: Sequence[Pair], after: Sequence[Pair]
) -> np.ndarray:
    """Return the values of a system's quantities after an event, from those before it. A quantity takes the value of an
    alias that was continuous `before`, else of one that is continuous `after`, else of its representative, else 0."""
    sources = [names_of(continuous, alias) for continuous in (before, after)]
    numbers: list[float] = []
    for pair in pairs:
        names = [*(name for source in sources for name in source.get(pair, ())), pair]
        candidates = (alias.resolve(*name)[0] * number for name in names if np.isfinite(number := value(name)))
        numbers.append(next(candidates, 0.0))
    return np.array(numbers)


def read_by(events: FlatEvents, flat: FlatModel) -> list[Pair]:
    """Return the derivatives of continuous variables that actions and sampled blocks read."""
    expressions = [x for w in events.whens for x in values_of(w)]
    pairs = set(flat.scope.symbols_in(ca.vertcat(*expressions))) if expressions else set()
    pairs |= {pair for w in events.whens for pair, _ in w.reinits}
    pairs |= {(i, 0) for b in events.blocks for s in b.inputs for i in s.places}
    return sorted(pairs)


@dataclass
class Changes:
    """Changes by the events of one instant: discrete values by place in `flat.p`, reinitialised variables, the forces
    whose impulses reinitialise them, and the declared energy loss [J], None if not declared."""

    discrete: dict[int, float] = field(default_factory=dict)
    restarted: dict[Pair, float] = field(default_factory=dict)
    forces: dict[Pair, Pair] = field(default_factory=dict)
    loss: float | None = None


class Actions:
    """The actions of all events of a model as numeric functions."""

    def __init__(self, flat: FlatModel, events: FlatEvents, pairs: Sequence[Pair]) -> None:
        self._flat, self._events = flat, events
        self._symbols = [flat.scope.symbol(*pair) for pair in pairs]
        self._modes = ca.vertcat(*[m.symbol for m in events.modes]) if events.modes else ca.SX(0, 1)
        self._functions: dict[tuple[int, ...], ca.Function] = {}

    @cached_property
    def _arguments(self) -> list[ca.SX]:
        column = ca.vertcat(*self._symbols) if self._symbols else ca.SX(0, 1)
        return [column, self._flat.p, self._events.before, self._modes, self._flat.scope.time]

    def _function(self, fired: tuple[int, ...]) -> ca.Function:
        """Return the function of simultaneous events: new discrete values, reinitialised variables and energy loss of
        each. The values are computed with the new values of all discrete variables."""
        if fired not in self._functions:
            column = acting_together(self._flat, [self._events.whens[n] for n in fired])
            self._functions[fired] = ca.Function("actions", self._arguments, [ca.densify(column)])
        return self._functions[fired]

    def __call__(
        self, fired: Sequence[int], values: np.ndarray, p: np.ndarray, modes: Sequence[bool], time: float
    ) -> Changes:
        """Return the changes by simultaneous events, given by number, at a point.

        Raises ModelError if two of them set a variable to different values, and Ended if a value is not finite.
        """
        before = p[self._events.discrete]
        results = self._function(tuple(fired))(values, p, before, np.array(modes, float), time)
        numbers = iter(np.asarray(results).reshape(-1).tolist())
        changes, setters = Changes(), {}
        for n in fired:
            when = self._events.whens[n]
            for key, number in zip(keys_of(when), numbers, strict=False):
                values_set: dict[Any, float] = changes.restarted if isinstance(key, tuple) else changes.discrete
                name = self.name_of(key)
                if not np.isfinite(number):
                    sentence = f"{when.name} gives '{name}' no finite value at {time:.6g} s ({when.where})"
                    raise Ended(SolveStatus.FAILED, sentence)
                if key in setters and values_set[key] != number:
                    first = setters[key]
                    raise ModelError(
                        f"at {time:.6g} s {first.name} ({first.where}) and {when.name} both set '{name}', to "
                        f"{values_set[key]:g} and {number:g}; let only one of them set it",
                        when.where,
                    )
                setters[key], values_set[key] = when, number
            changes.forces |= when.forces
            if when.loss is not None:
                changes.loss = (changes.loss or 0.0) + next(numbers)
        return changes

    def name_of(self, key: int | Pair) -> str:
        """Return the name of a place in `flat.p` or of a variable's derivative."""
        return self._flat.symbol_name(*key) if isinstance(key, tuple) else self._flat.parameters[key].name


class RunningBlock:
    """A sampled block in one run, with its parameter values; `period`, `offset` and `delay` are exact [s]."""

    def __init__(self, block: FlatBlock, flat: FlatModel, p: np.ndarray) -> None:
        self.block, self.name = block, block.name
        numbers = ca.Function("times", [flat.p], [ca.vertcat(block.period, block.offset, block.delay)])(p)
        times = np.asarray(numbers).reshape(-1).tolist()
        for value, what in zip(times, ("period", "offset", "delay"), strict=True):
            kind = "positive" if what == "period" else "nonnegative"
            if not (np.isfinite(value) and (value > 0 if what == "period" else value >= 0)):
                raise ModelError(f"the {what} of sampled block '{self.name}' is {value:g} s; give a {kind} number")
        self.period, self.offset, self.delay = map(exact, times)
        self._view = block_numbers(block.model, flat, p)
        self._signals = {s.name: s for s in (*block.outputs, *block.state)}
        self._times: list[float] = []
        self._rows: list[np.ndarray] = []

    def first(self, start: float) -> Fraction:
        """Return the first sample at or after a time."""
        begin = exact(start)
        steps = max(Fraction(0), (begin - self.offset) / self.period)
        return self.offset + -(-steps.numerator // steps.denominator) * self.period

    def step(self, time: float, inputs: np.ndarray, p: np.ndarray) -> dict[int, float]:
        """Call step() and return the new values by place in `flat.p`. inputs: entries in order; p: holds the state.

        Raises ModelError if step() returns an undeclared name or a wrong shape, and Ended if a value is not finite, as
        in a control loop that diverges.
        """
        arguments, column = {}, 0
        for s in self.block.inputs:
            arguments[s.name] = _shaped(s, inputs[column : column + len(s.places)])
            column += len(s.places)
        state = {s.name: _shaped(s, p[s.places]) for s in (*self.block.state, *self.block.outputs)}
        cls = type(self.block.model)
        with persons_code(f"step() of {cls.__name__} at {time:.6g} s", cls.step):
            result = self._view.step(SimpleNamespace(**arguments), SimpleNamespace(**state))
        where = line_of(cls.step)
        if not isinstance(result, Mapping):
            raise ModelError(
                f"step() of {cls.__name__} must return a dictionary by name; found {type(result).__name__}", where
            )
        values: dict[int, float] = {}
        for name, value in result.items():
            signal = self._signals.get(name)
            if signal is None:
                declared = ", ".join(self._signals)
                raise ModelError(
                    f"step() of {cls.__name__} returns '{name}', which is not declared; expected {declared}", where
                )
            try:
                array = floats(value)
            except (TypeError, ValueError):
                raise ModelError(
                    f"step() of {cls.__name__} gives '{name}' = {value!r}, which is not a number", where
                ) from None
            if array.size != len(signal.places):
                raise ModelError(
                    f"step() of {cls.__name__} gives '{name}' the shape {array.shape}; expected {signal.shape}", where
                )
            if not np.all(np.isfinite(array)):
                sentence = f"step() of {cls.__name__} gives '{name}' = {value} at {time:.6g} s: not finite"
                raise Ended(SolveStatus.FAILED, sentence)
            values |= dict(zip(signal.places, array.reshape(-1).tolist(), strict=True))
        outputs = [values.get(place, float(p[place])) for s in self.block.outputs for place in s.places]
        self._times.append(time)
        self._rows.append(np.concatenate([inputs, outputs]))
        return values

    @property
    def count(self) -> int:
        """Number of samples so far."""
        return len(self._times)

    @property
    def trajectory(self) -> Trajectory:
        """Inputs at the samples, and the outputs computed from them."""
        signals = (*self.block.inputs, *self.block.outputs)
        size = sum(len(s.places) for s in signals)
        table = np.array(self._rows).reshape(len(self._rows), size)
        values, units, column = {}, {}, 0
        for s in signals:
            columns = table[:, column : column + len(s.places)]
            column += len(s.places)
            by_name = {s.name: columns if s.shape else columns[:, 0]}
            if len(s.shape) > 1:
                indices = enumerate(np.ndindex(s.shape))
                by_name = {f"{s.name}[{','.join(map(str, k))}]": columns[:, n] for n, k in indices}
            values |= by_name
            units |= dict.fromkeys(by_name, s.unit) if s.unit else {}
        return Trajectory(np.array(self._times), values, units, title=self.name)


def _shaped(signal: BlockSignal, values: np.ndarray) -> Any:
    return float(values[0]) if not signal.shape else values.reshape(signal.shape).copy()
