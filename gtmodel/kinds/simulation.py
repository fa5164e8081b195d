"""Kind "simulation": the motion of a robot, or any model, under given inputs from a given start."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, PositiveFloat, Tag

from gtmodel.compiler.causal import flat_of
from gtmodel.lang import Model, ModelError
from gtmodel.problem_files.base import Check, Context, InputError, Outcome, Row, Section, at_most
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.problem_files.robots import file_of
from gtmodel.results import SolveStatus, Trajectory, TrajectoryError
from gtmodel.simulation import MOST_ROWS, MOST_STEPS, Simulation, explain_simulation, simulate

NAME = "simulation"

VALUES = {
    "end_time_s": "time reached",
    "end": "every recorded quantity at that time, by its name, in SI units",
    "states": "names of the states at that time",
    "switches": "number of changes of the states on the way",
    "chosen": "start values that the problem leaves open, by state; the initialisation chose them",
    "energy_error_J": "largest error of the energy balance; null for a model that declares no energies",
    "energy_stored_J": "energy stored at that time, beyond what was stored at the start",
    "energy_supplied_J": "energy supplied until then",
    "energy_dissipated_J": "energy dissipated until then",
}

TIGHTER = "use a smaller tolerance"
# in SI units: closed forms and polished Newton unknowns leave round-off, 1e-12 of forces up to 1e4 N
EQUATIONS = 1e-8


def _numbers(value: Any) -> Any:
    """Refuses what is neither a number nor a list of numbers, in one sentence for both."""
    entries = value if isinstance(value, list) else [value]
    if not all(isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x) for x in entries):
        raise ValueError("expected a number or a list of numbers")
    return value


def _keys(value: Any) -> Any:
    """Refuses a table that is no file input, naming the keys: an input's name is a person's, no schema knows it."""
    if isinstance(value, dict) and (wrong := [key for key in value if key not in File.model_fields]):
        raise ValueError(f"there is no key '{wrong[0]}'; there are {', '.join(File.model_fields)}")
    if isinstance(value, dict) and "file" not in value:
        raise ValueError('expected {file = "motion.csv"}')
    return value


Values = Annotated[float | list[float], BeforeValidator(_numbers)]


class File(Section):
    """An input from a trajectory file."""

    file: str = Field(description="CSV file as gtmodel writes it; the path starts at the problem's folder")
    signal: str = Field(default="", description="its name in the file, where that is another one")
    interpolation: Literal["linear", "previous", "cubic"] = Field(
        default="linear", description="between rows; previous holds each row, cubic has two derivatives"
    )


Input = Annotated[
    Annotated[Values, Tag("numbers")] | Annotated[File, BeforeValidator(_keys), Tag("a table")],
    Discriminator(lambda value: "a table" if isinstance(value, (dict, File)) else "numbers"),
]


class Schema(RobotProblem):
    """Simulation of a robot. Quantities go by the model's own names, such as T, "der(T)" or "arm[0].rod.tension"."""

    final_time_s: PositiveFloat = Field(description="when the simulation ends; it starts at 0")
    step_s: PositiveFloat | None = Field(
        default=None, description="interval of the recorded rows; a 500th of the run if it is left out"
    )
    max_step_s: PositiveFloat | None = Field(
        default=None, description="longest step of the integrator; none if it is left out"
    )
    tolerance: float = Field(default=1e-9, ge=1e-14, le=0.1, description="of the integrator, relative and absolute")
    method: Literal["bdf", "adams"] = Field(default="bdf", description="adams for smooth motion at tight tolerances")
    prefer: list[str] = Field(default=[], description="names to keep as states, as long as they are good for it")
    outputs: list[str] = Field(default=[], description="further names to record")
    start: dict[str, Values] = Field(default={}, description="start values by name, in SI units")
    inputs: dict[str, Input] = Field(
        default={}, description='by name: a number, a list, or {file = "motion.csv"}; in SI units'
    )


def solve(problem: Schema, context: Context) -> Outcome:
    """Simulate, keeping what there is when it ends early."""
    if context.start is not None:
        raise InputError("--start: a simulation begins at its [start]; give the values there")
    model = problem.model(context)
    _check_names(problem, model)
    inputs = _inputs(problem, context)

    def progress(time: float) -> bool:
        context.progress("simulating", time / problem.final_time_s, {"time_s": time})
        return context.interrupted()

    simulation = simulate(
        model,
        problem.final_time_s,
        inputs=inputs,
        start=problem.start,
        step=_step(problem),
        max_step=problem.max_step_s,
        outputs=problem.outputs,
        prefer=problem.prefer,
        tolerance=problem.tolerance,
        method=problem.method,
        progress=progress,
        throw=False,
    )
    return _outcome(problem, simulation)


def explain(problem: Schema, context: Context) -> str:
    """States with their start values, and how their rates follow from them and the inputs."""
    model = problem.model(context)
    _check_names(problem, model)
    text = explain_simulation(
        model,
        inputs=_inputs(problem, context),
        start=problem.start,
        prefer=problem.prefer,
        tolerance=problem.tolerance,
        method=problem.method,
    )
    return f"{problem.title or 'simulation'}: {problem.final_time_s:g} s\n{text}"


