"""The keys of kind "compliance"."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from gtmodel.compliance import options
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = "gtmodel.compliance.ComplianceStudy"


class Schema(RobotProblem):
    """How a robot deflects: stiffness, deflection, natural frequencies. [links] for a parallel robot, [arm] for a
    serial one."""

    links: Made[options.RodSprings] | None = Field(default=None, description="of a parallel robot")
    carts: Made[options.CartSprings] = Made[options.CartSprings].left_out()
    frame: Made[options.FrameSprings] = Made[options.FrameSprings].left_out()
    arm: Made[options.ArmSprings] | None = Field(default=None, description="of a serial arm")
    load: Made[options.Load] = Made[options.Load].left_out()
    pose_m: Annotated[list[float], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="tool centre point whose numbers are reported; home if left out"
    )
    frequencies: Annotated[int, Field(ge=1, le=12)] = Field(default=3, description="how many are reported")
    section: Made[options.ComplianceMap] = Made[options.ComplianceMap].left_out()
