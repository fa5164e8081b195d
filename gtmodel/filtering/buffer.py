"""A filter on a live stream whose readings come late, out of order, or not at all."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import Any, Literal, NamedTuple

import numpy as np

from ..results.refusal import ArgumentError
from .belief import SAME_INSTANT, Belief, InitialState, Innovation
from .error_state import Filter, without_value
from .filtered import Filtered, RunRecord

Pushed = Literal["applied", "went back", "too old", "not finite"]


class _Arrived(NamedTuple):
    """One reading: the time at which it was taken [s], the number of its sensor, and its order of arrival."""

    time: float
    sensor: int
    order: int
    value: np.ndarray


class _Passed(NamedTuple):
    """One processed instant: the step that led to it, beliefs before and after its readings."""

    time: float
    readings: int
    step: Any
    before: Any
    after: Any
    inputs: np.ndarray
    innovation: Innovation


class Buffer:
    """Filter that takes readings one by one, in any order of arrival.

    The buffer keeps readings and beliefs of the last `horizon` seconds. When a reading of an earlier time arrives, the
    filter goes back to the belief before that time, applies the reading, and repeats the later ones. Its beliefs are
    those of `filter.run` on the same readings in order, bit for bit. A sensor's delay is subtracted from its stamps,
    so readings of a sensor with a delay make the filter go back each time.

    Args:
        filter: any filter, for a single run.
        start: mean, deviation and start time; a stream needs the time.
        horizon: [s]; a reading may be older than the newest one by this much. Older readings are ignored and counted in
            `refused`.
        inputs: known inputs of the process: a trajectory, linear between its rows; or (time, name) -> value, linear
            between readings.
        record: whether to keep every instant for `filtered()`; if false, the horizon bounds the memory.

    refused: sensor -> number of readings that were too old, or not finite in their stamp or effect. late: sensor ->
    number of readings that made the filter go back. Raises ArgumentError if `start` has no time, or if `horizon` is not
    positive.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> start = gt.filtering.InitialState({}, {"x": 1.0}, time=0.0)
    >>> buffer = gt.filtering.Buffer(gt.filtering.ErrorState(system), start, horizon=0.5)
    >>> [buffer.push("tape", *reading) for reading in [(0.0, 0.0), (0.2, 0.02), (0.1, 0.01), (1.0, 0.0), (0.3, 0.0)]]
    ['applied', 'applied', 'went back', 'applied', 'too old']
    >>> buffer.late["tape"], buffer.refused["tape"]
    (1, 1)
    >>> buffer.filtered()["x"].round(4).tolist()
    [0.0, 0.0067, 0.015, 0.0016]
    """

    def __init__(
        self,
        filter: Filter,
        start: InitialState,
        horizon: float,
        *,
        inputs: Any = None,
        record: bool = True,
    ) -> None:
        system = self.system = filter.system
        if start.time is None:
            raise ArgumentError(
                "a stream has no first reading to start from; give the time at which the filter starts", "start"
            )
        if not horizon > 0:
            raise ArgumentError(f"expected more than 0 s; found {horizon}", "horizon")
        if system.dynamics.inputs and inputs is None:
            names = ", ".join(system.dynamics.inputs)
            raise ArgumentError(f"the process has known inputs; give a trajectory or a function of {names}", "inputs")
        self.filter, self.horizon, self.inputs, self._recording = filter, float(horizon), inputs, record
        self.late, self.refused = dict.fromkeys(system.sensors, 0), dict.fromkeys(system.sensors, 0)
        self._start = filter.begin(start, start.time)
        self._first = start.time
        self._start_inputs: np.ndarray | None = None
        self._names = [*system.sensors]
        self._arrived: list[_Arrived] = []
        self._passed: list[_Passed] = []
        self._done: list[_Passed] = []
        self._count = 0

    @property
    def time(self) -> float:
        """Time of the newest belief [s]."""
        return self._passed[-1].time if self._passed else self._first

    @property
    def belief(self) -> Any:
        """Belief after the newest reading."""
        return self._passed[-1].after if self._passed else self._start

    @property
    def oldest(self) -> float:
        """Time [s] before which readings are too old and ignored."""
        return max(self._first, self.time - self.horizon)

    def predicted(self, time: float) -> Belief:
        """Return mean and covariance at a time [s] after the newest reading; the buffer does not change.

        Raises ArgumentError for an earlier time.
        """
        if time < self.time:
            raise ArgumentError(f"expected a time from {self.time:g} s, the newest belief; found {time:g} s", "time")
        u0, u1 = self._inputs_of(self._passed), self.system.inputs_at(self.inputs, time)
        bends = self.system.bends(self.inputs, self.time, time)
        return self.filter.summary(self.filter.advanced(self.belief, time, u0, u1, bends)[0])

    def push(self, sensor: str, stamp: float, value: Any) -> Pushed:
        """Take one reading of a sensor and return what happened to it.

        "applied": to the newest belief. "went back": the filter went back to an earlier belief. A reading that is "too
        old", or "not finite" in its stamp or in the resulting estimate, is counted in `refused` and changes nothing.

        stamp: [s] as the sensor wrote it. value: a number or (size,), NaN where a number is missing. Raises
        ArgumentError for an unknown sensor, and for a value of another size.
        """
        if sensor not in self.system.sensors:
            names = ", ".join(f"'{n}'" for n in self._names)
            raise ArgumentError(f"there is no sensor '{sensor}'; the sensors are {names}", "sensor")

        z = np.asarray(value, float).reshape(-1)
        size = self.system.readings[sensor].size
        if z.shape != (size,):
            raise ArgumentError(f"expected {size} numbers from '{sensor}'; found shape {np.shape(value)}", "value")
        time = float(stamp) - self.system.sensors[sensor].lag
        if not np.isfinite(time) or time < self.oldest:
            self.refused[sensor] += 1
            return "too old" if np.isfinite(time) else "not finite"
        self._count += 1
        arrived = _Arrived(time, self._names.index(sensor), self._count, z)
        position = bisect_right(self._arrived, arrived[:3], key=lambda a: a[:3])
        late = position < len(self._arrived)
        n, used = len(self._passed), len(self._arrived)
        self._arrived.insert(position, arrived)
        # later instants are computed again, and so is the one before if the reading belongs to it
        while n and (used > position or (used == position and time - self._passed[n - 1].time <= SAME_INSTANT)):
            n -= 1
            used -= self._passed[n].readings
        previous, self._passed = self._passed, self._passed[:n]
        finite = False
        try:
            finite = self._forward(used)
        finally:  # known inputs that have ended raise an error: the buffer must stay as it was
            if not finite:
                self._passed = previous
                del self._arrived[position]
        if not finite:
            self.refused[sensor] += 1
            return "not finite"
        self.late[sensor] += late
        self._forget()
        return "went back" if late else "applied"

    def filtered(self) -> Filtered:
        """Return all instants so far, as `filter.run` does. Raises ArgumentError if they were not recorded."""
        if not self._recording:
            raise ArgumentError("the instants were not recorded; make the buffer with record=True", "record")
        every = [*self._done, *self._passed]
        record = RunRecord(self.system, len(every), 1, True, None)
        for p in every:
            before, after = self.filter.summary(p.before), self.filter.summary(p.after)
            record.add(p.time, p.step, before, after, p.innovation, self.filter.details(p.after))
        return record.ended()

    # -- back and forward --------------------------------------------------------------------------------

    def _inputs_of(self, passed: list[_Passed]) -> np.ndarray:
        """Known inputs at the newest belief."""
        if passed:
            return passed[-1].inputs
        if self._start_inputs is None:
            self._start_inputs = self.system.inputs_at(self.inputs, self._first)
        return self._start_inputs

    def _forward(self, k: int) -> bool:
        """Process all readings from the k-th on; return whether all estimates stayed finite."""
        while k < len(self._arrived):
            first = self._arrived[k]
            rows: dict[int, np.ndarray] = {}
            while k < len(self._arrived):
                a = self._arrived[k]
                if a.sensor in rows or a.time - first.time > SAME_INSTANT:
                    break
                rows[a.sensor] = a.value
                k += 1
            u0, u1 = self._inputs_of(self._passed), self.system.inputs_at(self.inputs, first.time)
            bends = self.system.bends(self.inputs, self.time, first.time)
            before, step = self.filter.advanced(self.belief, first.time, u0, u1, bends)
            names = tuple(name for n, name in enumerate(self._names) if n in rows)
            z = np.concatenate([rows[n] for n in sorted(rows)])[None]
            after, innovation = self.filter.correct(before, names, z, u1)
            finite = np.all(np.isfinite(self.filter.summary(after).x))
            if not finite or without_value(self.system, z, innovation) is not None:
                return False
            self._passed.append(_Passed(first.time, len(rows), step, before, after, u1, innovation))
        return True

    def _forget(self) -> None:
        """Drop the instants that no later reading can change: those more than `SAME_INSTANT` before the oldest accepted
        time, except the last one, from which the filter goes forward."""
        reachable = self.oldest - 2 * SAME_INSTANT
        n = bisect_left(self._passed, reachable, key=lambda p: p.time) - 1
        if n <= 0:
            return
        dropped, self._passed = self._passed[:n], self._passed[n:]
        del self._arrived[: sum(p.readings for p in dropped)]
        if self._recording:
            self._done += dropped
