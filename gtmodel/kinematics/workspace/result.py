"""What a workspace study found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from ...results import Quantity, Row, Study


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WorkspaceStudy(Study):
    """Which tool centre points a robot reaches. Of a study that was interrupted it holds what was mapped until then."""

    area: Annotated[float | None, Quantity("m2", "area of the cross-section that is reached under all limits")] = None
    width: Annotated[float | None, Quantity("m", "its width")] = None
    height: Annotated[float | None, Quantity("m", "its height")] = None
    kinematic_area: Annotated[
        float | None,
        Quantity("m2", "area where the inverse kinematics has a solution, all limits left out but singularities"),
    ] = None
    kinematic_width: Annotated[float | None, Quantity("m", "its width")] = None
    kinematic_height: Annotated[float | None, Quantity("m", "its height")] = None
    cones: Annotated[
        Sequence[Mapping[str, float]],
        "for each angle of compare_cones_deg: angle_deg, area_m2, width_m, height_m under ball-joint cones alone",
    ] = ()
    guideway_rectangle: Annotated[
        float | None,
        Quantity("m2", "area of the upright rectangle that the guideways span in the section: the footprint"),
    ] = None
    area_ratio: Annotated[float | None, "area_m2 to that footprint"] = None
    volume: Annotated[
        float | None, Quantity("m3", "volume of the workspace along the guideways; null without [volume]")
    ] = None
    volume_error: Annotated[
        float | None,
        Quantity("m3", "its error, estimated from the sections; null without [volume], and where none is reached"),
    ] = None
    volume_sections: Annotated[int | None, "number of sections that were mapped for it"] = None
    volume_ratio: Annotated[
        float | None,
        "volume_m3 to the footprint times the longest stroke of limits.actuators_m; null without them",
    ] = None  # fmt: skip
    reasons: Annotated[
        Mapping[str, int],
        "number of grid points of the section by reason, the first limit that fails",
    ] = field(default_factory=dict)
    points: Annotated[Sequence[Mapping[str, Any]], "for each of points_m: tcp_m, reachable, sentence"] = ()
    on_edge: Annotated[bool | None, "whether the cross-section reaches the edge of the grid and is cut off there"] = (
        None
    )
    volume_on_edge: Annotated[
        bool | None,
        "whether the volume reaches the first or last section, or the edge of one; null without [volume]",
    ] = None
    assumptions: Annotated[
        Sequence[str], "what was assumed about joints and bodies, in sentences"
    ] = ()  # fmt: skip

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [
            Row("cross-section reached", self.area, "m2"),
            Row("its width", self.width, "m"),
            Row("its height", self.height, "m"),
            Row("where inverse kinematics exists", self.kinematic_area, "m2"),
        ]
        if self.area is None:  # interrupted
            rows = [row for row in rows if row.value is not None]
        rows += [Row(f"with cones of {c['angle_deg']:g} deg alone", c["area_m2"], "m2") for c in self.cones]
        if self.area is not None:
            rows.append(Row("to the rectangle of the guideways", self.area_ratio))
        if self.volume is not None:
            rows.append(Row("volume", self.volume, "m3"))
            rows.append(Row("  its error by the sections", self.volume_error, "m3"))
            rows.append(Row("  sections", self.volume_sections))
            rows.append(Row("to the box of guideways and strokes", self.volume_ratio))
        rows += [Row(f"grid points: {reason}", count) for reason, count in self.reasons.items()]
        rows += [Row("point", point["sentence"]) for point in self.points]
        rows += [Row("assumed", sentence) for sentence in self.assumptions]
        return rows + [Row("cut", sentence) for sentence in self.cuts]

    @property
    def cuts(self) -> list[str]:
        """Where the workspace goes on beyond what was looked at, in sentences."""
        cuts = ["the cross-section reaches the edge of the grid and is cut there"] if self.on_edge else []
        if self.volume_on_edge:
            cuts.append("the volume reaches its first or last section, or the edge of one, and is cut there")
        return cuts
