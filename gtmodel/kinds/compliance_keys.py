"""The keys of kind "compliance"."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, NonNegativeFloat, PositiveFloat

from .base import Section
from .robot_keys import RobotProblem
from .section_keys import Pair

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
Spring = PositiveFloat | list[PositiveFloat]


class Links(Section):
    """Rods and their ball joints. The rod is a tube, or has a stiffness of its own."""

    stiffness_N_m: Spring | None = Field(default=None, description="of a rod along itself, one or one each")
    modulus_Pa: PositiveFloat | None = Field(default=None, description="Young's modulus of a tube along itself")
    outer_diameter_m: PositiveFloat | None = Field(default=None, description="of the tube")
    inner_diameter_m: NonNegativeFloat = Field(default=0.0, description="of the tube")
    parallel: list[Annotated[int, Field(ge=1)]] | None = Field(
        default=None, description="rods side by side in each link of the model: [1, 2, 3] where it has three, left out"
    )
    joint_N_m: Spring | None = Field(default=None, description="of one ball joint along its rod; rigid if left out")


class Carts(Section):
    """What holds the carts on their guideways; rigid where left out."""

    drive_N_m: Spring | None = Field(default=None, description="along the guideway: drive train and servo loop")
    axis_Nm_rad: Spring | None = Field(default=None, description="of rotary axes on the carts")
    across_N_m: Spring | None = Field(default=None, description="bearings, across the guideway")


class Frame(Section):
    """The machine frame at each guideway; rigid where left out."""

    along_N_m: Spring | None = Field(default=None, description="along the guideway")
    across_N_m: Spring | None = Field(default=None, description="across it")


class Arm(Section):
    """A serial arm: its joints, and the poses of the map."""

    joint_Nm_rad: list[PositiveFloat] = Field(description="stiffness by joint")
    tool_m: Three = Field(default=[0.0] * 3, description="tool centre point in flange coordinates")
    pose_deg: list[float] = Field(
        min_length=6, max_length=6, description="joint angles whose flange orientation and branch the whole map keeps"
    )


class Load(Section):
    """Process force at the tool centre point, world coordinates."""

    force_N: Three = Field(default=[0.0] * 3, description="on the tool")
    moment_Nm: Three = Field(default=[0.0] * 3, description="about the tool centre point")


class Map(Section):
    """The cross-section that is mapped: across the guideways, or the vertical plane in which an arm stands."""

    along_m: float | None = Field(
        default=None, description="position along the guideways; through the reported pose if left out"
    )
    step_m: PositiveFloat = Field(default=0.05, description="of the grid")
    low_m: Pair | None = Field(default=None, description="least (u, v); all that may be reached if left out")
    high_m: Pair | None = Field(default=None, description="greatest (u, v)")
    cone_deg: Annotated[float, Field(gt=0, le=90)] | None = Field(
        default=None, description="links stay so near to their directions at the reported pose: limits of ball joints"
    )


class Schema(RobotProblem):
    """How a robot gives way: stiffness, deflection, natural frequencies. [links] for a parallel robot, [arm] for a
    serial one."""

    links: Links | None = Field(default=None, description="of a parallel robot")
    carts: Carts = Carts()
    frame: Frame = Frame()
    arm: Arm | None = Field(default=None, description="of a serial arm")
    load: Load = Load()
    pose_m: Three | None = Field(
        default=None, description="tool centre point whose numbers are reported; home if left out"
    )
    frequencies: Annotated[int, Field(ge=1, le=12)] = Field(default=3, description="how many are reported")
    section: Map = Map()


VALUES = {
    "pose_m": "tool centre point that the next numbers are about",
    "compliance": "at the tool, displacement by load: m/N, and rad/N, rad/(N.m) where the plate turns",
    "stiffness_N_m": "along the principal directions of its translational part, softest first",
    "directions": "these directions",
    "deflection_m": "of the tool centre point under the load",
    "rotation_rad": "of the plate under the load; null where it has none",
    "work_J": "that the load does",
    "shares": "parts of this work by what gives way; null without a load",
    "sag_m": "of the tool centre point by all weights; null for robots without masses",
    "frequencies_Hz": "lowest natural frequencies; null for robots without masses",
    "map": "over the section: points, and for softest_N_m, deflection_m and frequency_Hz least and greatest with their "
    "places in (u, v)",
    "reasons": "number of grid points left out, by reason",
    "assumptions": "what was assumed, in sentences",
}

__all__ = ["VALUES", "Arm", "Carts", "Frame", "Links", "Load", "Map", "Schema"]
