"""The keys of a calibration of joint stiffness, table [joint_stiffness] of kind "calibration"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from gtmodel.problem_files.base import Section

Three = Annotated[list[float], Field(min_length=3, max_length=3)]


class StaticLoad(Section):
    """One load, world coordinates, hung on the tool in every pose."""

    force_N: Three = Field(description="at the tool centre point")
    moment_Nm: Three = Field(default=[0.0] * 3, description="about it")


class Noise(Section):
    """Standard deviations of the measured displacements."""

    position_m: PositiveFloat = Field(default=2e-5, description="of each coordinate, at tool and wrist centre")
    rotation_rad: PositiveFloat = Field(default=1e-4, description="of each rotation; 20 um on a base of 0.25 m")


class Column(Section):
    """Columns of a quantity."""

    column: str | list[str] = Field(description='names in the file; "q" means "q[0]", "q[1]", ... too')
    unit: str | list[str] = Field(description="unit of the columns, or one each")


class LoadTests(Section):
    """Measured tests, one a row: where the arm stood, what pulled, what moved. World coordinates."""

    file: str = Field(description="CSV, path from the problem's folder")
    q: Column = Field(description="joint angles")
    force: Column = Field(description="on the tool centre point")
    moment: Column | None = Field(default=None, description="about it; none if left out")
    displacement: Column = Field(description="of the tool centre point, with the load less without")
    rotation: Column = Field(description="of the tool, as a rotation vector")
    wrist: Column | None = Field(
        default=None, description="displacement of a target at the wrist centre; by the pose if left out"
    )


class SyntheticTests(Section):
    """Tests made up from known stiffness, to see what identification gives back."""

    stiffness_MNm_rad: list[PositiveFloat] = Field(description="by joint")
    tilt: NonNegativeFloat = Field(
        default=0.0, description="compliance of bearings across their axes, in units of the joint's; the model lacks it"
    )
    wrist_target: bool = Field(default=True, description="whether the wrist centre has a target of its own")
    seed: int = Field(description="of the noise")


class GravityCompensator(Section):
    """A spring between two hinges at distances base and lever from axis 2; its change of torque adds to K_c."""

    base_m: PositiveFloat = Field(description="from axis 2 to the hinge on the link before")
    lever_m: PositiveFloat = Field(description="from axis 2 to the hinge on the link after")
    rate_N_m: PositiveFloat = Field(description="of the spring; the start where it is estimated")
    rest_m: NonNegativeFloat = Field(description="length at which the spring is slack")
    angle_deg: float = Field(default=0.0, description="of joint 2 where the spring is longest")
    estimate_rate: bool = Field(default=False, description="whether the rate is an unknown too; complete_pose only")


class JointStiffness(Section):
    """Joint stiffness of a serial arm from static load tests. One of measurements and synthetic tells what moved."""

    poses_deg: list[list[float]] | None = Field(
        default=None, description="joint angles of each pose, all loads in each; of synthetic tests"
    )
    load: list[StaticLoad] | None = Field(default=None, description="one table for each load; of synthetic tests")
    tool_m: Three = Field(default=[0.0] * 3, description="tool centre point in flange coordinates")
    method: Literal["complete_pose", "decoupled"] = Field(default="complete_pose", description="the one reported first")
    complementary: bool = Field(default=False, description="count the loads' complementary stiffness K_c")
    compensator: GravityCompensator | None = Field(default=None, description="of joint 2, part of K_c")
    best: int = Field(default=10, ge=1, description="how many tests that tell most are listed")
    noise: Noise = Noise()
    measurements: LoadTests | None = Field(default=None, description="measured tests")
    synthetic: SyntheticTests | None = Field(default=None, description="made-up tests")
