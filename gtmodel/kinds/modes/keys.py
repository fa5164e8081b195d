"""The keys of kind "modes"."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Field, PositiveFloat

from gtmodel.kinematics.assembly_modes import options
from gtmodel.problem_files.base import FileSection, InputError, Problem
from gtmodel.problem_files.from_options import Made, made_from

RESULT = "gtmodel.kinematics.ModesStudy"

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Points = Annotated[list[Three], Field(min_length=6, max_length=6)]
Lengths = Annotated[list[PositiveFloat], Field(min_length=6, max_length=6)]


@made_from(options.CommandedPose, "axes")
class PoseSection(Made):
    """Carts and rotary axes, or a tool pose."""

    q_rad: Three | None = Field(default=None, description="rotary axes q4, q5, q6 of an F1; zero if left out")
    q_deg: Three | None = Field(default=None, description="the same in degrees")

    def options(self) -> options.CommandedPose:
        """The pose in SI. Raises InputError for angles in both units."""
        if self.q_rad is not None and self.q_deg is not None:
            raise InputError("give either q_rad or q_deg", "pose")
        axes = self.q_rad if self.q_deg is None else np.radians(self.q_deg).tolist()
        return options.CommandedPose(axes=axes, **self.given())


class Platform(FileSection):
    """Six legs without a robot."""

    A_m: Points = Field(description="joints at the base or at the carts")
    B_m: Points = Field(description="plate joints in plate coordinates")
    L_m: Lengths = Field(description="lengths of the legs, not their squares")


class Draw(FileSection):
    """Random platforms, synthetic: base joints in a cube of side 2 m, plate joints in one of side 1 m."""

    platforms: int = Field(default=20, ge=1, le=100000, description="how many")
    seed: int = Field(default=1, ge=0, description="of the random numbers")


class Schema(Problem):
    """Assembly modes of a robot with six links, of a platform given by its joints, or of random ones.

    Give robot, platform or draw; with a robot a pose (its home if left out) or poses, with a platform perhaps the
    pose that is commanded.
    """

    robot: str | None = Field(default=None, description="catalogue name or TOML robot file, with six links")
    parameters: dict[str, Any] = Field(
        default={}, description="modifiers of the model, by its own parameter names, in SI"
    )
    pose: PoseSection | None = Field(default=None)
    poses: str | None = Field(
        default=None,
        description="CSV file of many poses; columns q1_m, q2_m, q3_m, with q4_deg ... or q4_rad ... for an F1, or "
        "x_m, y_m, z_m, with alpha_deg, beta_deg, gamma_deg (z, y, z) or e0 ... e3",
    )
    platform: Platform | None = Field(default=None)
    draw: Draw | None = Field(default=None)
