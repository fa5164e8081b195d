"""What a filter is told from outside: quantities of the process with noise, delay, scale and offset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ..results.refusal import ArgumentError

Free = Literal["estimate"]
ESTIMATE: Free = "estimate"


@dataclass(frozen=True)
class Sensor:
    """One measured quantity of the process.

    Args:
        name: of the sensor, under which its readings come.
        signal: the variable of the process that it measures, as in "p"; the sensor's name if left out.
        deviation: standard deviation of the white noise of one reading, a number or one per component, in the unit of
            the signal; of a quaternion or direction an angle [rad].
        density: in place of it, deviation times the root of the period, as data sheets print it [unit / sqrt(Hz)].
        period: between two readings [s]; needed with `density`, and to simulate readings.
        kind: "vector"; "quaternion" (unit length, scalar first; either sign is the same), or "direction".
        delay: how late a reading comes [s]: the one that is stamped t tells of t - delay.
        scale, offset: quantity(t) = scale reading(t + delay) - offset, as of `gt.measurements.Signal`; of vectors only.
        gate: a reading is left out where its normalised innovation squared lies above this quantile of chi-squared,
            as 0.999; none if left out.

    ESTIMATE ("estimate") in place of delay, scale or offset makes it a constant state "name.delay" and so on, whose
    deviation stands with the start of the filter.

    >>> gyro = gt.filtering.Sensor("gyro", "rate", density=2.8e-5, period=0.001)
    >>> gyro.deviations(3).round(6).tolist()
    [0.000885, 0.000885, 0.000885]
    """

    name: str
    signal: str = ""
    deviation: Any = None
    density: Any = None
    period: float | None = None
    kind: Literal["vector", "quaternion", "direction"] = "vector"
    delay: float | Free = 0.0
    scale: Any = 1.0
    offset: Any = 0.0
    gate: float | None = None

    def __post_init__(self) -> None:
        if (self.deviation is None) == (self.density is None):
            raise ArgumentError(f"sensor '{self.name}' takes either a deviation or a density", "deviation")
        if self.density is not None and self.period is None:
            raise ArgumentError(f"sensor '{self.name}' has a density; give the period of its readings too", "period")
        if self.period is not None and not self.period > 0:
            raise ArgumentError(f"expected more than 0 s; found {self.period}", "period")
        if self.gate is not None and not 0 < self.gate < 1:
            raise ArgumentError(f"expected a probability between 0 and 1; found {self.gate}", "gate")
        if self.kind != "vector" and not (_is(self.scale, 1.0) and _is(self.offset, 0.0)):
            raise ArgumentError(
                f"a {self.kind} has no scale and no offset; turn it by a parameter of the model", "scale"
            )
        if self.delay != ESTIMATE and not np.isfinite(self.delay):
            raise ArgumentError(f"expected seconds; found {self.delay!r}", "delay")

    @property
    def quantity(self) -> str:
        """The variable that is measured."""
        return self.signal or self.name

    @property
    def lag(self) -> float:
        """The part of the delay that is known [s]."""
        return 0.0 if self.delay == ESTIMATE else float(self.delay)

    def deviations(self, size: int) -> np.ndarray:
        """Standard deviations of the components of one reading (size,). Raises ArgumentError for another number of
        them, and for one that is not above zero."""
        per_reading = self.deviation
        if self.density is not None and self.period is not None:
            per_reading = np.asarray(self.density, float) / np.sqrt(self.period)
        try:
            values = np.broadcast_to(np.asarray(per_reading, float), (size,)).copy()
        except (TypeError, ValueError):
            sentence = f"expected a number, or {size}; found {per_reading!r}"
            raise ArgumentError(sentence, f"{self.name}.deviation") from None
        if not np.all(np.isfinite(values)) or np.any(values <= 0):
            raise ArgumentError(f"expected more than zero; found {per_reading!r}", f"{self.name}.deviation")
        return values


def _is(value: Any, number: float) -> bool:
    return not isinstance(value, str) and np.ndim(value) == 0 and float(value) == number
