"""Kind "simulation": the motion of a robot, or any model, under given inputs from a given start."""

from __future__ import annotations

from typing import Any

from gtmodel.modelica import held_inputs
from gtmodel.modelica.reference import is_reference
from gtmodel.problem_files import python_models
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.results import Trajectory, TrajectoryError
from gtmodel.simulation import explain_simulation, simulation_study
from gtmodel.simulation.study import refuse_unknown

from .keys import File, Schema

NAME = "simulation"


def call(problem: Schema, context: Context) -> Call:
    """The motion, keeping what there is when it ends early."""
    if context.start is not None:
        raise InputError("--start: a simulation begins at its [start]; give the values there")
    model = problem.model(context) if problem.flattener == "gtmodel" else _flattened(problem, context)
    refuse_unknown(model, inputs=problem.inputs)  # before files are read
    inputs = _inputs(problem, context)
    if is_reference(problem.robot) and (held := held_inputs(model)).keys() >= inputs.keys() and len(held) > len(inputs):
        context.notes.append(f"held at their start values: {', '.join(n for n in held if n not in inputs)}")
        inputs = held | inputs
    return Call(
        simulation_study, model, problem.final_time_s, inputs=inputs,
        start=problem.start, step=problem.step_s, max_step=problem.max_step_s, outputs=problem.outputs,
        prefer=problem.prefer, tolerance=problem.tolerance, method=problem.method,
        title=problem.title or f"simulation of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """States with their start values, and how their rates follow from them and the inputs."""
    made = call(problem, context)
    model, _ = made.arguments
    given = {name: made.options[name] for name in ("start", "inputs", "outputs", "prefer")}
    refuse_unknown(model, **given)
    del given["outputs"]
    text = explain_simulation(model, **given, tolerance=problem.tolerance, method=problem.method)
    return f"{problem.title or NAME}: {problem.final_time_s:g} s\n{text}"


def _flattened(problem: Schema, context: Context) -> Any:
    """A class of a Modelica text, flattened by another program."""
    if not is_reference(problem.robot):
        raise InputError(f"'{problem.robot}' is no class of a Modelica text; leave flattener out", "flattener")
    return python_models.resolve(problem.robot, context, "robot", problem.parameters, flattener=problem.flattener)


def _inputs(problem: Schema, context: Context) -> dict[str, Any]:
    """Inputs as `simulate` takes them; files are read and entered into the context."""
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
