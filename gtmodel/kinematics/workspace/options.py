"""Options of a workspace study (limits, bodies, obstacles, sections) and its results."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from ... import view
from ...geometry.rotations import shortest_rotation
from ...results import Quantity, Row, Study
from ...results.options import Long, Options, Unit, Within
from ...view.bodies import VisibleBody

Pair = Annotated[list[float], Long(2)]
Point = Annotated[list[float], Long(3)]
DEGREE = math.pi / 180
THIN = 1e-3  # m: least size of an obstacle in space
MOST_SECTIONS = 200  # of one volume; a whole grid is mapped for each section


@dataclass(frozen=True)
class WorkspaceLimits(Options):
    """Limits of the workspace; a limit that is left out does not apply.

    >>> limits = gt.kinematics.workspace.WorkspaceLimits(actuators=[[-1.5, 1.5]] * 3)
    >>> round(float(np.degrees(limits.singularity)), 3), limits.cone is None  # deg
    (0.1, True)
    """

    actuators: Annotated[list[Pair] | None, Unit("m"), "lower and upper limit of q for every cart"] = None
    cone: Annotated[
        float | None, Unit("rad", written="deg"), Within(above=0.0, most=math.pi),
        "half-angle of the ball-joint cones about the link directions at home",
    ] = None  # fmt: skip
    singularity: Annotated[
        float, Unit("rad", written="deg"), Within(least=0.0),
        "smallest angle of a link from the plane across its guideway and from the plane of the other links",
    ] = 0.1 * DEGREE  # fmt: skip
    tcp_low: Annotated[
        list[float] | None, Unit("m"), Long(3), "lower limits of the tool centre point, such as a wall of the frame"
    ] = None  # fmt: skip
    tcp_high: Annotated[list[float] | None, Unit("m"), Long(3), "upper limits of the tool centre point"] = None


@dataclass(frozen=True)
class Bodies(Options):
    """Sizes of links and plate for clearances, and optionally the positions of the real plate joints.

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
        "position of each link's plate joint from the TCP, robot frame; default: the links meet in the TCP",
    ] = None  # fmt: skip
    link_clearance: Annotated[bool, "keep the links clear of each other; needs plate_joints_m"] = False


@dataclass(frozen=True, kw_only=True)
class Box(Options):
    """An axis-aligned box as obstacle.

    >>> gt.kinematics.workspace.Box(low=[0, 0, 0], high=[1.0, 1.0])
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: high: expected 3 numbers; found 2
    """

    name: Annotated[str, "name of the obstacle in messages"] = ""
    low: Annotated[list[float], Unit("m"), Long(3), "lower corner"]
    high: Annotated[list[float], Unit("m"), Long(3), "upper corner"]

    def body(self) -> VisibleBody:
        """Return the box for a scene in space."""
        low, high = np.array(self.low), np.array(self.high)
        sides = np.maximum(high - low, THIN).tolist()
        name = self.name or "obstacle"
        solid = view.Cuboid((sides[0], sides[1], sides[2]), xyz=tuple((low + high) / 2))
        return solid.body().with_(name=name, opacity=0.3)


