"""The keys of kind "accuracy"."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtmodel.kinematics.accuracy import options
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = "gtmodel.kinematics.AccuracyStudy"


class Schema(RobotProblem):
    """Accuracy of a three-link robot."""

    section: Made[options.ErrorSection] = Made[options.ErrorSection].left_out()
    method: Literal["support", "projection"] = Field(
        default="support",
        description="how ellipsoids become corners: exact first-order bound, or the iteration of Dressler 2012, A.2",
    )
    cases: list[Made[options.LinkErrors]] = Field(min_length=1, description="errors to look at, one after the other")
    monte_carlo: Made[options.MonteCarloDraws] = Made[options.MonteCarloDraws].left_out()
