"""What a filter is told from outside: quantities of the process with noise, delay, scale and offset."""

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
        name: of the sensor, under which its readings come.
        signal: the variable of the process that it measures, as in "p"; the sensor's name if left out.
        deviation: standard deviation of the white noise of one reading, a number or one per component, in the unit of
            the signal; of a quaternion or direction an angle [rad].
        covariance: in place of it, the full covariance of the noise of one reading (n, n). Innovations are then those
            of independent combinations of its numbers; where a number is missing, those after it are left out too.
        density: in place of both, deviation times the root of the period, as data sheets print it [unit / sqrt(Hz)].
        period: between two readings [s]; needed with `density`, and to simulate readings.
        kind: "vector"; "quaternion" (scalar first; either sign is the same), or "direction" (such as a magnetometer's);
            of both the length does not count, and a reading of no length is a missing one. An angle that jumps by a
            turn, such as a heading, is no vector: unwrap it, or give its direction (cos, sin, 0).
        delay: how late a reading comes [s]: the one that is stamped t tells of t - delay.
        scale, offset: quantity(t) = scale reading(t + delay) - offset, as of `gt.measurements.Signal`; of vectors only.
        gate: a reading is left out where its normalised innovation squared lies above this quantile of chi-squared,
            as 0.999; none if left out.

        outliers: "huber": a reading counts less the further it lies off, where by a gate it counts or does not. Beyond
            1.345 deviations of its innovation (of several numbers: where as many right ones lie beyond, 18 %) the
            variance of its noise is taken as many times larger as it lies beyond. None if left out.

    With one reading of ten off by ten deviations, "huber" leaves about 1.2 times the error of a right log where without
    it there is 2.6 times; of a right log it costs about 4 % in variance. It may stand beside a gate, which comes first.
    Source of the weights: Huber 1964, Ann. Math. Statist. 35, 73-101; of k = 1.345 Holland and Welsch 1977, Commun.
    Stat. A 6, 813-827.

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
    kind: PartKind = "vector"
    delay: float | Free = 0.0
    scale: Any = 1.0
    offset: Any = 0.0
    gate: float | None = None
    outliers: Literal["huber"] | None = None
    covariance: Any = None

    def __post_init__(self) -> None:
        given = [self.deviation is not None, self.density is not None, self.covariance is not None]
        if sum(given) != 1:
            raise ArgumentError(f"sensor '{self.name}' takes one of deviation, density and covariance", "deviation")
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
                f"a {self.kind} has no scale and no offset; turn it by a parameter of the model", "scale"
            )
        if self.outliers not in (None, "huber"):
            raise ArgumentError(f"expected 'huber', or nothing; found {self.outliers!r}", "outliers")
        if not _free(self.delay) and not np.isfinite(_number(self.delay)):
            raise ArgumentError(f"expected seconds, or 'estimate'; found {self.delay!r}", "delay")
        for name, value, zero in (("scale", self.scale, False), ("offset", self.offset, True)):
            if not _free(value) and not (np.all(np.isfinite(own := _numbers(value))) and (zero or np.all(own != 0))):
                wanted = "finite numbers" if zero else "finite numbers other than 0"
                raise ArgumentError(f"expected {wanted}, or 'estimate'; found {value!r}", name)

    @property
    def quantity(self) -> str:
        """The variable that is measured."""
        return self.signal or self.name

    @property
    def lag(self) -> float:
        """The part of the delay that is known [s]."""
        return 0.0 if self.delay == ESTIMATE else float(self.delay)

    def deviations(self, size: int) -> np.ndarray:
        """Standard deviations of the components of one reading (size,), with a full covariance those of independent
        combinations of them. Raises ArgumentError for another number of
        them, and for one that is not above zero."""
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
        """What makes the noise of one reading of independent numbers, whose `deviations` they are (size, size); None
        where its own numbers are independent."""
        if self.covariance is None:
            return None
        return independent(covariance_matrix(self.covariance, size, f"{self.name}.covariance", singular=False))[0]

    def with_deviation(self, value: Any, size: int) -> Sensor:
        """The same with another deviation; of a full covariance one in proportion to its own.

        Raises ArgumentError for one that is not.
        """
        if self.covariance is None:
            return replace(self, deviation=value, density=None)
        own, other = self.deviations(size), Sensor(self.name, deviation=value).deviations(size)
        factor = float(other[0] / own[0])
        if not np.allclose(other, factor * own, rtol=PROPORTIONAL):
            there = ", ".join(f"{v:.4g}" for v in own)
            raise ArgumentError(
                f"'{self.name}' has a full covariance, whose independent deviations are {there}; give a multiple of "
                f"them, or make the sensor anew; found {value!r}",
                "deviations",
            )
        return replace(self, covariance=factor**2 * np.asarray(self.covariance, float))


PROPORTIONAL = 1e-9  # of deviations that are multiples of others but for round-off


def _is(value: Any, number: float) -> bool:
    return not isinstance(value, str) and np.ndim(value) == 0 and float(value) == number


def _free(value: Any) -> bool:
    return isinstance(value, str) and value == ESTIMATE


def _numbers(value: Any) -> np.ndarray:
    """As an array; not a number where it is none."""
    try:
        return np.array(np.nan) if isinstance(value, str) else np.asarray(value, float)
    except (TypeError, ValueError):
        return np.array(np.nan)


def _number(value: Any) -> float:
    own = _numbers(value)
    return float(own) if own.ndim == 0 else np.nan
