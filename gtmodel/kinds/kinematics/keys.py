"""The keys of kind "kinematics"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gtmodel.kinematics.causality import options
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.robot_keys import RobotProblem

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
