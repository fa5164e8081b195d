"""Options and result of the workspace study: limits, bodies, obstacles, sections."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from ...results import Quantity, Row, Study
from ...results.options import Long, Options, Unit, Within

Pair = Annotated[list[float], Long(2)]
Point = Annotated[list[float], Long(3)]
DEGREE = math.pi / 180
MOST_SECTIONS = 200  # of a volume; a grid is mapped for each


@dataclass(frozen=True)
class WorkspaceLimits(Options):
    """Limits of the workspace; coordinates without a limit are unlimited.

    >>> limits = gt.kinematics.workspace.WorkspaceLimits(actuators=[[-1.5, 1.5]] * 3)
    >>> round(float(np.degrees(limits.singularity)), 3), limits.cone is None  # deg
    (0.1, True)
    """

    actuators: Annotated[list[Pair] | None, Unit("m"), "lower and upper limit of q for every cart"] = None
    cone: Annotated[
        float | None, Unit("rad", written="deg"), Within(above=0.0, most=math.pi),
        "half-angle of ball-joint cones about the links at home",
    ] = None  # fmt: skip
    singularity: Annotated[
        float, Unit("rad", written="deg"), Within(least=0.0),
        "least angle of a link from the plane orthogonal to its guideway and from the plane of the other links",
    ] = 0.1 * DEGREE  # fmt: skip
    tcp_low: Annotated[
        list[float] | None, Unit("m"), Long(3), "lower limits of the tool centre point, such as a wall of the frame"
    ] = None  # fmt: skip
    tcp_high: Annotated[list[float] | None, Unit("m"), Long(3), "upper limits of the tool centre point"] = None


@dataclass(frozen=True)
class Bodies(Options):
    """Sizes of links and plate for clearances, and positions of the real plate joints.

    >>> gt.kinematics.workspace.Bodies(link_radius=-0.02)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: link_radius: must be at least 0; found -0.02
    """

    link_radius: Annotated[float, Unit("m"), Within(least=0.0), "radius of every link"] = 0.0
    plate_radius: Annotated[
        float, Unit("m"), Within(least=0.0), "radius of a sphere about the TCP that contains the plate"
    ] = 0.0  # fmt: skip
    plate_joints: Annotated[
        list[Point] | None, Unit("m"),
        "position of the plate joint of each link relative to the TCP, robot frame; default: the links meet in the TCP",
    ] = None  # fmt: skip
    link_clearance: Annotated[bool, "keep the links clear of one another; needs plate_joints_m"] = False


@dataclass(frozen=True, kw_only=True)
class Box(Options):
    """An obstacle with sides along the axes.

    >>> gt.kinematics.workspace.Box(low=[0, 0, 0], high=[1.0, 1.0])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: high: expected 3 numbers; found 2
    """

    name: Annotated[str, "name of the obstacle in messages"] = ""
    low: Annotated[list[float], Unit("m"), Long(3), "corner with the smallest coordinates"]
    high: Annotated[list[float], Unit("m"), Long(3), "corner with the largest coordinates"]


@dataclass(frozen=True)
class Beam(Options):
    """A straight beam of the frame that the links must not touch.

    >>> beam = gt.kinematics.workspace.Beam([0, 0, 0.8], [0, 0, 1.6], radius=0.05, skip_links=[1])
    >>> beam.radius, beam.skip_links
    (0.05, [1])
    """

    from_: Annotated[list[float], Unit("m"), Long(3), "one end"]
    to: Annotated[list[float], Unit("m"), Long(3), "the other end"]
    radius: Annotated[float, Unit("m"), Within(least=0.0), "radius of the beam"] = 0.0
    skip_links: Annotated[list[int], "numbers of links (from 1) that may touch it"] = field(default_factory=list)


@dataclass(frozen=True)
class Sections(Options):
    """Sections between two positions along the guideways.

    >>> gt.kinematics.workspace.Sections(low=-0.5, high=0.5, tolerance=2.0)
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: tolerance: must be more than 0 and less than 1; found 2
    """

    low: Annotated[float, Unit("m"), "first position along the guideways"]
    high: Annotated[float, Unit("m"), "last position along the guideways"]
    sections: Annotated[int, Within(least=2, most=10000), "initial number of sections"] = 21
    tolerance: Annotated[
        float, Within(above=0.0, below=1.0), "relative error of the volume; sections are added until it is reached"
    ] = 0.01  # fmt: skip
    most_sections: Annotated[int, Within(least=3, most=10000), "largest number of sections"] = MOST_SECTIONS


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WorkspaceStudy(Study):
    """The reachable tool centre points of a robot. An interrupted study holds the maps completed so far."""

    area: Annotated[float | None, Quantity("m2", "area of the cross-section reachable under all limits")] = None
    width: Annotated[float | None, Quantity("m", "width of the cross-section")] = None
    height: Annotated[float | None, Quantity("m", "height of the cross-section")] = None
    kinematic_area: Annotated[
        float | None,
        Quantity("m2", "area in which the inverse kinematics has a solution, limited by singularities only"),
    ] = None
    kinematic_width: Annotated[float | None, Quantity("m", "width of that area")] = None
    kinematic_height: Annotated[float | None, Quantity("m", "height of that area")] = None
    cones: Annotated[
        Sequence[Mapping[str, float]],
        "for each angle of compare_cones_deg: angle_deg, area_m2, width_m, height_m under ball-joint cones alone",
    ] = ()
    guideway_rectangle: Annotated[
        float | None,
        Quantity("m2", "area of the upright rectangle around the guideways in the section: the footprint"),
    ] = None
    area_ratio: Annotated[float | None, "ratio of area_m2 to the footprint"] = None
    volume: Annotated[
        float | None, Quantity("m3", "volume of the workspace along the guideways; null without [volume]")
    ] = None
    volume_error: Annotated[
        float | None,
        Quantity("m3", "error of the volume, estimated from the sections; null without [volume] or reachable sections"),
    ] = None
    volume_sections: Annotated[int | None, "number of sections of the volume"] = None
    volume_ratio: Annotated[
        float | None,
        "ratio of volume_m3 to footprint times longest stroke of limits.actuators_m; null without these limits",
    ] = None  # fmt: skip
    reasons: Annotated[
        Mapping[str, int],
        "number of grid points of the section per reason, the first violated limit",
    ] = field(default_factory=dict)
    points: Annotated[Sequence[Mapping[str, Any]], "for each of points_m: tcp_m, reachable, sentence"] = ()
    on_edge: Annotated[bool | None, "whether the edge of the grid cuts off the cross-section"] = None
    volume_on_edge: Annotated[
        bool | None,
        "whether the first or last section, or the edge of a grid, cuts off the volume; null without [volume]",
    ] = None
    assumptions: Annotated[
        Sequence[str], "assumptions on joints and bodies, in sentences"
    ] = ()  # fmt: skip

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [
            Row("reachable cross-section", self.area, "m2"),
            Row("its width", self.width, "m"),
            Row("its height", self.height, "m"),
            Row("where inverse kinematics exists", self.kinematic_area, "m2"),
        ]
        if self.area is None:  # interrupted
            rows = [row for row in rows if row.value is not None]
        rows += [Row(f"with cones of {c['angle_deg']:g} deg alone", c["area_m2"], "m2") for c in self.cones]
        if self.area is not None:
            rows.append(Row("ratio to the rectangle of the guideways", self.area_ratio))
        if self.volume is not None:
            rows.append(Row("volume", self.volume, "m3"))
            rows.append(Row("  its error from the sections", self.volume_error, "m3"))
            rows.append(Row("  sections", self.volume_sections))
            rows.append(Row("ratio to the box of guideways and strokes", self.volume_ratio))
        rows += [Row(f"grid points: {reason}", count) for reason, count in self.reasons.items()]
        rows += [Row("point", point["sentence"]) for point in self.points]
        rows += [Row("assumed", sentence) for sentence in self.assumptions]
        return rows + [Row("cut", sentence) for sentence in self.cuts]

    @property
    def cuts(self) -> list[str]:
        """Sentences on where the grid or the sections cut off the workspace."""
        cuts = ["the cross-section reaches the edge of the grid and is cut there"] if self.on_edge else []
        if self.volume_on_edge:
            cuts.append("the volume reaches its first or last section, or the edge of one, and is cut there")
        return cuts
