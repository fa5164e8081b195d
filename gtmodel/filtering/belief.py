"""Readings of several sensors on one time axis; the belief of a filter at an instant, and its innovations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from ..results.refusal import ArgumentError, naming
from ..results.trajectory import Trajectory
from .system import SAME_INSTANT as SAME_INSTANT, System


def all_finite(a: np.ndarray) -> bool:
    """Whether all numbers are finite. Their sum of squares tells it at a fifth of the cost, unless it overflows."""
    return isfinite(np.vdot(a, a)) or bool(np.isfinite(a).all())


class Readings:
    """Readings of one sensor.

    time: stamps (k,) [s], in any order. values: (k,) or (k, size), or (m, k, size) for m runs at once; a number that
    is not finite is missing. Raises ArgumentError if the shapes do not match, or a time is not finite.

    >>> tracker = gt.filtering.Readings([0.0, 0.1, 0.2], [[1.0, 2.0], [1.1, np.nan], [1.2, 2.1]])
    >>> len(tracker)
    3
    """

    def __init__(self, time: Any, values: Any) -> None:
        self.time, self.values = np.asarray(time, float), np.asarray(values, float)
        if self.values.ndim == 1:
            self.values = self.values[:, None]
        if self.time.ndim != 1 or self.values.ndim not in (2, 3) or self.values.shape[-2] != len(self.time):
            raise ArgumentError(
                f"expected times (k,) and values (k, size); found {self.time.shape} and {self.values.shape}", "values"
            )
        if not np.all(np.isfinite(self.time)):
            raise ArgumentError("a time stamp is not finite; leave out readings without a time", "time")

    def __len__(self) -> int:
        return len(self.time)


class Moment(NamedTuple):
    """Readings of one instant: its time [s], and sensor -> row of its readings."""

    time: float
    rows: dict[str, int]


def readings_of(system: System, log: Mapping[str, Any]) -> dict[str, Readings]:
    """Readings by sensor, in the order of the sensors, from a mapping of `Readings` or of trajectories with a signal of
    that name.

    Raises ArgumentError for an unknown sensor, and for readings of another size than the sensor's.
    """
    readings = {}
    for name, source in log.items():
        if name not in system.sensors:
            names = ", ".join(f"'{n}'" for n in system.sensors)
            raise ArgumentError(f"there is no sensor '{name}'; the sensors are {names}", "log")
        if isinstance(source, Trajectory):
            column = name if name in source.names else source.names[0]
            if name not in source.names and len(source.names) > 1:
                raise ArgumentError(f"the trajectory of '{name}' has no signal of that name", f"log.{name}")
            source = Readings(source.time, source[column])
        if not isinstance(source, Readings):
            raise ArgumentError(f"expected Readings or a Trajectory; found {type(source).__name__}", f"log.{name}")
        size = system.readings[name].size
        if source.values.shape[-1] != size:
            raise ArgumentError(f"expected {size} numbers per reading; found {source.values.shape[-1]}", f"log.{name}")
        readings[name] = source
    if not readings or not any(len(r) for r in readings.values()):
        raise ArgumentError("the log holds no reading", "log")
    return {name: readings[name] for name in system.sensors if name in readings}


def instants(system: System, log: Mapping[str, Readings]) -> list[Moment]:
    """Instants at which the readings were taken, in order: their stamps minus the delays of their sensors."""
    names = [*log]
    times = np.concatenate([log[n].time - system.sensors[n].lag for n in names])
    owner = np.concatenate([np.full(len(log[n]), k) for k, n in enumerate(names)])
    row = np.concatenate([np.arange(len(log[n])) for n in names])
    order = np.lexsort((owner, times))
    moments: list[Moment] = []
    rows: dict[str, int] = {}
    begin = -np.inf
    for time, k, r in zip(times[order].tolist(), owner[order].tolist(), row[order].tolist(), strict=True):
        name = names[k]
        if time - begin <= SAME_INSTANT and name not in rows:
            rows[name] = r
        else:
            begin, rows = time, {name: r}
            moments.append(Moment(time, rows))
    return moments


def size_of_runs(log: Sequence[Readings]) -> int:
    """Number of runs in the readings. Raises ArgumentError if sensors have different numbers of runs."""
    sizes = {r.values.shape[0] for r in log if r.values.ndim == 3}
    if len(sizes) > 1:
        raise ArgumentError(f"expected as many runs of every sensor; found {sorted(sizes)}", "log")
    return sizes.pop() if sizes else 1


class Belief(NamedTuple):
    """Time [s], means (m, size) and error covariances (m, n, n) of m runs."""

    time: float
    x: np.ndarray
    P: np.ndarray


class Innovation(NamedTuple):
    """Innovations of the readings of one instant, for m runs.

    names: the sensors. residual: (m, k), zero where a number was not used. variance: of each (m, k). used: (m, k).
    nis: normalised innovations squared (m,), chi-squared with `numbers` (m,) degrees of freedom. log_likelihood: (m,).
    gated: whether its gate left out the reading of each sensor (m, sensors). weighed: whether a reading got less weight
    as an outlier (m, sensors); None if no sensor has Huber weights. With them, residual and nis are limited to Huber's
    threshold k. whole: all numbers are known to be used.
    """

    names: tuple[str, ...]
    residual: np.ndarray
    variance: np.ndarray
    used: np.ndarray
    nis: np.ndarray
    numbers: np.ndarray
    log_likelihood: np.ndarray
    gated: np.ndarray
    weighed: np.ndarray | None = None
    whole: bool = False


@dataclass(frozen=True)
class InitialState:
    """Initial estimate of a filter.

    Args:
        mean: state -> value; zero for a state that is not named, the identity for a quaternion.
        deviation: state -> standard deviation of its error, one number or one per component [unit of the state, rad],
            or a covariance (k, k) of its components; needed for every state and every estimated constant.
        time: [s]; the instant of the first reading if left out.

    >>> start = gt.filtering.InitialState({"x": 1.0}, {"x": 0.1, "v": 2.0})
    >>> start.deviation["v"]
    2.0
    """

    mean: Mapping[str, Any]
    deviation: Mapping[str, Any]
    time: float | None = None

    def __post_init__(self) -> None:
        if self.time is not None and not (isinstance(self.time, (int, float, np.number)) and np.isfinite(self.time)):
            raise ArgumentError(f"expected a time [s]; found {self.time!r}", "start.time")

    def belief(self, system: System, time: float, runs: int = 1) -> Belief:
        """Return the initial belief of a system. Raises ArgumentError for a state without a deviation."""
        space = system.space
        x = space.point({**system.start_constants(), **self.mean}, "start.mean")
        P = np.zeros((space.dimension, space.dimension))
        for name in self.deviation:
            with naming("start.deviation"):
                space.part(name)
        for part in space.parts:
            _, _, along = space.part(part.name)
            if part.name not in self.deviation:
                raise ArgumentError(
                    f"state '{part.name}' has no deviation; give one [{part.error_unit}], or {part.dimension}",
                    "start.deviation",
                )
            value = np.asarray(self.deviation[part.name])
            if value.shape == (part.dimension, part.dimension) and value.ndim == 2:
                if not np.allclose(value, value.T) or np.linalg.eigvalsh(value)[0] < -1e-9 * np.trace(value):
                    raise ArgumentError(
                        f"expected a covariance, symmetric and positive semidefinite; found {value.tolist()}",
                        f"start.deviation.{part.name}",
                    )
                P[along, along] = value
                continue
            try:
                d = np.broadcast_to(np.asarray(self.deviation[part.name], float), (part.dimension,))
            except (TypeError, ValueError):
                raise ArgumentError(
                    f"expected a number, or {part.dimension}; found {self.deviation[part.name]!r}",
                    f"start.deviation.{part.name}",
                ) from None
            if not np.all(np.isfinite(d)) or np.any(d < 0):
                raise ArgumentError(f"expected at least 0; found {d.tolist()}", f"start.deviation.{part.name}")
            P[along, along] = np.diag(d**2)
        return Belief(self.time if self.time is not None else time, np.tile(x, (runs, 1)), np.tile(P, (runs, 1, 1)))
