"""Kind "optimization": an `Optimization` class of the user, solved by collocation."""

from __future__ import annotations

from functools import partial
from typing import Any, Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from gtmodel import lang, modelica, optimize, problem_files
from gtmodel.modelica.reference import is_reference
from gtmodel.optimize import Mesh
from gtmodel.problem_files import start as earlier
from gtmodel.problem_files.base import Call, Context, FileSection, Problem
from gtmodel.results import Trajectory

RESULT = "gtmodel.optimize.OptimizationStudy"


class MeshSection(FileSection):
    """Mesh of the collocation."""

    elements: PositiveInt = Field(default=50, le=10000, description="number of elements of the horizon")
    points: int = Field(default=3, ge=1, le=9, description="collocation points per element")
    scheme: Literal["radau", "gauss"] = Field(default="radau", description="points of an element")
    control: Literal["polynomial", "bernstein", "linear", "constant"] = Field(
        default="polynomial",
        description="controls on an element: polynomial, bounded at the collocation points; bernstein, a polynomial "
        "bounded at every instant; linear, continuous; or constant",
    )


class SolverSection(FileSection):
    """Form of the problem and termination of the solver."""

    formulation: Literal["auto", "inverse", "explicit", "torn", "dae"] = Field(
        default="auto",
        description="eliminated variables: auto, as the model suggests; inverse, the controls, from the motion; "
        "explicit, all but states and controls; torn, all but unknowns without a closed form; dae, none",
    )

    tolerance: PositiveFloat = Field(default=1e-8, description="tolerance of the scaled optimality conditions")
    max_iterations: PositiveInt = Field(
        default=1000, description="limit of iterations, in total if there are two tries"
    )
    barrier: Literal["auto", "adaptive", "monotone"] = Field(
        default="auto", description="IPOPT's barrier strategy; auto: adaptive, then monotone if that fails"
    )
    compile: bool = Field(
        default=False, description="compile the elements: same optimum, faster if the problem is solved repeatedly"
    )


class Schema(Problem):
    """A dynamic optimisation problem, written in Python or in Optimica."""

    model: str = Field(
        description="the Optimization: package.module:Class or file.py:Class; or an Optimica class, file.mop:Class"
    )
    library: list[str] = Field(
        default=[], description="files and folders with further Modelica classes, besides those in MODELICAPATH"
    )
    guess: str = Field(default="", description="result.json, or its folder, of an earlier run to start from")
    parameters: dict[str, Any] = Field(default={}, description="values of the model's parameters by name, in SI")
    mesh: MeshSection = MeshSection.left_out()
    solver: SolverSection = SolverSection.left_out()


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the optimisation. Raises InputError and ModelError if the model is wrong."""
    model = _model(problem, context)
    mesh = Mesh(**problem.mesh.model_dump())
    if getattr(type(model), "_static", False) and "mesh" not in problem.model_fields_set:
        mesh = Mesh(1, points=2)  # a static Optimica problem has no time
    guess = _guess(problem, context, model)
    again = partial(modelica.simulated_guess, model) if guess is None and is_reference(problem.model) else None
    return Call(
        optimize.optimization_study, model, mesh, guess=guess, second_guess=again,
        solver=optimize.SolverOptions(**problem.solver.model_dump()), title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the optimisation: unknowns, constraints and bounds."""
    from gtmodel.optimize.formulation.problem import build  # here: the keys alone need no engine

    built = build(_model(problem, context), problem.solver.formulation)
    bounded = [int(np.sum(np.isfinite(b.low) | np.isfinite(b.high))) for b in (built.start_bounds, built.end_bounds)]
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
        f"{bounded[0]} states bounded at the start and {bounded[1]} at the end",
        "  a constraint on one variable alone, such as x <= 1, is used as a bound and is not counted",
    ]
    return "\n".join(lines)


def _model(problem: Schema, context: Context) -> lang.Optimization:
    return problem_files.python_models.resolve(
        problem.model, context, "model", problem.parameters, lang.Optimization, library=problem.library
    )


def _guess(problem: Schema, context: Context, model: lang.Optimization) -> Trajectory | None:
    """An earlier result; for an Optimica problem with free time, a simulation."""
    if context.start is None and problem.guess:
        context.start = earlier.read(context.folder / problem.guess, problem.kind)
    if (guess := context.guess()) is not None or not is_reference(problem.model):
        return guess
    if (guess := modelica.first_guess(model)) is not None:
        context.notes.append(
            f"the horizon is free: the first guess is a simulation from {guess.time[0]:g} s to {guess.time[-1]:g} s, "
            "inputs held at their initialGuess or start value; an initialGuess of a state counts at the start only"
        )
    return guess
