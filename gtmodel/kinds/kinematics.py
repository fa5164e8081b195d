"""Kind "kinematics": any causality of a robot on many points, and the orientation of its plate over a grid."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from gtmodel.kinematics import causality
from gtmodel.kinematics.causality import options
from gtmodel.problem_files.base import Call, Context, InputError
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.keys import RobotProblem

RESULT = "gtmodel.kinematics.CausalityStudy"


class Schema(RobotProblem):
    """A causality on many points. Quantities go by the model's own names, such as T, q, e or "arm[0].rod.tension"."""

    known: Annotated[list[str], Field(min_length=1)] = Field(description="what is given at each point")
    targets: Annotated[list[str], Field(min_length=1)] = Field(description="what is computed there")
    branches: dict[str, Literal[-1, 1]] = Field(default={}, description="sign by declared branch name")
    points: str = Field(
        default="", description="CSV file with a column for each component, such as T[0] [m]; from the problem's folder"
    )
    grid: Made[options.PointGrid] | None = Field(default=None, description="points of a box, instead of a file")
    orientation: Made[options.Orientation] | None = Field(
        default=None, description="orientation of the plate in degrees"
    )


NAME = "kinematics"
ARGUMENTS = {f"points.{name}": f"grid.{name}" for name in ("center", "center_where", "counts", "directions")}


def call(problem: Schema, context: Context) -> Call:
    """The causality on all points."""
    if context.start is not None:
        raise InputError("--start: kinematics is computed point by point and starts from no earlier result")
    return Call(
        causality.causality_study, problem.model(context), problem.known, problem.targets, _points(problem, context),
        branches=problem.branches, orientation=None if problem.orientation is None else problem.orientation.options(),
        title=problem.title or f"kinematics of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """The certificate of the causality."""
    made = call(problem, context)
    model, known, targets, _ = made.arguments
    function = causality.causality_of(model, known, targets, made.options["branches"], made.options["orientation"])
    return f"{problem.title or NAME}\n{function.explain()}"


def _points(problem: Schema, context: Context) -> Path | Any:
    """The path of the CSV file, or the options of the grid."""
    if bool(problem.points) == (problem.grid is not None):
        given = "both" if problem.points else "neither"
        raise InputError(f"give either points = a CSV file or a [grid]; found {given}", "points")
    if problem.grid is not None:
        return problem.grid.options()
    return context.file(problem.points, "points")
