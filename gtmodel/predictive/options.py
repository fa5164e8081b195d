"""Options of a predictive controller, of its measurements, and of the servo that it commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from ..results.agreement import described
from ..results.options import Options, Unit, Within
from ..results.refusal import ArgumentError

FOREVER = 1e300  # a jump that is never exceeded


def numbers(value: Any, argument: str) -> np.ndarray:
    """Return an array of numbers, which may be NaN or infinite. Raises ArgumentError for anything else, and for truth
    values."""
    try:
        array = np.asarray(value, float)
        if not any(isinstance(v, (bool, np.bool_)) for v in np.asarray(value, object).ravel()):
            return array
    except (TypeError, ValueError):
        pass
    raise ArgumentError(f"expected numbers; found {described(value)}", argument)


@dataclass(frozen=True)
class ControlHorizon(Options):
    """Stages of a predictive controller, its period, and the bounds of its work.

    A stage may be longer than the period: in each cycle the last plan is moved on by one period.

    >>> gt.predictive.ControlHorizon(period=0.004, stages=40, length=0.01).delay
    0
    >>> gt.predictive.ControlHorizon(period=0.02, stages=40, length=0.01)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: length: expected at least the period of 0.02 s; found 0.01
    """

    period: Annotated[float, Unit("s"), Within(above=0.0), "of the loop"]
    stages: Annotated[int, Within(least=1), "of the horizon"]
    length: Annotated[float | None, Unit("s"), Within(above=0.0), "of a stage; the period if left out"] = None
    steps: Annotated[int, Within(least=1), "Runge-Kutta steps of fourth order in a stage"] = 1
    delay: Annotated[int, Within(least=0), "cycles from a measurement to the force of the same cycle"] = 0
    preview: Annotated[bool, "references of every stage are given, not one for all of them"] = False
    causality: Annotated[
        Literal["auto", "explicit", "inverse"],
        "inputs of the stages: explicit: those of the model; inverse: accelerations, with the model's inputs as rows",
    ] = "auto"
    terminal: Annotated[bool, "cost after the horizon, by the Riccati equation at the targets"] = True
    max_iterations: Annotated[int, Within(least=1), "of the interior point method in a cycle"] = 25
    tolerance: Annotated[float, Within(above=0.0), "of the quadratic programs, relative to 1 + cost"] = 1e-6
    patience: Annotated[int, Within(least=0), "cycles in a row without a measurement, or without a solution"] = 10

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.length is not None and self.length < self.period:
            raise ArgumentError(f"expected at least the period of {self.period:g} s; found {self.length:g}", "length")

    @property
    def stage(self) -> float:
        """Length of a stage [s]."""
        return self.period if self.length is None else self.length


@dataclass(frozen=True)
class Measurement(Options):
    """A measured variable of a predictive controller, in its SI unit.

    deviation: standard deviation of one reading. jump: a reading further away from the prediction is left out.

    >>> gt.predictive.Measurement(deviation=1e-5, jump=0.01).deviation
    1e-05
    """

    deviation: Annotated[float, Within(above=0.0), "standard deviation of one reading"]
    jump: Annotated[float, Within(above=0.0), "a reading further away from the prediction is left out"] = FOREVER


@dataclass(frozen=True)
class AxisServo(Options):
    """Position servo between a predictive controller and its axes: F = kp (u - q) + kd (du - dq).

    u, du: commanded position and speed; q, dq: position and speed of the axis. The controller predicts with it, and
    returns the position to command. It knows no saturation: limit the planned forces below those of the motors, by what
    the servo adds within a cycle (docs/howto/predictive_control.md). Gains in N/m and N s/m, of joints in N m/rad and
    N m s/rad; one number, or one for each axis.

    >>> gt.predictive.AxisServo(stiffness=40.0 * 200.0**2, damping=2 * 0.7 * 200.0 * 40.0).stiffness  # 200 rad/s, 40 kg
    1600000.0
    """

    stiffness: Annotated[float | tuple[float, ...], Within(above=0.0), "kp, one number or one for each axis"]
    damping: Annotated[float | tuple[float, ...], Within(least=0.0), "kd, one number or one for each axis"]

    def gains(self, axes: int) -> tuple[np.ndarray, np.ndarray]:
        """Return kp and kd, (axes,) each. Raises ArgumentError for another number of them."""
        for name in ("stiffness", "damping"):
            if np.size(getattr(self, name)) not in (1, axes):
                raise ArgumentError(
                    f"expected one number{f', or {axes}' if axes > 1 else ''}; found {np.size(getattr(self, name))}",
                    name,
                )
        kp, kd = (np.broadcast_to(np.ravel(g).astype(float), (axes,)) for g in (self.stiffness, self.damping))
        return kp, kd
