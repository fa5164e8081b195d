"""The keys of kind "accuracy"."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtmodel.kinematics.accuracy import options
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem


@made_from(options.ErrorSection)
class SectionKeys(Made):
    """The cross-section, a plane orthogonal to the mean guideway direction; (u, v) = (y, z) for guideways along x."""


@made_from(options.LinkErrors)
class Case(Made):
    """Errors of the three links: of their lengths, or of the cart joints, in ellipsoids about them; some may be 0."""


@made_from(options.MonteCarlo)
class MonteCarlo(Made):
    """Synthetic errors beside the corners."""


class Schema(RobotProblem):
    """Accuracy of a three-link robot."""

    section: SectionKeys = SectionKeys()
    method: Literal["support", "projection"] = Field(
        default="support",
        description="how ellipsoids become corners: exact first-order bound, or the iteration of Dressler 2012, A.2",
    )
    cases: list[Case] = Field(min_length=1, description="errors to look at, one after the other")
    monte_carlo: MonteCarlo = MonteCarlo()