def _check_names(problem: Schema, model: Model) -> None:
    flat = flat_of(model)
    lists = {"start": problem.start, "inputs": problem.inputs, "outputs": problem.outputs, "prefer": problem.prefer}
    for key, names in lists.items():
        for n, name in enumerate(names):
            try:
                flat.lookup(name)
            except ModelError as error:
                place = f"{key}.{name}" if isinstance(names, Mapping) else f"{key}[{n}]"
                raise InputError(str(error), place) from error


def _step(problem: Schema) -> float | None:
    if problem.step_s is not None and problem.step_s > problem.final_time_s:
        raise InputError(f"{problem.step_s:g} s is longer than the run of {problem.final_time_s:g} s", "step_s")
    for key, most in (("step_s", MOST_ROWS), ("max_step_s", MOST_STEPS)):
        value = getattr(problem, key)
        if value is not None and problem.final_time_s / value > most:
            raise InputError(f"{value:g} s is too short: the run has at most {most} of them", key)
    return problem.step_s


def _inputs(problem: Schema, context: Context) -> dict[str, Any]:
    """Inputs as `simulate` takes them; files are read and entered into the context."""
    found: dict[str, Any] = {}
    for name, value in problem.inputs.items():
        if not isinstance(value, File):
            found[name] = value
            continue
        key = f"inputs.{name}.file"
        path = file_of(value.file, context)
        if path is None:
            raise InputError(f"there is no file '{value.file}' in {context.folder} or here", key)
        context.take(f"inputs.{name}", Path(path))
        signal = value.signal or name
        try:
            trajectory = Trajectory.from_csv(path)
            renamed = Trajectory(trajectory.time, {name: trajectory[signal]}, {name: trajectory.unit(signal)})
        except (TrajectoryError, KeyError) as error:
            raise InputError(str(error), key) from error
        found[name] = (renamed, value.interpolation)
    return found


def _outcome(problem: Schema, simulation: Simulation) -> Outcome:
    title = problem.title or f"simulation of {problem.robot}"
    if not simulation.status.ok:
        title += f" ({simulation.status.value})"
    recorded = simulation.trajectory
    trajectory = Trajectory(
        recorded.time, {n: recorded[n] for n in recorded.names}, recorded.units, title=title, provenance={}
    )
    checks = _checks(simulation)
    values = _values(simulation)
    figures = {"signals": lambda: _signals(trajectory, simulation)}
    if simulation.energy_error is not None:
        figures["energy"] = lambda: _energy(trajectory)
    whole = simulation.status.converged  # its failed checks are the outcome's
    return Outcome(
        status=SolveStatus.SOLVED if whole else simulation.status,
        message=simulation.message,
        checks=checks,
        values=values,
        trajectory=trajectory,
        rows=_rows(simulation, values),
        figures=figures,
    )


def _checks(simulation: Simulation) -> dict[str, Check]:
    checks = {"equations_residual": at_most(simulation.residual, EQUATIONS, TIGHTER)}
    for name, check in simulation.checks.items():
        checks[name] = at_most(check.value, check.bound or 0.0, check.advice)
    return checks


def _values(simulation: Simulation) -> dict[str, Any]:
    t = simulation.trajectory
    energies: dict[str, float | None] = dict.fromkeys(("stored", "supplied", "dissipated"))
    if simulation.energy_error is not None:
        energies = {k: float(t[f"energy.{k}"][-1] - t[f"energy.{k}"][0]) for k in energies}
    return {
        "end_time_s": float(t.time[-1]),
        "end": {name: t[name][-1] for name in t.names if not name.startswith("energy.")},
        "states": list(simulation.states),
        "switches": len(simulation.switches),
        "chosen": simulation.chosen,
        "energy_error_J": simulation.energy_error,
        **{f"energy_{k}_J": value for k, value in energies.items()},
    }


def _rows(simulation: Simulation, values: dict[str, Any]) -> list[Row]:
    t = simulation.trajectory
    rows = [Row("end time", values["end_time_s"], "s")]
    rows += [Row(f"{name} at the end", x, t.unit(name)) for name, x in values["end"].items() if "." not in name]
    rows += [Row("states", ", ".join(values["states"]) or "none")]
    rows += [Row(f"chosen start of {name}", x) for name, x in values["chosen"].items()]
    if simulation.switches:
        rows.append(Row("changes of states", values["switches"]))
    if simulation.energy_error is not None:
        rows += [Row(f"energy {k}", values[f"energy_{k}_J"], "J") for k in ("stored", "supplied", "dissipated")]
        rows.append(Row("error of the energy balance", simulation.energy_error, "J"))
    return rows


def _signals(trajectory: Trajectory, simulation: Simulation) -> Any:
    from gtmodel.plot.signals import signals_figure

    return signals_figure(trajectory, marks=[s.time for s in simulation.switches])


def _energy(trajectory: Trajectory) -> Any:
    from gtmodel.plot.signals import energy_figure

    return energy_figure(trajectory)
