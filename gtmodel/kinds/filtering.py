"""Kind "filtering": Kalman filters with any model as process, over a log or over synthetic readings."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from gtmodel import filtering
from gtmodel.filtering import options
from gtmodel.problem_files.base import Call, Context, InputError, Problem
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.problem_files.keys import Free, RecordedSignalSection, RecordingFiles
from gtmodel.results import Trajectory
from gtmodel.results.refusal import naming

ESTIMATE: Free = "estimate"
RESULT = "gtmodel.filtering.FilterStudy"


class FilterLogSection(RecordingFiles):
    """Readings of the sensors, each with its own clock, and the known inputs, with a common clock."""

    readings: dict[str, RecordedSignalSection] = Field(description="readings, by sensor", min_length=1)
    inputs: dict[str, RecordedSignalSection] = Field(default={}, description="known inputs of the model, by name")
    rest: str | list[str] = Field(
        default="",
        description="files of a log at rest, with the same columns: for noise to estimate and start.from_rest",
    )
    rest_s: list[float] = Field(
        default=[], max_length=2, description="instead of rest: the stretch of the log that is at rest, from and to"
    )


class Schema(Problem):
    """A Kalman filter with any model: states with standard deviations, and consistency tests of the innovations."""

    model: str = Field(description="robot of the catalogue, package.module:Class, or file.py:Class")
    parameters: dict[str, Any] = Field(default={}, description="values of the model's parameters by name, in SI")
    noise: dict[str, float | list[float] | Free] = Field(
        description="input of the model -> density of white noise in (its unit)^2 s, or one per component; "
        '"estimate": by maximum likelihood of the innovations',
        min_length=1,
    )
    states: list[str] = Field(default=[], description='such as "T" and "der(T)"; the model chooses if left out')
    quaternions: list[str] = Field(default=[], description="states that are unit quaternions, scalar first")
    sensors: dict[str, Made[options.MeasuredQuantity]] = Field(description="sensors, by name", min_length=1)
    start: Made[options.FilterStart]
    filter: options.FilterName = Field(default="ekf", description="kf, ekf, iekf, ukf, particle or steady")
    smoothing: bool = Field(default=False, description="also smooth the states over the whole log")
    faults: dict[str, options.Numbers] = Field(
        default={},
        description="search for faults: SENSOR.offset, SENSOR.scale, SENSOR.delay or a parameter of the model -> its "
        "largest plausible size in SI; SENSOR.deviation and NOISE.density -> 1",
    )
    log: FilterLogSection | None = Field(default=None, description="measured readings")
    synthetic: Made[options.DrawnReadings] | None = Field(default=None, description="synthetic readings")


def arguments(problem: Schema) -> dict[str, str]:
    """Return the keys of the study's arguments."""
    rest = "log.rest" if problem.log is not None and problem.log.rest else "log.rest_s"
    noise = {f"estimate.{n}": f"noise.{n}" for n in problem.noise}
    return {"log": "synthetic" if problem.log is None else "log.readings", "system": "filter", "rest": rest, **noise}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study, on the log or on synthetic readings."""
    if context.start is not None:
        raise InputError("--start: a filter begins at its [start]; leave it out")
    if (problem.log is None) == (problem.synthetic is None):
        raise InputError(f"expected one of [log] and [synthetic]; found {'both' if problem.log else 'none'}", "log")
    readings, inputs = _read(problem, context)
    estimate = _estimated(problem)
    if estimate and problem.log is None:
        owner, _, what = estimate[0].rpartition(".")
        key = f"noise.{owner}" if what == "density" else f"sensors.{owner}.deviation"
        raise InputError("synthetic readings need the value of this noise; estimate it from a [log]", key)
    start = options_of(problem, "start")["start"]
    return Call(
        filtering.filter_study, _system(problem, context), start, readings, problem.filter, inputs=inputs,
        smoothing=problem.smoothing, estimate=estimate, rest=_rest(problem, context), faults=problem.faults,
        title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe states, noise and sensors."""
    system = _system(problem, context)
    lines = [f"{problem.heading}: {problem.filter} for {problem.model}"]
    lines += [f"  state {part.name}, {part.size} numbers [{part.unit}]" for part in system.space.parts]
    lines += [f"  noise {name}, density {density}" for name, density in problem.noise.items()]
    lines += [f"  {name} measures {sensor.quantity}" for name, sensor in system.sensors.items()]
    return "\n".join([*lines, f"  {'linear' if system.linear else 'nonlinear'}"])


def _system(problem: Schema, context: Context) -> filtering.System:
    from gtmodel.problem_files import robots  # here: the keys alone need no model

    model = robots.resolve(problem.model, context, key="model", parameters=problem.parameters)
    known = list(problem.log.inputs) if problem.log is not None else []
    noise = {name: 1.0 if value == ESTIMATE else value for name, value in problem.noise.items()}
    free = [name for name in problem.faults if name.rpartition(".")[0] not in {*problem.sensors, *problem.noise}]
    process = filtering.ProcessModel(
        model, noise, inputs=known, states=problem.states, quaternions=problem.quaternions, parameters=free
    )
    sensors = []
    for name, measured in options_of(problem, "sensors")["sensors"].items():
        with naming(f"sensors.{name}."):
            sensors.append(measured.sensor(name))
    with naming({"kind": "sensors", "parameters": "faults"}):
        return filtering.System(process, sensors)


def _estimated(problem: Schema) -> list[str]:
    """Names of the noise to estimate, sensors first."""
    sensors = [f"{name}.deviation" for name, s in problem.sensors.items() if s.given()["deviation"] == ESTIMATE]
    return sensors + [f"{name}.density" for name, value in problem.noise.items() if value == ESTIMATE]


def _rest(problem: Schema, context: Context) -> filtering.RestingLog | tuple[float, float] | None:
    """The log at rest, or the stretch of the log that is."""
    log = problem.log
    if log is None or not (log.rest or log.rest_s):
        return None
    if log.rest and log.rest_s:
        raise InputError("expected one of rest and rest_s; found both", "log.rest_s")
    if log.rest_s:
        if len(log.rest_s) != 2 or not log.rest_s[0] < log.rest_s[1]:
            raise InputError(f"expected [from, to] in s; found {log.rest_s}", "log.rest_s")
        return log.rest_s[0], log.rest_s[1]
    files = [log.rest] if isinstance(log.rest, str) else log.rest
    try:
        return filtering.RestingLog(*_recorded(log.model_copy(update={"files": files}), context, "log.rest"))
    except InputError as error:
        raise InputError(error.message, "log.rest") from error


def _read(problem: Schema, context: Context) -> tuple[Any, Trajectory | None]:
    """Readings by sensor, or the options of synthetic ones, and the known inputs."""
    log = problem.log
    if log is None:
        return options_of(problem, "synthetic")["synthetic"], None
    return _recorded(log, context)


def _recorded(
    log: FilterLogSection, context: Context, key: str = "log"
) -> tuple[dict[str, filtering.Readings], Trajectory | None]:
    """Readings by sensor, and the known inputs, from the files of the section."""
    by_name = {name: t for t in log.recording(log.readings | log.inputs, context, key).values() for name in t.names}
    clocks = {id(by_name[name]) for name in log.inputs}
    if len(clocks) > 1:
        raise InputError("have different clocks; give all inputs in one file with one time column", "log.inputs")
    readings = {name: filtering.Readings(by_name[name].time, by_name[name][name]) for name in log.readings}
    return readings, by_name[next(iter(log.inputs))].select(list(log.inputs)) if log.inputs else None
