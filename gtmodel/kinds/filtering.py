"""Kind "filtering": Kalman filters with any model as process, over a log or over synthetic readings."""

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
    """Readings of the sensors, each with its own clock, and the known inputs, with a common clock."""

    readings: dict[str, RecordedSignalSection] = Field(description="readings, by sensor", min_length=1)
    inputs: dict[str, RecordedSignalSection] = Field(default={}, description="known inputs of the model, by name")


class Schema(Problem):
    """A Kalman filter with any model: states with standard deviations, and consistency tests of the innovations."""

    model: str = Field(description="robot of the catalogue, package.module:Class, or file.py:Class")
    parameters: dict[str, Any] = Field(default={}, description="values of the model's parameters by name, in SI")
    noise: dict[str, options.Numbers] = Field(
        description="input of the model -> density of white noise in (its unit)^2 s, or one per component", min_length=1
    )
    states: list[str] = Field(default=[], description='such as "T" and "der(T)"; the model chooses if left out')
    quaternions: list[str] = Field(default=[], description="states that are unit quaternions, scalar first")
    sensors: dict[str, Made[options.MeasuredQuantity]] = Field(description="sensors, by name", min_length=1)
    start: Made[options.FilterStart]
    filter: options.FilterName = Field(default="ekf", description="kf, ekf, iekf, ukf, particle or steady")
    smoothing: bool = Field(default=False, description="also smooth the states over the whole log")
    log: FilterLogSection | None = Field(default=None, description="measured readings")
    synthetic: Made[options.DrawnReadings] | None = Field(default=None, description="synthetic readings")


def arguments(problem: Schema) -> dict[str, str]:
    """Return the keys of the study's arguments."""
    return {"log": "synthetic" if problem.log is None else "log.readings", "system": "filter"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study, on the log or on synthetic readings."""
    if context.start is not None:
        raise InputError("--start: a filter begins at its [start]; leave it out")
    if (problem.log is None) == (problem.synthetic is None):
        raise InputError(f"expected one of [log] and [synthetic]; found {'both' if problem.log else 'none'}", "log")
    readings, inputs = _read(problem, context)
    start = options_of(problem, "start")["start"]
    return Call(
        filtering.filter_study, _system(problem, context), start, readings, problem.filter, inputs=inputs,
        smoothing=problem.smoothing, title=problem.title,
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
    by_name = {name: t for t in log.recording(log.readings | log.inputs, context).values() for name in t.names}
    clocks = {id(by_name[name]) for name in log.inputs}
    if len(clocks) > 1:
        raise InputError("have different clocks; give all inputs in one file with one time column", "log.inputs")
    readings = {name: filtering.Readings(by_name[name].time, by_name[name][name]) for name in log.readings}
    return readings, by_name[next(iter(log.inputs))].select(list(log.inputs)) if log.inputs else None
