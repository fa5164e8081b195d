"""Sensors: measured quantities of the process with noise, delay, scale and offset."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from ..results.refusal import ArgumentError
from .manifold import PartKind
from .process import covariance_matrix, independent

Free = Literal["estimate"]
ESTIMATE: Free = "estimate"


@dataclass(frozen=True)
class Sensor:
    """One measured quantity of the process.

    Args:
        name: of the sensor, and of its readings in a log.
        signal: the variable of the process that it measures, as in "p"; the sensor's name if left out.
        deviation: standard deviation of the white noise of one reading, a number or one per component, in the unit of
            the signal; for a quaternion or direction an angle [rad].
        covariance: instead of `deviation`, the full covariance of the noise of one reading (n, n). The innovations are
            then independent combinations of its numbers; if a number is missing, the later ones are left out too.
        density: instead of both, deviation times the square root of the period, as in data sheets [unit / sqrt(Hz)].
        period: between two readings [s]; needed with `density`, and to simulate readings.
        kind: "vector"; "quaternion" (scalar first, of either sign); "direction" (such as a magnetometer's). The length
            of a quaternion or direction is ignored; one of zero length is a missing reading. An angle that wraps
            around, such as a heading, is not a vector: unwrap it, or give its direction (cos, sin, 0).
        delay: how late a reading arrives [s]: a reading with stamp t was taken at t - delay.
        scale, offset: quantity(t) = scale reading(t + delay) - offset, as in `gt.measurements.Signal`; vectors only.
        gate: a reading is left out if its normalised innovation squared is above this quantile of chi-squared, such as
            0.999; no gate if left out.

        outliers: "huber": a reading far from its prediction counts less, instead of being left out by a gate. Beyond
            1.345 standard deviations of the innovation (for several numbers: the distance that also 18 % of good
            readings exceed), the noise variance grows in proportion to the distance. None if left out.

    If one reading in ten is off by ten standard deviations, the error is about 1.2 times that of a log without outliers
    with "huber", and 2.6 times without it; on a log without outliers it costs about 4 % in variance. It can be combined
    with a gate, which is applied first. Source of the weights: Huber 1964, Ann. Math. Statist. 35, 73-101; of k = 1.345
    Holland and Welsch 1977, Commun. Stat. A 6, 813-827.

    ESTIMATE ("estimate") instead of a delay, scale or offset makes it a constant state "name.delay" and so on; the
    start of the filter then needs its deviation.

    >>> gyro = gt.filtering.Sensor("gyro", "rate", density=2.8e-5, period=0.001)
    >>> gyro.deviations(3).round(6).tolist()
    [0.000885, 0.000885, 0.000885]
    """

    name: str
    signal: str = ""
    deviation: Any = None
    density: Any = None
    period: float | None = None
    kind: PartKind = "vector"
    delay: float | Free = 0.0
    scale: Any = 1.0
    offset: Any = 0.0
    gate: float | None = None
    outliers: Literal["huber"] | None = None
    covariance: Any = None

    def __post_init__(self) -> None:
        stated = [self.deviation is not None, self.density is not None, self.covariance is not None]
        if sum(stated) != 1:
            raise ArgumentError(f"sensor '{self.name}' needs one of deviation, density and covariance", "deviation")
        if self.density is not None and self.period is None:
            raise ArgumentError(f"sensor '{self.name}' has a density; give the period of its readings too", "period")
        if self.kind not in get_args(PartKind):
            kinds = ", ".join(f"'{kind}'" for kind in get_args(PartKind))
            raise ArgumentError(f"expected one of {kinds}; found {self.kind!r}", "kind")
        if self.period is not None and not _number(self.period) > 0:
            raise ArgumentError(f"expected more than 0 s; found {self.period!r}", "period")
        if self.gate is not None and not 0 < _number(self.gate) < 1:
            raise ArgumentError(f"expected a probability between 0 and 1; found {self.gate!r}", "gate")
        if self.kind != "vector" and not (_is(self.scale, 1.0) and _is(self.offset, 0.0)):
            raise ArgumentError(
                f"a {self.kind} has no scale and no offset; rotate it by a parameter of the model", "scale"
            )
        if self.outliers not in (None, "huber"):
            raise ArgumentError(f"expected 'huber' or None; found {self.outliers!r}", "outliers")
        if not _free(self.delay) and not np.isfinite(_number(self.delay)):
            raise ArgumentError(f"expected seconds or 'estimate'; found {self.delay!r}", "delay")
        for name, value, zero in (("scale", self.scale, False), ("offset", self.offset, True)):
            if not _free(value) and not (np.all(np.isfinite(v := _numbers(value))) and (zero or np.all(v != 0))):
                kind = "finite numbers" if zero else "finite numbers other than 0"
                raise ArgumentError(f"expected {kind}, or 'estimate'; found {value!r}", name)

    @property
    def quantity(self) -> str:
        """The measured variable."""
        return self.signal or self.name

    @property
    def lag(self) -> float:
        """The known delay [s]; 0 if the delay is estimated."""
        return 0.0 if self.delay == ESTIMATE else float(self.delay)

    def deviations(self, size: int) -> np.ndarray:
        """Return the standard deviations of one reading (size,); with a full covariance, those of its independent
        combinations.

        Raises ArgumentError for a wrong size, and for a deviation that is not above zero.
        """
        if self.covariance is not None:
            return independent(covariance_matrix(self.covariance, size, f"{self.name}.covariance", singular=False))[1]
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

    def mixing(self, size: int) -> np.ndarray | None:
        """Return the matrix (size, size) from independent numbers with these `deviations` to the noise of one reading;
        None if the noise of its components is independent."""
        if self.covariance is None:
            return None
        return independent(covariance_matrix(self.covariance, size, f"{self.name}.covariance", singular=False))[0]

    def with_deviation(self, value: Any, size: int) -> Sensor:
        """Return the same sensor with another deviation; with a full covariance it must be proportional to its own.

        Raises ArgumentError if it is not.
        """
        if self.covariance is None:
            return replace(self, deviation=value, density=None)
        own, other = self.deviations(size), Sensor(self.name, deviation=value).deviations(size)
        factor = float(other[0] / own[0])
        if not np.allclose(other, factor * own, rtol=PROPORTIONAL):
            listed = ", ".join(f"{v:.4g}" for v in own)
            raise ArgumentError(
                f"'{self.name}' has a full covariance, whose independent deviations are {listed}; give a multiple of "
                f"them, or make a new sensor; found {value!r}",
                "deviations",
            )
        return replace(self, covariance=factor**2 * np.asarray(self.covariance, float))


PROPORTIONAL = 1e-9  # relative tolerance of proportional deviations


def _is(value: Any, number: float) -> bool:
    return not isinstance(value, str) and np.ndim(value) == 0 and float(value) == number


def _free(value: Any) -> bool:
    return isinstance(value, str) and value == ESTIMATE


def _numbers(value: Any) -> np.ndarray:
    """As an array; NaN if it is not numeric."""
    try:
        return np.array(np.nan) if isinstance(value, str) else np.asarray(value, float)
    except (TypeError, ValueError):
        return np.array(np.nan)


def _number(value: Any) -> float:
    numbers = _numbers(value)
    return float(numbers) if numbers.ndim == 0 else np.nan
