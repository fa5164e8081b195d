"""What a compliance study asks for: springs of a parallel robot or of a serial arm, load, section."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

from ..kinematics.section import CrossSection
from ..results.options import Long, Options, Unit, Within

Three = Annotated[list[float], Long(3)]


@dataclass(frozen=True)
class Links(Options):
    """Rods and their ball joints. The rod is a tube, or has a stiffness of its own."""

    stiffness: Annotated[
        float | list[float] | None, Unit("N/m"), Within(above=0.0), "of a rod along itself, one or one each"
    ] = None
    modulus: Annotated[float | None, Unit("Pa"), Within(above=0.0), "Young's modulus of a tube along itself"] = None
    outer_diameter: Annotated[float | None, Unit("m"), Within(above=0.0), "of the tube"] = None
    inner_diameter: Annotated[float, Unit("m"), Within(least=0.0), "of the tube"] = 0.0
    parallel: Annotated[
        list[int] | None,
        Within(least=1),
        "rods side by side in each link of the model: [1, 2, 3] where it has three, left out",
    ] = None
    joint: Annotated[
        float | list[float] | None, Unit("N/m"), Within(above=0.0),
        "of one ball joint along its rod; rigid if left out",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class Carts(Options):
    """What holds the carts on their guideways; rigid where left out."""

    drive: Annotated[
        float | list[float] | None, Unit("N/m"), Within(above=0.0),
        "along the guideway: drive train and servo loop",
    ] = None  # fmt: skip
    axis: Annotated[
        float | list[float] | None, Unit("N.m/rad"), Within(above=0.0), "of rotary axes on the carts"
    ] = None  # fmt: skip
    across: Annotated[
        float | list[float] | None, Unit("N/m"), Within(above=0.0), "bearings, across the guideway"
    ] = None  # fmt: skip


@dataclass(frozen=True)
class Frame(Options):
    """The machine frame at each guideway; rigid where left out."""

    along: Annotated[float | list[float] | None, Unit("N/m"), Within(above=0.0), "along the guideway"] = None
    across: Annotated[float | list[float] | None, Unit("N/m"), Within(above=0.0), "across it"] = None


@dataclass(frozen=True)
class Springs(Options):
    """What is compliant in a parallel robot."""

    links: Links
    carts: Carts = Carts()
    frame: Frame = Frame()


@dataclass(frozen=True)
class Arm(Options):
    """A serial arm: its joints, and the poses of the map."""

    joint: Annotated[list[float], Unit("N.m/rad"), Within(above=0.0), "stiffness by joint"]
    pose: Annotated[
        list[float], Unit("rad", written="deg"), Long(6),
        "joint angles whose flange orientation and branch the whole map keeps",
    ]  # fmt: skip
    tool: Annotated[list[float], Unit("m"), Long(3), "tool centre point in flange coordinates"] = field(
        default_factory=lambda: [0.0] * 3
    )


@dataclass(frozen=True)
class Load(Options):
    """Process force at the tool centre point, world coordinates."""

    force: Annotated[list[float], Unit("N"), Long(3), "on the tool"] = field(default_factory=lambda: [0.0] * 3)
    moment: Annotated[list[float], Unit("N.m"), Long(3), "about the tool centre point"] = field(
        default_factory=lambda: [0.0] * 3
    )


@dataclass(frozen=True)
class Map(CrossSection):
    """The cross-section that is mapped: across the guideways, or the vertical plane in which an arm stands."""

    along: Annotated[
        float | None, Unit("m"), "position along the guideways; through the reported pose if left out"
    ] = None  # fmt: skip
    step: Annotated[float, Unit("m"), Within(above=0.0), "of the grid"] = 0.05
    low: Annotated[list[float] | None, Unit("m"), Long(2), "least (u, v); all that may be reached if left out"] = None
    cone: Annotated[
        float | None, Unit("rad", written="deg"), Within(above=0.0, most=math.pi / 2),
        "links stay so near to their directions at the reported pose: limits of ball joints",
    ] = None  # fmt: skip