@dataclass(frozen=True)
class Beam(Options):
    """A straight beam of the frame; the links must stay clear of it.

    >>> beam = gt.kinematics.workspace.Beam([0, 0, 0.8], [0, 0, 1.6], radius=0.05, skip_links=[1])
    >>> beam.radius, beam.skip_links
    (0.05, [1])
    """

    from_: Annotated[list[float], Unit("m"), Long(3), "one end"]
    to: Annotated[list[float], Unit("m"), Long(3), "the other end"]
    radius: Annotated[float, Unit("m"), Within(least=0.0), "radius"] = 0.0
    skip_links: Annotated[list[int], "numbers of links (from 1) that may touch it"] = field(default_factory=list)

    def body(self) -> VisibleBody:
        """Return the beam for a scene in space."""
        along = np.array(self.to) - self.from_
        length = float(np.linalg.norm(along))
        turned = shortest_rotation(np.array([0.0, 0.0, 1.0]), along / length) if length else np.eye(3)
        solid = view.Cylinder(max(self.radius, THIN), max(length, THIN)).body()
        return solid.moved(turned, (np.array(self.to) + self.from_) / 2).with_(name="beam")


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
        float, Within(above=0.0, below=1.0), "relative error of the volume at which no more sections are added"
    ] = 0.01  # fmt: skip
    most_sections: Annotated[int, Within(least=3, most=10000), "largest number of sections"] = MOST_SECTIONS


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WorkspaceStudy(Study):
    """Reachable tool centre points of a robot. After an interruption it contains the completed maps."""

    area: Annotated[float | None, Quantity("m2", "reachable area of the cross-section under all limits")] = None
    width: Annotated[float | None, Quantity("m", "width of the reachable area")] = None
    height: Annotated[float | None, Quantity("m", "height of the reachable area")] = None
    kinematic_area: Annotated[
        float | None, Quantity("m2", "reachable area under the singularity limit alone")
    ] = None  # fmt: skip
    kinematic_width: Annotated[float | None, Quantity("m", "width of the kinematic area")] = None
    kinematic_height: Annotated[float | None, Quantity("m", "height of the kinematic area")] = None
    cones: Annotated[
        Sequence[Mapping[str, float]],
        "for each angle of compare_cones_deg: angle_deg, area_m2, width_m, height_m under ball-joint cones alone",
    ] = ()
    guideway_rectangle: Annotated[
        float | None,
        Quantity("m2", "area of the axis-aligned rectangle spanned by the guideways in the section: the footprint"),
    ] = None
    area_ratio: Annotated[float | None, "ratio of area_m2 to the footprint"] = None
    volume: Annotated[
        float | None, Quantity("m3", "volume of the workspace along the guideways; null without [volume]")
    ] = None
    volume_error: Annotated[
        float | None,
        Quantity("m3", "error of the volume, estimated from the sections; null without [volume] or reached sections"),
    ] = None
    volume_sections: Annotated[int | None, "number of sections mapped for the volume"] = None
    volume_ratio: Annotated[
        float | None,
        "ratio of volume_m3 to the footprint times the longest stroke of limits.actuators_m; null without strokes",
    ] = None  # fmt: skip
    reasons: Annotated[
        Mapping[str, int],
        "number of grid points of the section by reason: reachable, no pose, or the first violated limit",
    ] = field(default_factory=dict)
    points: Annotated[Sequence[Mapping[str, Any]], "for each of points_m: tcp_m, reachable, sentence"] = ()
    on_edge: Annotated[
        bool | None, "whether the reachable area extends to the edge of the grid and is cut off there"
    ] = None  # fmt: skip
    volume_on_edge: Annotated[
        bool | None,
        "whether the volume extends to the first or last section or to the edge of a section; null without [volume]",
    ] = None
    assumptions: Annotated[
        Sequence[str], "assumptions about joints and bodies, in sentences"
    ] = ()  # fmt: skip

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [
            Row("reachable area of the section", self.area, "m2"),
            Row("its width", self.width, "m"),
            Row("its height", self.height, "m"),
            Row("area under the singularity limit alone", self.kinematic_area, "m2"),
        ]
        if self.area is None:  # interrupted
            rows = [row for row in rows if row.value is not None]
        rows += [Row(f"with cones of {c['angle_deg']:g} deg alone", c["area_m2"], "m2") for c in self.cones]
        if self.area is not None:
            rows.append(Row("ratio to the rectangle of the guideways", self.area_ratio))
        if self.volume is not None:
            rows.append(Row("volume", self.volume, "m3"))
            rows.append(Row("  its estimated error", self.volume_error, "m3"))
            rows.append(Row("  sections", self.volume_sections))
            rows.append(Row("ratio to the box of guideways and strokes", self.volume_ratio))
        rows += [Row(f"grid points: {reason}", count) for reason, count in self.reasons.items()]
        rows += [Row("point", point["sentence"]) for point in self.points]
        rows += [Row("assumed", sentence) for sentence in self.assumptions]
        return rows + [Row("cut", sentence) for sentence in self.cuts]

    @property
    def cuts(self) -> list[str]:
        """Sentences on the places where the workspace extends beyond the evaluated range."""
        cuts = ["the reachable area extends to the edge of the grid and is cut off there"] if self.on_edge else []
        if self.volume_on_edge:
            cuts.append("the volume extends to the first or last section or to the edge of one and is cut off there")
        return cuts
