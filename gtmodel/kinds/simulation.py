"""Kind "simulation": the motion of a robot, or any model, under given inputs from a given start."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, PositiveFloat, Tag

from gtmodel import modelica, problem_files, simulation
from gtmodel.modelica.reference import is_reference
from gtmodel.problem_files.base import Call, Context, FileSection, InputError
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.results import Trajectory, TrajectoryError

RESULT = "gtmodel.simulation.SimulationStudy"


def _numbers(value: Any) -> Any:
    """Refuse anything but a number or a list of numbers, with one sentence."""
    entries = value if isinstance(value, list) else [value]
    if not all(isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x) for x in entries):
        raise ValueError("expected a number or a list of numbers")
    return value


def _keys(value: Any) -> Any:
    """Refuse a table that is not a file input, and name the valid keys."""
    if isinstance(value, dict) and (wrong := [key for key in value if key not in File.model_fields]):
        raise ValueError(f"there is no key '{wrong[0]}'; there are {', '.join(File.model_fields)}")
    if isinstance(value, dict) and "file" not in value:
        raise ValueError('expected {file = "motion.csv"}')
    return value


Values = Annotated[float | list[float], BeforeValidator(_numbers)]


class File(FileSection):
    """An input from a trajectory file."""

    file: str = Field(description="CSV file in the format that gtmodel writes; the path starts at the problem's folder")
    signal: str = Field(default="", description="name of the signal in the file; the input's name if left out")
    interpolation: Literal["linear", "previous", "cubic"] = Field(
        default="linear",
        description="interpolation between rows; previous is a zero-order hold, cubic has two continuous derivatives",
    )


Input = Annotated[
    Annotated[Values, Tag("numbers")] | Annotated[File, BeforeValidator(_keys), Tag("a table")],
    Discriminator(lambda value: "a table" if isinstance(value, (dict, File)) else "numbers"),
]


class Schema(RobotProblem):
    """Simulation of a robot. Variables have the model's names, such as T, "der(T)" or "arm[0].rod.tension"."""

    final_time_s: PositiveFloat = Field(description="end of the simulation, which starts at 0")
    step_s: PositiveFloat | None = Field(
        default=None, description="interval of the recorded rows; final_time_s / 500 if left out"
    )
    max_step_s: PositiveFloat | None = Field(
        default=None, description="longest step of the integrator; no limit if left out"
    )
    tolerance: float = Field(
        default=1e-9, ge=1e-14, le=0.1, description="tolerance of the integrator, relative and absolute"
    )
    flattener: Literal["gtmodel", "rumoca"] = Field(
        default="gtmodel", description="flattener of a Modelica class; rumoca is a separate package, for models only"
    )
    method: Literal["bdf", "adams"] = Field(
        default="bdf", description="integration method; adams for smooth motion at tight tolerances"
    )
    prefer: list[str] = Field(default=[], description="names to keep as states, if possible")
    outputs: list[str] = Field(default=[], description="further names to record")
    keep: list[str] | None = Field(
        default=None, description="names to record instead of the usual ones; outputs and energies are recorded too"
    )
    start: dict[str, Values] = Field(default={}, description="start values by name, in SI units")
    inputs: dict[str, Input] = Field(
        default={}, description='by name: a number, a list, or {file = "motion.csv"}; in SI units'
    )


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the simulation."""
    if context.start is not None:
        raise InputError("--start: a simulation starts at its [start]; give the values there")
    model = problem.model(context) if problem.flattener == "gtmodel" else _flattened(problem, context)
    simulation.study.refuse_unknown(model, inputs=problem.inputs)  # before files are read
    inputs = _inputs(problem, context)
    if (
        is_reference(problem.robot)
        and (constant := modelica.held_inputs(model)).keys() >= inputs.keys()
        and len(constant) > len(inputs)
    ):
        context.notes.append(f"held at their start values: {', '.join(n for n in constant if n not in inputs)}")
        inputs = constant | inputs
    return Call(
        simulation.simulation_study, model, problem.final_time_s, inputs=inputs,
        start=problem.start, step=problem.step_s, max_step=problem.max_step_s, outputs=problem.outputs,
        keep=problem.keep, prefer=problem.prefer, tolerance=problem.tolerance, method=problem.method,
        title=problem.title or f"simulation of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the states with their start values, and how their rates follow from states and inputs."""
    study = call(problem, context)
    model, _ = study.arguments
    options = {name: study.options[name] for name in ("start", "inputs", "outputs", "prefer")}
    simulation.study.refuse_unknown(model, **options)
    del options["outputs"]
    text = simulation.explain_simulation(
        model, **options, tolerance=problem.tolerance, method=problem.method, full=context.full
    )
    return f"{problem.heading}: {problem.final_time_s:g} s\n{text}"


def _flattened(problem: Schema, context: Context) -> Any:
    """A class of a Modelica text, flattened by another program."""
    if not is_reference(problem.robot):
        raise InputError(f"'{problem.robot}' is not a Modelica class; leave flattener out", "flattener")
    return problem_files.python_models.resolve(
        problem.robot, context, "robot", problem.parameters, flattener=problem.flattener
    )


def _inputs(problem: Schema, context: Context) -> dict[str, Any]:
    """Inputs for `simulate`; files are read and recorded in the context."""
    inputs: dict[str, Any] = {}
    for name, value in problem.inputs.items():
        if not isinstance(value, File):
            inputs[name] = value
            continue
        key = f"inputs.{name}.file"
        path = context.file(value.file, key, f"inputs.{name}")
        signal = value.signal or name
        try:
            trajectory = Trajectory.from_csv(path)
            renamed = Trajectory(trajectory.time, {name: trajectory[signal]}, {name: trajectory.unit(signal)})
        except (TrajectoryError, KeyError) as error:
            raise InputError(str(error), key) from error
        inputs[name] = (renamed, value.interpolation)
    return inputs
