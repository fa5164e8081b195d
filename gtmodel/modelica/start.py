"""Initial guesses by simulation, as Optimica users made them by hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler.causal import flat_of
from ..lang.declarations import Free, Variable
from ..lang.model import Model
from ..lang.optimization import Optimization
from ..lang.source import ModelError
from ..results.trajectory import Trajectory
from ..simulation.run import simulate


def first_guess(problem: Optimization) -> Trajectory | None:
    """Return a `simulated_guess` for a problem with free time; None if the horizon is fixed.

    >>> class Fastest(gt.Optimization):
    ...     final_time = gt.free(2.0, min=0.1, unit="s")
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     u = gt.input(min=-1.0, max=1.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.u
    >>> guess = gt.modelica.first_guess(Fastest())
    >>> guess.duration
    2.0
    """
    return simulated_guess(problem) if any(isinstance(end, Free) for end in _ends(problem)) else None


def simulated_guess(problem: Optimization) -> Trajectory | None:
    """Simulate over the horizon, free times at their guesses, with inputs held at their start values within bounds.

    Returns None if the simulation fails or ends early, or if a value is not finite.

    >>> class Rest(gt.Optimization):
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     u = gt.input(start=-1.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.u
    >>> guess = gt.modelica.simulated_guess(Rest())
    >>> round(abs(float(guess["x"][-1])), 9)
    0.0
    """
    ends = _ends(problem)
    begin, end = (float(e.guess) if isinstance(e, Free) else _number(e) for e in ends)
    if not end > begin:
        return None
    inputs = {name: _held(item) for name, item in type(problem)._declared.items() if _is_input(item)}
    try:
        run = simulate(problem, end, start_time=begin, inputs=inputs, throw=False)
    except (ModelError, RuntimeError, ValueError):
        return None
    reached = run.trajectory
    if reached is None or not reached.duration >= 0.999 * (end - begin):
        return None
    return reached if all(np.all(np.isfinite(reached[name])) for name in reached.names) else None


def held_inputs(model: Model) -> dict[str, float]:
    """Return the inputs of a model with their start values, by default 0, as other Modelica tools simulate them.

    >>> class Cart(gt.Model):
    ...     x = gt.variable(start=1.0, fixed=True)
    ...     u = gt.input(start=-1.0)
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.u
    >>> gt.modelica.held_inputs(Cart())
    {'u': -1.0}
    """
    return {v.name: float(v.start or 0.0) for v in flat_of(model).variables if v.role == "input"}


def _ends(problem: Optimization) -> list[Any]:
    cls = type(problem)
    return [cls._declared.get(name, getattr(cls, name, 0.0)) for name in ("start_time", "final_time")]


def _number(value: Any) -> float:
    return float(value) if isinstance(value, (int, float)) else 0.0


def _is_input(item: Any) -> bool:
    return isinstance(item, Variable) and item.role == "input"


def _held(item: Any) -> float:
    """Return the start value of an input, clipped to its bounds."""
    low, high, start = (item.attributes.get(name) for name in ("min", "max", "start"))
    value = float(start) if isinstance(start, (int, float)) else 0.0
    if isinstance(low, (int, float)):
        value = max(value, float(low))
    return min(value, float(high)) if isinstance(high, (int, float)) else value
