"""Sampled blocks on numbers: what they read, their step, what they give."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ...compiler.analysis.events import BlockSignal, FlatBlock, block_numbers
from ...compiler.flat import FlatModel
from ...lang.slips import floats, line_of, persons_code
from ...lang.source import ModelError
from ...results.status import SolveStatus
from ...results.trajectory import Trajectory
from ..ending import Ended
from .clock import exact


class RunningBlock:
    """A block in one run, with the numbers of its parameters: `period`, `offset` and `delay` are exact [s]."""

    def __init__(self, block: FlatBlock, flat: FlatModel, p: np.ndarray) -> None:
        self.block, self.name = block, block.name
        numbers = ca.Function("times", [flat.p], [ca.vertcat(block.period, block.offset, block.delay)])(p)
        times = np.asarray(numbers).reshape(-1).tolist()
        for value, what in zip(times, ("period", "offset", "delay"), strict=True):
            if not (np.isfinite(value) and (value > 0 if what == "period" else value >= 0)):
                raise ModelError(f"the {what} of sampled block '{self.name}' is {value:g} s; give a positive number")
        self.period, self.offset, self.delay = map(exact, times)
        self._view = block_numbers(block.model, flat, p)
        self._own = {s.name: s for s in (*block.outputs, *block.state)}
        self._times: list[float] = []
        self._rows: list[np.ndarray] = []

    def first(self, start: float) -> Fraction:
        """Its first sample at or after a time."""
        begin = exact(start)
        steps = max(Fraction(0), (begin - self.offset) / self.period)
        return self.offset + -(-steps.numerator // steps.denominator) * self.period

    def step(self, time: float, inputs: np.ndarray, p: np.ndarray) -> dict[int, float]:
        """New values by places in `flat.p`, from the inputs' entries in order and the state in `p`.

        Raises ModelError for what its step gives that is not declared or of another shape, and Ended for what is not
        finite, as of a loop that diverges.
        """
        given, column = {}, 0
        for s in self.block.inputs:
            given[s.name] = _shaped(s, inputs[column : column + len(s.places)])
            column += len(s.places)
        state = {s.name: _shaped(s, p[s.places]) for s in (*self.block.state, *self.block.outputs)}
        cls = type(self.block.model)
        with persons_code(f"step() of {cls.__name__} at {time:.6g} s", cls.step):
            made = self._view.step(SimpleNamespace(**given), SimpleNamespace(**state))
        where = line_of(cls.step)
        if not isinstance(made, Mapping):
            raise ModelError(
                f"step() of {cls.__name__} returns a dictionary by name; found {type(made).__name__}", where
            )
        values: dict[int, float] = {}
        for name, value in made.items():
            signal = self._own.get(name)
            if signal is None:
                own = ", ".join(self._own)
                raise ModelError(
                    f"step() of {cls.__name__} returns '{name}', which it does not declare; it has {own}", where
                )
            try:
                array = floats(value)
            except (TypeError, ValueError):
                raise ModelError(
                    f"step() of {cls.__name__} gives '{name}' = {value!r}, which is no number", where
                ) from None
            if array.size != len(signal.places):
                raise ModelError(
                    f"step() of {cls.__name__} gives '{name}' {array.shape}; expected {signal.shape}", where
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
        """Its samples so far."""
        return len(self._times)

    @property
    def trajectory(self) -> Trajectory:
        """Inputs at its samples, and the outputs computed there."""
        signals = (*self.block.inputs, *self.block.outputs)
        size = sum(len(s.places) for s in signals)
        table = np.array(self._rows).reshape(len(self._rows), size)
        values, units, column = {}, {}, 0
        for s in signals:
            columns = table[:, column : column + len(s.places)]
            column += len(s.places)
            named = {s.name: columns if s.shape else columns[:, 0]}
            if len(s.shape) > 1:
                named = {f"{s.name}[{','.join(map(str, k))}]": columns[:, n] for n, k in enumerate(np.ndindex(s.shape))}
            values |= named
            units |= dict.fromkeys(named, s.unit) if s.unit else {}
        return Trajectory(np.array(self._times), values, units, title=self.name)


def _shaped(signal: BlockSignal, values: np.ndarray) -> Any:
    return float(values[0]) if not signal.shape else values.reshape(signal.shape).copy()
