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
    """One reading: the time that it tells of [s], its sensor by number, and the order in which it came."""

    time: float
    sensor: int
    came: int
    value: np.ndarray


class _Passed(NamedTuple):
    """One instant that the filter has passed: the step that led there, beliefs before and after its readings."""

    time: float
    readings: int
    step: Any
    before: Any
    after: Any
    inputs: np.ndarray
    innovation: Innovation


class Buffer:
    """A filter that takes readings one by one, in whatever order they come.

    It keeps the readings and the beliefs of the last `horizon` seconds. A reading of an earlier time makes it go back
    to the belief before that time, apply it, and go forward again over what it had read since. So its beliefs are those
    of `filter.run` on the same readings in order, bit for bit. A sensor's delay is taken off its stamp, so a sensor
    that is late by its nature is one that always makes it go back.

    Args:
        filter: any filter; of one run.
        start: mean, deviation, and the time at which it begins, which a stream needs.
        horizon: [s] how far a reading may lie before the newest one; what is older is refused, and counted.
        inputs: the known inputs of the process: a trajectory, straight between its rows; or (time, name) -> value, then
            straight between readings.
        record: whether every instant is kept for `filtered()`; off, memory stays bounded by the horizon.

    refused, late: sensor -> how many readings were too old, or not finite in their stamp or effect; how many made it go
    back. Raises ArgumentError for a start without a time and a horizon that is not positive.

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
                "a stream may begin with any reading; give the time at which the filter starts", "start"
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
        """Of the newest belief [s]."""
        return self._passed[-1].time if self._passed else self._first

    @property
    def belief(self) -> Any:
        """After the newest reading."""
        return self._passed[-1].after if self._passed else self._start

    @property
    def oldest(self) -> float:
        """Readings that tell of a time before this are refused [s]."""
        return max(self._first, self.time - self.horizon)

    def predicted(self, time: float) -> Belief:
        """Mean and covariance at a time [s] after the newest reading, without a change of the buffer. Raises
        ArgumentError for an earlier time."""
        if time < self.time:
            raise ArgumentError(f"the newest belief is of {self.time:g} s; found {time:g} s", "time")
        u0, u1 = self._inputs_of(self._passed), self.system.inputs_at(self.inputs, time)
        bends = self.system.bends(self.inputs, self.time, time)
        return self.filter.summary(self.filter.advanced(self.belief, time, u0, u1, bends)[0])

    def push(self, sensor: str, stamp: float, value: Any) -> Pushed:
        """Take one reading of a sensor: "applied" to the newest belief, or the filter "went back" for it. What is "too
        old", or "not finite" in its stamp or in what it leads to, is counted in `refused` and changes nothing.

        stamp: [s] as the sensor wrote it. value: a number or (size,), NaN for what is missing. Raises ArgumentError for
        a sensor that is not there and a value of another size.
        """
        if sensor not in self.system.sensors:
            there = ", ".join(f"'{n}'" for n in self._names)
            raise ArgumentError(f"there is no sensor '{sensor}'; there are {there}", "sensor")
        own = self.system.sensors[sensor]
        z = np.asarray(value, float).reshape(-1)
        size = self.system.readings[sensor].size
        if z.shape != (size,):
            raise ArgumentError(f"expected {size} numbers of '{sensor}'; found shape {np.shape(value)}", "value")
        time = float(stamp) - own.lag
        if not np.isfinite(time) or time < self.oldest:
            self.refused[sensor] += 1
            return "too old" if np.isfinite(time) else "not finite"
        self._count += 1
        item = _Arrived(time, self._names.index(sensor), self._count, z)
        at = bisect_right(self._arrived, item[:3], key=lambda a: a[:3])
        late = at < len(self._arrived)
        n, used = len(self._passed), len(self._arrived)
        self._arrived.insert(at, item)
        # instants after it are made anew, and the one before it where it belongs to it
        while n and (used > at or (used == at and time - self._passed[n - 1].time <= SAME_INSTANT)):
            n -= 1
            used -= self._passed[n].readings
        kept, self._passed = self._passed, self._passed[:n]
        finite = False
        try:
            finite = self._forward(used)
        finally:  # known inputs that end raise: what was there stays whole
            if not finite:
                self._passed = kept
                del self._arrived[at]
        if not finite:
            self.refused[sensor] += 1
            return "not finite"
        self.late[sensor] += late
        self._forget()
        return "went back" if late else "applied"

    def filtered(self) -> Filtered:
        """All instants so far, as `filter.run` gives them. Raises ArgumentError where they were not recorded."""
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
        """The known inputs where the filter stands."""
        if passed:
            return passed[-1].inputs
        if self._start_inputs is None:
            self._start_inputs = self.system.inputs_at(self.inputs, self._first)
        return self._start_inputs

    def _forward(self, k: int) -> bool:
        """From the last instant that was passed over all readings from the k-th on; whether all stayed finite."""
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
        """What no reading can reach any more: an instant that all to come are later than by more than `SAME_INSTANT`,
        but for the last such one, from which the filter goes forward."""
        reachable = self.oldest - 2 * SAME_INSTANT
        n = bisect_left(self._passed, reachable, key=lambda p: p.time) - 1
        if n <= 0:
            return
        gone, self._passed = self._passed[:n], self._passed[n:]
        del self._arrived[: sum(p.readings for p in gone)]
        if self._recording:
            self._done += gone
