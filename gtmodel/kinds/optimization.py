"""Kind "optimization": a person's own `Optimization` class, solved by collocation."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from gtmodel.lang import ModelError, Optimization
from gtmodel.optimize import CompilerMissing, Solution, SolverOptions
from gtmodel.optimize import Mesh as CollocationMesh
from gtmodel.optimize import solve as collocate
from gtmodel.optimize.formulation.problem import Bounds
from gtmodel.optimize.judgement.resimulate import resimulate
from gtmodel.problem_files import python_models
from gtmodel.problem_files.base import Context, InputError, Outcome, Problem, Row, Section
from gtmodel.problem_files.solver_keys import Barrier

NAME = "optimization"

VALUES = {
    "final_time_s": "end of the horizon",
    "free": "every constant that the optimisation chose, by its name in the class, in SI",
    "defect": "largest difference of re-simulated and collocated states at an element's edge, in nominals",
    "violation_between_nodes": "largest excess over a bound or path constraint at any instant, in the unit of its row",
    "cost_error": "re-simulated minus collocated integral cost",
}


class Mesh(Section):
    """Where the equations are collocated."""

    elements: PositiveInt = Field(default=50, le=10000, description="number of elements of the horizon")
    points: int = Field(default=3, ge=1, le=9, description="collocation points per element")
    scheme: Literal["radau", "gauss"] = Field(default="radau", description="where the points of an element lie")
    control: Literal["polynomial", "bernstein", "linear", "constant"] = Field(
        default="polynomial",
        description="per element: a polynomial bounded at its points only, one bounded at every instant (bernstein), "
        "a continuous line, or one value",
    )


class Solver(Section):
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
    barrier: Barrier = "auto"
    compile: bool = Field(
        default=False, description="the elements as machine code: the same optimum, sooner where it is solved again"
    )


class Schema(Problem):
    """A dynamic optimisation problem written in Python."""

    model: str = Field(description="the Optimization: package.module:Class or file.py:Class")
    parameters: dict[str, Any] = Field(
        default={}, description="modifiers of the model, by its own parameter names, in SI"
    )
    mesh: Mesh = Mesh()
    solver: Solver = Solver()


def solve(problem: Schema, context: Context) -> Outcome:
    """Solve the person's optimisation. Raises InputError and ModelError for a wrong one."""

    def progress(iteration: int, objective: float, violation: float) -> bool:
        numbers = {"iteration": iteration, "objective": objective, "violation": violation}
        context.progress("optimising", None, numbers)
        return context.interrupted()

    try:
        solution = collocate(
            _model(problem, context),
            CollocationMesh(**problem.mesh.model_dump()),
            guess=context.guess(),
            solver=SolverOptions(**problem.solver.model_dump(), max_seconds=context.seconds_left()),
            progress=progress,
            throw=False,
        )
    except CompilerMissing as error:
        raise InputError(str(error), "solver.compile") from None
    return _outcome(solution)


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
    return python_models.resolve(problem.model, context, "model", problem.parameters, Optimization)


def _outcome(solution: Solution) -> Outcome:
    free = dict(solution.free)
    final_time = solution.final_time
    rows = [Row("objective", solution.objective), Row("final time", final_time, "s")]
    rows += [Row(name, value) for name, value in free.items() if name != "final_time"]
    values = {"final_time_s": final_time, "free": free}
    message = solution.message
    if solution.status.converged:
        tried, word = _tried(solution)
        values |= tried
        rows += [Row(name.replace("_", " "), value) for name, value in tried.items()]
        message = f"{message}{' and' if tried and not solution.reservation else ';'} {word}"
    return Outcome(
        status=solution.status,
        message=message,
        objective=solution.objective,
        iterations=solution.iterations,
        checks=dict(solution.checks),
        values=values,
        trajectory=solution.trajectory,
        rows=rows,
    )


def _tried(solution: Solution) -> tuple[dict[str, float], str]:
    """What the optimum's input does in an error-controlled integrator, and a sentence; no numbers if it cannot run."""
    try:
        run = resimulate(solution)
    except ModelError as error:
        return {}, f"not re-simulated: {error}"
    if run.trajectory is None:
        return {}, f"not re-simulated: {run.message}"
    numbers = {"defect": run.defect, "violation_between_nodes": run.violation, "cost_error": run.cost_error}
    return numbers, "re-simulated"
