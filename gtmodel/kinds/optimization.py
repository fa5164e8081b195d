"""Kind "optimization": a person's own `Optimization` class, solved by collocation."""

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
    """Where the equations are collocated."""

    elements: PositiveInt = Field(default=50, le=10000, description="number of elements of the horizon")
    points: int = Field(default=3, ge=1, le=9, description="collocation points per element")
    scheme: Literal["radau", "gauss"] = Field(default="radau", description="where the points of an element lie")
    control: Literal["polynomial", "bernstein", "linear", "constant"] = Field(
        default="polynomial",
        description="per element: a polynomial bounded at its points only, one bounded at every instant (bernstein), "
        "a continuous line, or one value",
    )


class SolverSection(FileSection):
    """In which form the problem is solved, and when the solver stops."""

    formulation: Literal["auto", "inverse", "explicit", "torn", "dae"] = Field(
        default="auto",
        description="what is eliminated: as the model suggests, controls by the motion, all but states and controls, "
        "all but unknowns without a closed form, or nothing",
    )

    tolerance: PositiveFloat = Field(default=1e-8, description="on the scaled optimality conditions")
    max_iterations: PositiveInt = Field(
        default=1000, description="limit of iterations, of both tries where there are two"
    )
    barrier: Literal["auto", "adaptive", "monotone"] = Field(
        default="auto", description="how IPOPT lowers its barrier; auto: adaptive, and monotone where that fails"
    )
    compile: bool = Field(
        default=False, description="the elements as machine code: the same optimum, sooner where it is solved again"
    )


class Schema(Problem):
    """A dynamic optimisation problem written in Python, or in Optimica text."""

    model: str = Field(
        description="the Optimization: package.module:Class or file.py:Class; or a class of a text, file.mop:Class"
    )
    library: list[str] = Field(
        default=[], description="of a text: files and folders with further classes, beside those of MODELICAPATH"
    )
    guess: str = Field(default="", description="result.json, or its folder, of an earlier run to start from")
    parameters: dict[str, Any] = Field(
        default={}, description="modifiers of the model, by its own parameter names, in SI"
    )
    mesh: MeshSection = MeshSection.left_out()
    solver: SolverSection = SolverSection.left_out()


NAME = "optimization"


def call(problem: Schema, context: Context) -> Call:
    """The person's optimisation. Raises InputError and ModelError for a wrong one."""
    model = _model(problem, context)
    mesh = Mesh(**problem.mesh.model_dump())
    if getattr(type(model), "_static", False) and "mesh" not in problem.model_fields_set:
        mesh = Mesh(1, points=2)  # a static optimization of a text is one of an instant
    guess = _guess(problem, context, model)
    again = partial(modelica.simulated_guess, model) if guess is None and is_reference(problem.model) else None
    return Call(
        optimize.optimization_study, model, mesh, guess=guess, second_guess=again,
        solver=optimize.SolverOptions(**problem.solver.model_dump()), title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """What is optimised: the unknowns of the discretised problem's model and their bounds."""
    from gtmodel.optimize.formulation.problem import build  # here: the keys alone need no engine

    built = build(_model(problem, context), problem.solver.formulation)
    held = [int(np.sum(np.isfinite(b.low) | np.isfinite(b.high))) for b in (built.start_bounds, built.end_bounds)]
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
        f"{held[0]} states bounded at the start and {held[1]} at the end",
    ]
    return "\n".join(lines)


def _model(problem: Schema, context: Context) -> lang.Optimization:
    return problem_files.python_models.resolve(
        problem.model, context, "model", problem.parameters, lang.Optimization, library=problem.library
    )


def _guess(problem: Schema, context: Context, model: lang.Optimization) -> Trajectory | None:
    """An earlier result; of a text with free time a simulation, as its users made one by hand."""
    if context.start is None and problem.guess:
        context.start = earlier.read(context.folder / problem.guess, NAME)
    if (guess := context.guess()) is not None or not is_reference(problem.model):
        return guess
    if (guess := modelica.first_guess(model)) is not None:
        context.notes.append("the horizon is free: started from a simulation with the inputs' start values")
    return guess
