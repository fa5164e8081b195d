"""Kind "optimization": a person's own `Optimization` class, solved by collocation."""

from __future__ import annotations

from functools import partial

import numpy as np

from gtmodel.lang import Optimization
from gtmodel.modelica import first_guess, simulated_guess
from gtmodel.modelica.reference import is_reference
from gtmodel.optimize import Mesh, SolverOptions, optimization_study
from gtmodel.optimize.formulation.dynamic import Bounds
from gtmodel.problem_files import python_models, start as earlier
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.call import Call
from gtmodel.results import Trajectory

from .keys import Schema

NAME = "optimization"


def call(problem: Schema, context: Context) -> Call:
    """The person's optimisation. Raises InputError and ModelError for a wrong one."""
    model = _model(problem, context)
    mesh = Mesh(**problem.mesh.model_dump())
    if getattr(type(model), "_static", False) and "mesh" not in problem.model_fields_set:
        mesh = Mesh(1, points=2)  # a static optimization of a text is one of an instant
    guess = _guess(problem, context, model)
    again = partial(simulated_guess, model) if guess is None and is_reference(problem.model) else None
    return Call(
        optimization_study, model, mesh, guess=guess, second_guess=again,
        solver=SolverOptions(**problem.solver.model_dump()), title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """What is optimised: the unknowns of the discretised problem's model and their bounds."""
    from gtmodel.optimize.formulation.problem import build

    built = build(_model(problem, context), problem.solver.formulation)
    lines = [
        f"{built.flat.title}: {len(built.state_names)} states, {len(built.control_names)} controls, "
        f"{len(built.free_names)} free constants",
        f"  states: {', '.join(built.state_names) or 'none'}",
        f"  controls: {', '.join(built.control_names) or 'none'}",
        f"  free: {', '.join(built.free_names) or 'none'}",
        *(
            [f"  {built.formulation} form, unknown at each point: {', '.join(built.point_names)}"]
            if built.point_names
            else []
        ),
        f"  {len(built.path)} path constraints, {len(built.points)} point constraints, "
        f"{_held(built.start_bounds)} states bounded at the start and {_held(built.end_bounds)} at the end",
    ]
    return "\n".join(lines)


def _held(bounds: Bounds) -> int:
    return int(np.sum(np.isfinite(bounds.low) | np.isfinite(bounds.high)))


def _model(problem: Schema, context: Context) -> Optimization:
    return python_models.resolve(
        problem.model, context, "model", problem.parameters, Optimization, library=problem.library
    )


def _guess(problem: Schema, context: Context, model: Optimization) -> Trajectory | None:
    """An earlier result; of a text with free time a simulation, as its users made one by hand."""
    if context.start is None and problem.guess:
        context.start = earlier.read(context.folder / problem.guess, NAME)
    if (guess := context.guess()) is not None or not is_reference(problem.model):
        return guess
    if (guess := first_guess(model)) is not None:
        context.notes.append("the horizon is free: started from a simulation with the inputs' start values")
    return guess
