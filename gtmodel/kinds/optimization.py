"""Kind "optimization": an `Optimization` class of the user, solved by collocation."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from gtmodel import lang, modelica, optimize, problem_files
from gtmodel.modelica.reference import is_reference
from gtmodel.optimize import Blocks, LengthCost, Mesh
from gtmodel.problem_files.base import Call, Context, FileSection, Problem, earlier_result
from gtmodel.problem_files.files import InputError
from gtmodel.results import Trajectory
from gtmodel.results.refusal import naming

RESULT = "gtmodel.optimize.OptimizationStudy"


class BlockSection(FileSection):
    """Blocks of one control, which is constant on each of them."""

    sizes: PositiveInt | list[PositiveInt] = Field(
        description="elements in each block, with mesh.elements as sum; or one number for every block, the last of "
        "which takes the rest"
    )
    step_max: PositiveFloat | None = Field(
        default=None, description="largest step between neighbouring blocks, in the control's SI unit"
    )
    step_penalty: NonNegativeFloat = Field(
        default=0.0, description="weight of the squared step, in SI units, in the objective"
    )


class LengthCostSection(FileSection):
    """Cost of free element lengths, added to the objective."""

    uneven: NonNegativeFloat = Field(
        default=0.0, description="weight of the squared relative deviations from equal lengths"
    )
    rates: dict[str, NonNegativeFloat] = Field(
        default={},
        description="weights of the squared rates of states by name, in SI units: sum over the elements of "
        "h^(1 + power) times the integral of weight * rate^2, with h as fraction of the horizon",
    )
    power: NonNegativeFloat = Field(default=1.0, description="exponent in the term of the rates")


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
    blocks: dict[str, BlockSection] = Field(
        default={},
        description="controls that are constant over several elements, by name; the others follow mesh.control",
    )
    length_ratio: Annotated[list[PositiveFloat], Field(min_length=2, max_length=2)] | None = Field(
        default=None,
        description="smallest and largest length of an element, relative to equal lengths, which makes the lengths "
        "free; fixed lengths if left out",
    )
    shortest_element_s: NonNegativeFloat | None = Field(
        default=None, description="shortest duration of an element with free length"
    )
    longest_element_s: PositiveFloat | None = Field(
        default=None, description="longest duration of an element with free length"
    )
    length_cost: LengthCostSection | None = Field(default=None, description="cost of free lengths; none if left out")

    def mesh(self) -> Mesh:
        """Return the mesh. Raises InputError."""
        limits = (self.shortest_element_s, self.longest_element_s)
        low, high = limits[0] or 0.0, float("inf") if limits[1] is None else limits[1]
        sizes = {n: b.sizes if isinstance(b.sizes, int) else tuple(b.sizes) for n, b in self.blocks.items()}
        steps = {n: b.step_max for n, b in self.blocks.items() if b.step_max is not None}
        penalties = {n: b.step_penalty for n, b in self.blocks.items() if b.step_penalty}
        with naming("mesh", ValueError, refusal=InputError):
            return Mesh(
                self.elements, self.points, self.scheme, self.control,
                length_ratio=None if self.length_ratio is None else (self.length_ratio[0], self.length_ratio[1]),
                length_limits=None if limits == (None, None) else (low, high),
                length_cost=None if self.length_cost is None else LengthCost(**self.length_cost.model_dump()),
                blocks=Blocks(sizes=sizes, step_max=steps, step_penalty=penalties) if sizes else None,
            )  # fmt: skip


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
    mesh = problem.mesh.mesh()
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
        context.start = earlier_result(context.folder / problem.guess, problem.kind)
    if (guess := context.guess()) is not None or not is_reference(problem.model):
        return guess
    if (guess := modelica.first_guess(model)) is not None:
        context.notes.append(
            f"the horizon is free: the first guess is a simulation from {guess.time[0]:g} s to {guess.time[-1]:g} s, "
            "inputs held at their initialGuess or start value; an initialGuess of a state counts at the start only"
        )
    return guess
