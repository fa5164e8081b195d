"""The keys of kind "workspace"."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gtmodel.kinematics import section
from gtmodel.kinematics.workspace import options
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem

Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Angle = Annotated[float, Field(gt=0, le=180)]


@made_from(options.Limits)
class Limits(Made):
    """What the workspace must keep."""


@made_from(options.Bodies)
class Bodies(Made):
    """Sizes of links and plate, for clearances. Lengths from the simplified to the real joints may be given."""


@made_from(options.Box)
class Box(Made):
    """An obstacle with sides along the axes."""


@made_from(options.Beam)
class Beam(Made):
    """A beam of the frame."""


@made_from(section.CrossSection)
class CrossSection(Made):
    """The cross-section, a plane orthogonal to the mean guideway direction; (u, v) = (y, z) for guideways along x."""


@made_from(options.Sections)
class Volume(Made):
    """Sections between two positions along the guideways."""


class Schema(RobotProblem):
    """Workspace of a robot whose plate keeps its orientation or follows from T."""

    home_m: Point | None = Field(default=None, description="pose of the cone axes; the robot's own home if left out")
    compare_cones_deg: list[Angle] = Field(default=[], description="cones to report beside the limits in force")
    points_m: list[Point] = Field(default=[], description="points to judge one by one")
    section: CrossSection = CrossSection()
    volume: Volume | None = Field(default=None)
    limits: Limits = Limits()
    bodies: Bodies = Bodies()
    obstacles: list[Box] = Field(default=[], description="boxes that links and plate must not touch")
    beams: list[Beam] = Field(default=[], description="beams of the frame that links must not touch")
