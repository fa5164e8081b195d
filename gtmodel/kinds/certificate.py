"""Kind "certificate": what holds for a function of a robot at every point of a box."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from gtmodel import certify
from gtmodel.certify.certificate import InputSpeed
from gtmodel.problem_files.base import Call, Context
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.keys import RobotProblem

if TYPE_CHECKING:
    from gtmodel.compiler.causal import CausalFunction

RESULT = "gtmodel.certify.BoxCertificate"

Names = Annotated[list[str], Field(min_length=1)]
Interval = Annotated[list[float], Field(min_length=2, max_length=2)]


class Schema(RobotProblem):
    """Proof that a function of a robot has a solution at every point of a box, with bounds of its errors."""

    known: Names = Field(description="variables that are given, such as T")
    targets: Names = Field(description="variables that are computed, such as q or tau")
    branches: dict[str, Literal[-1, 1]] = Field(default={}, description="sign by declared branch name")
    box: dict[str, list[Interval]] = Field(
        description="[least, greatest] by input, one for each number or one for all, SI: T = [[0.0, 0.8], ...]"
    )
    bounds: dict[str, list[Interval]] = Field(
        default={}, description="intervals that targets must stay in, such as strokes: q = [[-2.0, 0.0]]"
    )
    regular: bool = Field(
        default=False, description="whether no pose may be singular: the Jacobian of the targets stays regular"
    )
    moving: Made[InputSpeed] | None = Field(
        default=None, description="for functions with Newton's method: the motion between two calls of the code"
    )
    around: dict[str, list[float] | float] | None = Field(
        default=None, description="point by input, SI: shrink the box towards it until all is proved"
    )
    real: Literal["double", "float"] = Field(default="double", description="number type of the code")
    max_boxes: int = Field(default=100_000, ge=1, description="largest number of boxes to examine")


ARGUMENTS = {"function": "targets", "cuts": "--start"}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study."""
    earlier = "" if context.start is None else str((context.start.get("values") or {}).get("cuts", ""))
    return Call(
        certify.study, _function(problem, context), problem.box, bounds=problem.bounds, regular=problem.regular,
        moving=None if problem.moving is None else problem.moving.options(), around=problem.around,
        real=problem.real, max_boxes=problem.max_boxes, cuts=earlier,
        title=problem.title or f"certificate of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the function whose operations are proved."""
    function = _function(problem, context)
    inputs = ", ".join(f"{s.name} [{s.unit}]" for s in function.inputs)
    return f"{problem.heading}: the box is one of {inputs}\n{function.explain(full=False)}"


def _function(problem: Schema, context: Context) -> CausalFunction:
    return problem.model(context).causal(known=problem.known, targets=problem.targets, branches=problem.branches)
