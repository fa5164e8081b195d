"""Readings of several sensors on one time axis: what was measured at each instant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..results.refusal import ArgumentError
from ..results.trajectory import Trajectory
from .system import SAME_INSTANT as SAME_INSTANT, System


class Readings:
    """What one sensor read.

    time: stamps (k,) [s], in any order. values: (k,) or (k, size), or (m, k, size) for m runs at once; what is not
    finite is a missing number. Raises ArgumentError for shapes that do not fit each other, and for times that are not
    finite.

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
            raise ArgumentError("a stamp is not finite; leave out readings without a time", "time")

    def __len__(self) -> int:
        return len(self.time)


class Moment(NamedTuple):
    """The readings of one instant: its time [s], and sensor -> row of its readings."""

    time: float
    rows: dict[str, int]


def readings_of(system: System, log: Mapping[str, Any]) -> dict[str, Readings]:
    """Readings by sensor, in the order of the sensors, from a mapping of `Readings` or of trajectories with a signal of
    that name.

    Raises ArgumentError for a sensor that is not there, and for readings of another size than the sensor's.
    """
    made = {}
    for name, given in log.items():
        if name not in system.sensors:
            there = ", ".join(f"'{n}'" for n in system.sensors)
            raise ArgumentError(f"there is no sensor '{name}'; there are {there}", "log")
        if isinstance(given, Trajectory):
            column = name if name in given.names else given.names[0]
            if name not in given.names and len(given.names) > 1:
                raise ArgumentError(f"the trajectory of '{name}' has no signal of that name", f"log.{name}")
            given = Readings(given.time, given[column])
        if not isinstance(given, Readings):
            raise ArgumentError(f"expected Readings or a Trajectory; found {type(given).__name__}", f"log.{name}")
        size = system.readings[name].size
        if given.values.shape[-1] != size:
            raise ArgumentError(f"expected {size} numbers a reading; found {given.values.shape[-1]}", f"log.{name}")
        made[name] = given
    if not made or not any(len(r) for r in made.values()):
        raise ArgumentError("there is no reading in it", "log")
    return {name: made[name] for name in system.sensors if name in made}


def instants(system: System, log: Mapping[str, Readings]) -> list[Moment]:
    """The instants that readings tell of, in order: their stamps less the delays of their sensors."""
    names = [*log]
    times = np.concatenate([log[n].time - system.sensors[n].lag for n in names])
    owner = np.concatenate([np.full(len(log[n]), k) for k, n in enumerate(names)])
    row = np.concatenate([np.arange(len(log[n])) for n in names])
    made: list[Moment] = []
    for k in np.lexsort((owner, times)):
        name, time = names[owner[k]], float(times[k])
        if made and time - made[-1].time <= SAME_INSTANT and name not in made[-1].rows:
            made[-1].rows[name] = int(row[k])
        else:
            made.append(Moment(time, {name: int(row[k])}))
    return made


def size_of_runs(log: Sequence[Readings]) -> int:
    """How many runs readings hold. Raises ArgumentError where they hold different numbers."""
    sizes = {r.values.shape[0] for r in log if r.values.ndim == 3}
    if len(sizes) > 1:
        raise ArgumentError(f"all sensors are to have as many runs; found {sorted(sizes)}", "log")
    return sizes.pop() if sizes else 1
