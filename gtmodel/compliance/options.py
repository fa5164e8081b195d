"""Options of a compliance study (springs of a parallel robot or a serial arm, loads), and its result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from ..kinematics.section import CrossSection
from ..results import Quantity, Row, Study, listed
from ..results.options import Long, Options, Unit, Within

Three = Annotated[list[float], Long(3)]
WIDEST_M = 1.0  # largest tube diameter; more is probably in millimetres
METRES = "give it in metres"


@dataclass(frozen=True)
class RodSprings(Options):
    """Rods of a parallel robot and their ball joints.

    Give either the stiffness of a rod, or modulus and diameters of a tube, whose stiffness is E A / L.

    >>> gt.compliance.RodSprings(stiffness=0.0)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: stiffness: must be more than 0; found 0
    """

    stiffness: Annotated[
        float | list[float] | None, Unit("N/m"), Within(above=0.0), "axial stiffness of a rod, one number or one each"
    ] = None
    modulus: Annotated[float | None, Unit("Pa"), Within(above=0.0), "axial Young's modulus of a tube"] = None
    outer_diameter: Annotated[
        float | None, Unit("m"), Within(above=0.0, most=WIDEST_M, advice=METRES), "of the tube"
    ] = None
    inner_diameter: Annotated[float, Unit("m"), Within(least=0.0, most=WIDEST_M, advice=METRES), "of the tube"] = 0.0
    parallel: Annotated[
        list[int] | None,
        Within(least=1),
        "parallel rods in each link of the model; default [1, 2, 3] for three links, otherwise 1",
    ] = None
    joint: Annotated[
        float | list[float] | None, Unit("N/m"), Within(above=0.0),
        "stiffness of one ball joint along its rod; rigid if left out",
    ] = None  # fmt: skip


@dataclass(frozen=True)
class CartSprings(Options):
    """Springs between carts and guideways. A spring that is left out is rigid.

    >>> gt.compliance.CartSprings(drive=-1e7)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: drive: must be more than 0; found -1e+07
    """

    drive: Annotated[
        float | list[float] | None, Unit("N/m"), Within(above=0.0),
        "along the guideway: drive train and servo loop",
    ] = None  # fmt: skip
    axis: Annotated[
        float | list[float] | None, Unit("N.m/rad"), Within(above=0.0), "rotary axes on the carts"
    ] = None  # fmt: skip
    across: Annotated[
        float | list[float] | None, Unit("N/m"), Within(above=0.0), "bearings, across the guideway"
    ] = None  # fmt: skip


@dataclass(frozen=True)
class FrameSprings(Options):
    """Springs of the machine frame at each guideway. A direction that is left out is rigid.

    >>> gt.compliance.FrameSprings(along=[2e7, 2e7, 3e7]).across is None
    True
    """

    along: Annotated[float | list[float] | None, Unit("N/m"), Within(above=0.0), "along the guideway"] = None
    across: Annotated[float | list[float] | None, Unit("N/m"), Within(above=0.0), "across the guideway"] = None


@dataclass(frozen=True)
class Springs(Options):
    """The springs of a parallel robot: links, carts and frame.

    >>> links = gt.compliance.RodSprings(modulus=70e9, outer_diameter=0.040, inner_diameter=0.036)
    >>> springs = gt.compliance.Springs(links, gt.compliance.CartSprings(drive=1e7))
    >>> springs.carts.drive, springs.frame
    (10000000.0, FrameSprings(along=None, across=None))
    """

    links: RodSprings
    carts: CartSprings = CartSprings()
    frame: FrameSprings = FrameSprings()


@dataclass(frozen=True)
class ArmSprings(Options):
    """The joint springs of a serial arm, and the pose that fixes orientation and branch in its map.

    >>> q = np.deg2rad([0.0, -90.0, 90.0, 0.0, -60.0, 0.0]).tolist()
    >>> arm = gt.compliance.ArmSprings(joint=[3.93e6, 3.46e6, 2.77e6, 1.57e6, 0.24e6, 0.17e6], pose=q)
    >>> load, coarse = gt.compliance.Load([0, 0, -4000.0]), gt.compliance.ComplianceMap(step=0.5)
    >>> s = gt.compliance.study(gt.robots.kr500(), arm, load, map=coarse)
    >>> round(float(1e3 * s.deflection[2]), 2)  # mm
    -3.91
    """

    joint: Annotated[list[float], Unit("N.m/rad"), Within(above=0.0), "stiffness by joint"]
    pose: Annotated[
        list[float], Unit("rad", written="deg"), Long(6),
        "joint angles; the map keeps their flange orientation and branch",
    ]  # fmt: skip
    tool: Annotated[list[float], Unit("m"), Long(3), "tool centre point in flange coordinates"] = field(
        default_factory=lambda: [0.0] * 3
    )


@dataclass(frozen=True)
class Load(Options):
    """Process force and moment on the tool centre point, world coordinates.

    >>> gt.compliance.Load(force=[0, -100.0])
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: force: expected 3 numbers; found 2
    """

    force: Annotated[list[float], Unit("N"), Long(3), "force on the tool"] = field(default_factory=lambda: [0.0] * 3)
    moment: Annotated[list[float], Unit("N.m"), Long(3), "about the tool centre point"] = field(
        default_factory=lambda: [0.0] * 3
    )


@dataclass(frozen=True)
class ComplianceMap(CrossSection):
    """The mapped cross-section: across the guideways, or the vertical plane of an arm.

    Its coordinates are (u, v) [m]: (y, z) for guideways along x; away from the first axis and up for an arm.

    >>> gt.compliance.ComplianceMap(step=0.1, cone=np.deg2rad(200))
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: cone: must be more than 0 and at most 1.5708; found 3.49066
    """

    along: Annotated[
        float | None, Unit("m"), "position along the guideways; through the reported pose if left out"
    ] = None  # fmt: skip
    step: Annotated[float, Unit("m"), Within(above=0.0), "step of the grid"] = 0.05
    low: Annotated[list[float] | None, Unit("m"), Long(2), "smallest (u, v); default all that may be reached"] = None
    cone: Annotated[
        float | None, Unit("rad", written="deg"), Within(above=0.0, most=math.pi / 2),
        "largest angle of links from their directions at the reported pose: limits of ball joints",
    ] = None  # fmt: skip


Array = np.ndarray


WORDS = {"links": "rods", "joints": "ball joints", "drives": "drives", "carts": "bearings of the carts",
         "frame": "machine frame"}  # fmt: skip


MAPPED = {"softest_N_m": ("stiffness along the softest direction", 1e-6, "N/µm"),
          "deflection_m": ("deflection under the load", 1e6, "µm"),
          "frequency_Hz": ("lowest natural frequency", 1.0, "Hz")}  # fmt: skip


def word(part: str) -> str:
    """Name of a compliant part from its key in `shares`: a group of springs, or "joint_1" of a serial arm."""
    return WORDS.get(part) or part.replace("_", " ")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ComplianceStudy(Study):
    """Stiffness, deflection and natural frequencies of a robot: at one pose, and over a section of its workspace."""

    pose: Annotated[Array, Quantity("m", "tool centre point of the following values")]
    compliance: Annotated[Array, "displacement per load at the tool: m/N, and rad/N, rad/(N.m) if the plate can rotate"]
    stiffness: Annotated[
        Array, Quantity("N/m", "along the principal directions of its translational part, softest first")
    ]
    directions: Annotated[Array, "the principal directions"]
    deflection: Annotated[Array, Quantity("m", "displacement of the tool centre point under the load")]
    rotation: Annotated[Array | None, Quantity("rad", "rotation of the plate under the load; null if it cannot rotate")]
    work: Annotated[float | None, Quantity("J", "work of the load")] = None
    shares: Annotated[
        Mapping[str, float] | None,
        "shares of this work by compliant part: groups of springs, joints of a serial arm; null without a load",
    ]
    sag: Annotated[
        Array | None, Quantity("m", "displacement of the tool centre point by all weights; null without masses")
    ]
    frequencies: Annotated[Array | None, Quantity("Hz", "lowest natural frequencies; null without masses")]
    map: Annotated[
        Mapping[str, Any],
        "over the section: points, and for softest_N_m, deflection_m and frequency_Hz the least and greatest value "
        "with their places in (u, v)",
    ]
    reasons: Annotated[Mapping[str, int], "number of grid points left out, by reason"]
    assumptions: Annotated[Sequence[str], "assumptions, in sentences"]

    @property
    def rows(self) -> list[Row]:
        """The printed table."""
        rows = [
            Row("tool centre point", listed(self.pose), "m"),
            Row("stiffness, softest direction", self.stiffness[0] / 1e6, "N/um"),
            Row("  direction", listed(self.directions[0])),
            Row("stiffness, stiffest direction", self.stiffness[-1] / 1e6, "N/um"),
        ]
        if np.any(self.deflection):
            rows.append(Row("deflection under the load", listed(1e6 * self.deflection), "um"))
            if self.rotation is not None:
                rows.append(Row("rotation under the load", listed(1e6 * self.rotation), "urad"))
        if self.shares is not None:
            shares = ", ".join(f"{word(k)} {100 * x:.0f} %" for k, x in self.shares.items() if x > 0)
            rows.append(Row("shares of the work of the load", shares))
        if self.sag is not None and self.frequencies is not None:
            rows.append(Row("deflection by weights", listed(1e6 * self.sag), "um"))
            rows.append(Row("natural frequencies", listed(self.frequencies), "Hz"))
        for name, (words, scale, unit) in MAPPED.items():
            if name in self.map:
                e = self.map[name]
                ends = (f"{scale * e[x]:.4g} at ({listed(e[f'{x}_at_m'])}) m" for x in ("least", "greatest"))
                rows.append(Row(f"over the section: {words}", " to ".join(ends), unit.replace("µ", "u")))
        rows += [Row(f"grid points left out: {reason}", count) for reason, count in self.reasons.items()]
        return rows + [Row("assumed", sentence) for sentence in self.assumptions]
