"""The keys of friction identification from constant-velocity runs."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtmodel.identify.friction import options
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.log_keys import LogSampling, MeasuredSignalSection
from gtmodel.problem_files.robot_keys import RobotProblem

RESULT = "gtmodel.identify.FrictionStudy"


@made_from(options.HeldPose)
class HeldPoseSection(Made):
    """Where the tool centre point was held in the cross-section while the carts ran."""

    files: list[str] = Field(default=[], description="logs of this pose, with [log]")


@made_from(options.ConstantVelocity)
class FrictionLogSection(LogSampling, Made):
    """Measured logs; each pose names its own files."""

    position_m: MeasuredSignalSection = Field(description="positions of the carts")
    force_N: MeasuredSignalSection = Field(description="forces of the motors")


class Schema(RobotProblem):
    """Friction from constant-velocity runs. One of [log], [synthetic] and [printed] gives the forces."""

    directions: Literal["separate", "symmetric"] = Field(
        default="separate", description="separate: coefficients by direction of motion"
    )
    gravity: Literal["most_symmetric", "poses"] = Field(
        default="most_symmetric",
        description="how the mass is found beside friction by direction: least asymmetry, or the change between poses",
    )
    accept: list[options.FrictionAlarm] = Field(
        default=[],
        description="alarms about runs and columns that are notes and refuse nothing: copied_rows, exchanged_columns, "
        "driving_friction, negative_mass",
    )
    pose: list[HeldPoseSection] = Field(min_length=1, description="one table for each; the first is the picture's")
    log: FrictionLogSection | None = Field(default=None, description="measured logs")
    synthetic: Made[options.SyntheticRuns] | None = Field(default=None, description="synthetic logs")
    printed: Made[options.FrictionCoefficients] | None = Field(
        default=None, description="published lines; their mass is the one that was chosen, and is found anew"
    )
