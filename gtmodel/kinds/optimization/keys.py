"""The keys of kind "optimization"."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, PositiveFloat, PositiveInt

from gtmodel.problem_files.base import FileSection, Problem

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
