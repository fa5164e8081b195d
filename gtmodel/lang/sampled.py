"""Blocks that compute at sample instants: digital controllers, filters, estimators."""

from __future__ import annotations

from typing import Any

from .declare import parameter
from .model import Model
from .source import ModelError


class SampledBlock(Model):
    """A controller or filter that reads its inputs every `period` and computes outputs, which are held until the next.

    A subclass declares inputs (`gt.input`), outputs (`gt.output`), what it remembers (`gt.discrete`) and parameters,
    and writes `step(self, inputs, state)` on numbers: it returns a dictionary of new outputs and new values of what it
    remembers; what it does not name keeps its value. In `step`, `self.kp` is the number of a parameter, `inputs.x` a
    float or an array, `state.integral` what was remembered.

    The block is a part like any other, `gt.part(PI, period=0.004, kp=30.0)`: the enclosing model's equations say what
    its inputs are and use its outputs. Only `gt.simulate` runs it.

    period: time between two samples [s]. offset: of the first one [s]. delay: between a sample and the instant at which
    its outputs are there [s], any part of a period or several of them.

    >>> class PI(gt.SampledBlock):
    ...     kp = gt.parameter(4.0, unit="1/s")
    ...     ki = gt.parameter(2.0, unit="1/s2")
    ...     error = gt.input(unit="m")
    ...     integral = gt.discrete(0.0, unit="m.s")
    ...     speed = gt.output(unit="m/s")
    ...     def step(self, inputs, state):
    ...         integral = state.integral + self.period * inputs.error
    ...         return {"speed": self.kp * inputs.error + self.ki * integral, "integral": integral}
    >>> class Loop(gt.Model):
    ...     x = gt.variable(unit="m", start=0.0, fixed=True)
    ...     law = gt.part(PI, period=0.004, delay=0.008)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.law.speed
    ...         yield self.law.error == 0.1 - self.x
    >>> run = gt.simulate(Loop(), 5.0)
    >>> float(run.trajectory["x"][-1].round(3)), len(run.samples["law"])
    (0.101, 1251)
    """

    period = parameter(unit="s", positive=True, description="time between two samples")
    delay = parameter(0.0, unit="s", min=0.0, description="between a sample and its outputs")
    offset = parameter(0.0, unit="s", min=0.0, description="time of the first sample")

    def step(self, inputs: Any, state: Any) -> dict[str, Any]:
        """New outputs and state from the inputs at a sample and the state before it; a subclass writes it.

        inputs, state: have the declared names as attributes, numbers or arrays of NumPy. Raises ModelError in a class
        that has none.
        """
        cls = type(self)
        own = [item.where for item in cls._declared.values() if item is not SampledBlock._declared.get(item.name)]
        raise ModelError(f"{cls.__name__} has no step(self, inputs, state); write one", own[0] if own else None)
