"""Noise and initial state of a filter from a log: from its rest, and by maximum likelihood of the innovations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..results.refusal import ArgumentError, naming
from ..results.trajectory import Trajectory
from .belief import InitialState, Readings, instants, readings_of
from .resting import RestingLog, SensorAtRest, sensor_at_rest, start_from_rest
from .system import System
from .tuning import first_guess, shortened, tune

MOST = 5000  # instants whose likelihood is maximised: deviations are then known to 1 %


@dataclass(frozen=True, eq=False)
class NoiseEstimate:
    """Noise and initial state from a log.

    system: with this noise. initial: initial state. readings: to filter, without the rest if the start is from it.
    values, low, high: name, "NOISE.density" or "SENSOR.deviation" -> estimate and ends of its 95 % interval, one number
    per component. sources: name -> "rest" or "likelihood". undetermined, notes: as in `Tuned`.
    """

    system: System
    initial: InitialState
    readings: Mapping[str, Readings]
    values: dict[str, list[float]] = field(default_factory=dict)
    low: dict[str, list[float]] = field(default_factory=dict)
    high: dict[str, list[float]] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    undetermined: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def estimate_noise(
    system: System,
    readings: Mapping[str, Readings],
    start: InitialState,
    names: Sequence[str],
    *,
    rest: RestingLog | tuple[float, float] | None = None,
    from_rest: bool = False,
    inputs: Trajectory | None = None,
    progress: Callable[[float], bool] | None = None,
) -> NoiseEstimate:
    """Return the system with estimated noise, and the initial state.

    Args:
        system: process and sensors; the declared values of the estimated noise are not used.
        readings: log, by sensor.
        start: initial state; with `from_rest`, only of the states that are not to come from the rest.
        names: noise to estimate, "SENSOR.deviation" and "NOISE.density". Deviations come from the rest, if there is
            one; all others by maximum likelihood of the innovations.
        rest: a log at rest, or a stretch of the log in which all states are constant [s].
        from_rest: whether the initial state is that at rest. The readings up to the end of a stretch are then not
            filtered, since the initial state already holds them.
        inputs: known inputs of the process.
        progress: called with the fraction done; if it returns True, the search ends with the best noise so far.

    Raises ArgumentError for an unknown name, and for a log that does not show a noise or a state at all.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=1.0)])
    >>> noise = 0.02 * np.random.default_rng(1).standard_normal(200)  # synthetic: seed 1
    >>> log = {"tape": gt.filtering.Readings(0.1 * np.arange(200), 0.3 + noise)}
    >>> start = gt.filtering.InitialState({}, {})
    >>> estimate = gt.filtering.estimate_noise(
    ...     system, log, start, ["tape.deviation"], rest=(0.0, 10.0), from_rest=True
    ... )
    >>> bool(abs(estimate.values["tape.deviation"][0] / 0.02 - 1) < 0.25)  # 100 readings: 7 %
    True
    >>> estimate.sources, round(float(estimate.initial.mean["x"]), 2)
    ({'tape.deviation': 'rest'}, 0.3)
    """
    tunable = [*(f"{n}.density" for n in system.process.noise), *(f"{n}.deviation" for n in system.sensors)]
    for name in names:
        if name not in tunable:
            raise ArgumentError(f"there is no '{name}' to estimate; expected one of {', '.join(tunable)}", "estimate")
    if from_rest and rest is None:
        raise ArgumentError("a start from rest needs a log at rest, or a stretch of the log", "start.from_rest")
    quiet, moving, gap = _split(system, readings, rest, inputs, from_rest)
    at_rest: dict[str, SensorAtRest] = {}
    if quiet is not None:
        wanted = [n for n in system.sensors if f"{n}.deviation" in names or (from_rest and n in quiet.readings)]
        at_rest = {n: sensor_at_rest(system, quiet, n) for n in wanted}
    values, low, high, sources, notes = {}, {}, {}, {}, []
    for name, sensor in at_rest.items():
        if (key := f"{name}.deviation") in names:
            values[key], low[key], high[key] = (v.tolist() for v in (sensor.deviation, sensor.low, sensor.high))
            sources[key] = "rest"
            notes += sensor.notes
    system = system.with_(deviations={n.removesuffix(".deviation"): v for n, v in values.items()})

    def initial_of(system: System) -> InitialState:
        if not from_rest or quiet is None:
            return start
        initial, more = start_from_rest(system, quiet, at_rest, start, gap)
        notes.extend(more)
        return initial

    initial, undetermined = initial_of(system), ()
    likely = [n for n in names if n not in values]
    if likely:
        system = first_guess(system, moving, initial, likely, inputs=inputs)
        initial = initial_of(system)
        part = shortened(system, moving, MOST)
        if len(plan := instants(system, moving)) > MOST:
            notes.append(
                f"the likelihood uses the first {MOST} of {len(plan)} instants, up to {plan[MOST - 1].time:.4g} s"
            )
        tuned = tune(system, part, initial, likely, inputs=inputs, progress=progress)
        for name in likely:
            value = np.atleast_1d(np.asarray(tuned.values[name], float))
            value = np.diag(value) if value.ndim == 2 else value
            ends = np.array(tuned.intervals[name]) / tuned.factors[name]
            values[name], low[name], high[name] = (v.tolist() for v in (value, value * ends[0], value * ends[1]))
            sources[name] = "likelihood"
        system, undetermined = tuned.system, tuned.undetermined
        initial = initial_of(system)
        notes += tuned.notes
    return NoiseEstimate(
        system, initial, moving, values, low, high, sources, undetermined, tuple(dict.fromkeys(notes))
    )  # fmt: skip


def _split(
    system: System,
    readings: Mapping[str, Readings],
    rest: RestingLog | tuple[float, float] | None,
    inputs: Trajectory | None,
    from_rest: bool,
) -> tuple[RestingLog | None, Mapping[str, Readings], float]:
    """The log at rest, the readings to filter, and the time between them [s]."""
    if rest is None:
        return None, readings, 0.0
    moments = [m.time for m in instants(system, readings)]
    if isinstance(rest, RestingLog):
        with naming({"log": "rest"}):
            rest = RestingLog(readings_of(system, rest.readings), rest.inputs)
        return rest, readings, (moments[-1] - moments[0]) / max(1, len(moments) - 1)
    begin, end = rest
    if not begin < end:
        raise ArgumentError(f"expected a begin before the end; found {begin:g} to {end:g} s", "rest")
    quiet, moving = {}, {}
    for name, r in readings.items():
        taken = r.time - system.sensors[name].lag
        inside, after = (taken >= begin) & (taken <= end), taken > end
        if inside.any():
            quiet[name] = Readings(r.time[inside], r.values[..., inside, :])
        if after.any():
            moving[name] = Readings(r.time[after], r.values[..., after, :])
    if not quiet:
        raise ArgumentError(
            f"there are no readings from {begin:g} to {end:g} s; the log has them from {moments[0]:g} to "
            f"{moments[-1]:g} s",
            "rest",
        )
    if not from_rest:
        moving = readings
    elif not moving:
        raise ArgumentError(f"there are no readings after the rest, which ends at {end:g} s", "rest")
    known = None
    if system.dynamics.inputs and inputs is not None:
        rows = (inputs.time >= begin) & (inputs.time <= end)
        if np.count_nonzero(rows) < 2:
            raise ArgumentError(f"the known inputs have no rows from {begin:g} to {end:g} s", "rest")
        known = Trajectory(inputs.time[rows], {n: inputs[n][rows] for n in inputs.names})
    first = min(float((r.time - system.sensors[n].lag).min()) for n, r in moving.items())
    last = max(float((r.time - system.sensors[n].lag).max()) for n, r in quiet.items())
    return RestingLog(quiet, known), moving, max(0.0, first - last)
