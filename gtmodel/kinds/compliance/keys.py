"""The keys of kind "compliance"."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gtmodel.compliance import options
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem


@made_from(options.Links)
class Links(Made):
    """Rods and their ball joints. The rod is a tube, or has a stiffness of its own."""


@made_from(options.Carts)
class Carts(Made):
    """What holds the carts on their guideways; rigid where left out."""


@made_from(options.Frame)
class Frame(Made):
    """The machine frame at each guideway; rigid where left out."""


@made_from(options.Arm)
class Arm(Made):
    """A serial arm: its joints, and the poses of the map."""


@made_from(options.Load)
class Load(Made):
    """Process force at the tool centre point, world coordinates."""


@made_from(options.Map)
class Map(Made):
    """The cross-section that is mapped: across the guideways, or the vertical plane in which an arm stands."""


class Schema(RobotProblem):
    """How a robot gives way: stiffness, deflection, natural frequencies. [links] for a parallel robot, [arm] for a
    serial one."""

    links: Links | None = Field(default=None, description="of a parallel robot")
    carts: Carts = Carts()
    frame: Frame = Frame()
    arm: Arm | None = Field(default=None, description="of a serial arm")
    load: Load = Load()
    pose_m: Annotated[list[float], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="tool centre point whose numbers are reported; home if left out"
    )
    frequencies: Annotated[int, Field(ge=1, le=12)] = Field(default=3, description="how many are reported")
    section: Map = Map()
