"""Kind "kinematics": any causality of a robot at many points, and the orientation of its plate over a grid."""

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
    """A causality at many points. Variables have the model's names, such as T, q, e or "arm[0].rod.tension"."""

    known: Annotated[list[str], Field(min_length=1)] = Field(description="variables given at each point")
    targets: Annotated[list[str], Field(min_length=1)] = Field(description="variables to compute")
    branches: dict[str, Literal[-1, 1]] = Field(default={}, description="sign by declared branch name")
    points: str = Field(
        default="", description="CSV file with a column for each component, such as T[0] [m]; from the problem's folder"
    )
    grid: Made[options.PointGrid] | None = Field(default=None, description="points in a box, instead of a file")
    orientation: Made[options.Orientation] | None = Field(
        default=None, description="orientation of the plate in degrees"
    )


ARGUMENTS = {f"points.{name}": f"grid.{name}" for name in ("center", "center_where", "counts", "directions")}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study at all points."""
    if context.start is not None:
        raise InputError("--start: kinematics does not use an earlier result; leave it out")
    return Call(
        causality.causality_study, problem.model(context), problem.known, problem.targets, _points(problem, context),
        branches=problem.branches, orientation=None if problem.orientation is None else problem.orientation.options(),
        title=problem.title or f"kinematics of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Return the certificate of the causality."""
    study = call(problem, context)
    model, known, targets, _ = study.arguments
    function = causality.causality_of(model, known, targets, study.options["branches"], study.options["orientation"])
    return f"{problem.heading}\n{function.explain(context.full)}"


def _points(problem: Schema, context: Context) -> Path | Any:
    """The path of the CSV file, or the options of the grid."""
    if bool(problem.points) == (problem.grid is not None):
        present = "both" if problem.points else "neither"
        raise InputError(f"give either points = a CSV file or a [grid]; found {present}", "points")
    if problem.grid is not None:
        return problem.grid.options()
    return context.file(problem.points, "points")
