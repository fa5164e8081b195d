"""Kind "filtering": any model as the process of a filter, with sensors over a log, or over synthetic readings."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from gtmodel import filtering
from gtmodel.filtering import options
from gtmodel.problem_files.base import Call, Context, InputError, Problem
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.problem_files.keys import RecordedSignalSection, RecordingFiles
from gtmodel.results import Trajectory
from gtmodel.results.refusal import naming

RESULT = "gtmodel.filtering.FilterStudy"


class FilterLogSection(RecordingFiles):
    """What the sensors read, each by its own clock, and the known inputs, which have one in common."""

    readings: dict[str, RecordedSignalSection] = Field(description="by sensor", min_length=1)
    inputs: dict[str, RecordedSignalSection] = Field(default={}, description="known inputs of the model, by name")


class Schema(Problem):
    """A filter of any model: states with deviations, and whether its innovations allow to believe it."""

    model: str = Field(description="robot of the catalogue, package.module:Class, or file.py:Class")
    parameters: dict[str, Any] = Field(default={}, description="of the model, by its own names, in SI")
    noise: dict[str, options.Numbers] = Field(
        description="input of the model -> density of white noise in (its unit)^2 s, or one per component", min_length=1
    )
    states: list[str] = Field(default=[], description='such as "T" and "der(T)"; the model\'s own choice if left out')
    quaternions: list[str] = Field(default=[], description="of the states, unit quaternions, scalar first")
    sensors: dict[str, Made[options.MeasuredQuantity]] = Field(description="by name", min_length=1)
    start: Made[options.FilterStart]
    filter: options.FilterName = Field(default="ekf", description="kf, ekf, iekf, ukf, particle or steady")
    smoothing: bool = Field(default=False, description="states from the whole log besides")
    log: FilterLogSection | None = Field(default=None, description="what was measured")
    synthetic: Made[options.DrawnReadings] | None = Field(default=None, description="in place of [log]")


NAME = "filtering"


def arguments(problem: Schema) -> dict[str, str]:
    """Where the study's arguments stand."""
    return {"log": "synthetic" if problem.log is None else "log.readings", "system": "filter"}


def call(problem: Schema, context: Context) -> Call:
    """The study of the log, or of synthetic readings."""
    if context.start is not None:
        raise InputError("--start: a filter begins at its [start]; leave it out")
    if (problem.log is None) == (problem.synthetic is None):
        raise InputError(f"expected one of [log] and [synthetic]; found {'both' if problem.log else 'none'}", "log")
    given, inputs = _read(problem, context)
    start = options_of(problem, "start")["start"]
    return Call(
        filtering.filter_study, _system(problem, context), start, given, problem.filter, inputs=inputs,
        smoothing=problem.smoothing, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """States, noise, and what each sensor measures."""
    system = _system(problem, context)
    lines = [f"{problem.title or NAME}: {problem.filter} of {problem.model}"]
    lines += [f"  state {part.name}, {part.size} numbers [{part.unit}]" for part in system.space.parts]
    lines += [f"  noise {name} of density {density}" for name, density in problem.noise.items()]
    lines += [f"  {name} measures {sensor.quantity}" for name, sensor in system.sensors.items()]
    return "\n".join([*lines, f"  {'linear' if system.linear else 'not linear'}"])


def _system(problem: Schema, context: Context) -> filtering.System:
    from gtmodel.problem_files import robots  # here: the keys alone need no model

    model = robots.resolve(problem.model, context, key="model", parameters=problem.parameters)
    known = list(problem.log.inputs) if problem.log is not None else []
    process = filtering.ProcessModel(
        model, problem.noise, inputs=known, states=problem.states, quaternions=problem.quaternions
    )
    sensors = []
    for name, measured in options_of(problem, "sensors")["sensors"].items():
        with naming(f"sensors.{name}."):
            sensors.append(measured.sensor(name))
    with naming({"kind": "sensors"}):
        return filtering.System(process, sensors)


def _read(problem: Schema, context: Context) -> tuple[Any, Trajectory | None]:
    """Readings by sensor, or the options of synthetic ones, and the known inputs."""
    log = problem.log
    if log is None:
        return options_of(problem, "synthetic")["synthetic"], None
    columns = {name: signal.recorded() for name, signal in (*log.readings.items(), *log.inputs.items())}
    by_name = {name: t for t in log.recording(columns, context).values() for name in t.names}
    clocks = {id(by_name[name]) for name in log.inputs}
    if len(clocks) > 1:
        raise InputError("have several clocks; give them in one table", "log.inputs")
    readings = {name: filtering.Readings(by_name[name].time, by_name[name][name]) for name in log.readings}
    return readings, by_name[next(iter(log.inputs))].select(list(log.inputs)) if log.inputs else None
