"""The keys of kind "workspace"."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gtmodel.kinematics.section import CrossSection
from gtmodel.kinematics.workspace import options
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = "gtmodel.kinematics.WorkspaceStudy"

Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Angle = Annotated[float, Field(gt=0, le=180)]


class Schema(RobotProblem):
    """Workspace of a robot whose plate keeps its orientation or follows from T."""

    home_m: Point | None = Field(default=None, description="pose of the cone axes; the robot's own home if left out")
    compare_cones_deg: list[Angle] = Field(default=[], description="cones to report beside the limits in force")
    points_m: list[Point] = Field(default=[], description="points to judge one by one")
    section: Made[CrossSection] = Made[CrossSection].left_out()
    volume: Made[options.Sections] | None = Field(default=None)
    limits: Made[options.WorkspaceLimits] = Made[options.WorkspaceLimits].left_out()
    bodies: Made[options.Bodies] = Made[options.Bodies].left_out()
    obstacles: list[Made[options.Box]] = Field(default=[], description="boxes that links and plate must not touch")
    beams: list[Made[options.Beam]] = Field(default=[], description="beams of the frame that links must not touch")
