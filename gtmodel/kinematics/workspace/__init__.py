"""Workspace of a robot: reachable tool centre points under limits, with area, boundary and volume.

The study: workspace_study, WorkspaceStudy; options: WorkspaceLimits, CrossSection, Sections, Bodies, Box, Beam.
Points: Grid, box_grid, section_grid. The robot: InverseKinematics, Poses. Limits: ActuatorLimits, BallJointCones,
CartesianBox, Singularities, Obstacles, LinkClearance, FrameClearance. Maps: Reach, map_grid, map_section, map_volume.
Shapes: Region, region. Robots under limits: limited_mechanism, limits_of.
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from ..mechanism import InverseKinematics as InverseKinematics, Poses as Poses
    from ..section import CrossSection as CrossSection, Grid as Grid, box_grid as box_grid, section_grid as section_grid
    from .clearance import FrameClearance as FrameClearance, LinkClearance as LinkClearance, Obstacles as Obstacles
    from .limits import (
        ActuatorLimits as ActuatorLimits,
        BallJointCones as BallJointCones,
        CartesianBox as CartesianBox,
        Limit as Limit,
        Singularities as Singularities,
    )
    from .options import (
        Beam as Beam,
        Bodies as Bodies,
        Box as Box,
        Sections as Sections,
        WorkspaceLimits as WorkspaceLimits,
        WorkspaceStudy as WorkspaceStudy,
    )
    from .reach import (
        FIRST_LIMIT as FIRST_LIMIT,
        NOT_LOOKED_AT as NOT_LOOKED_AT,
        REACHABLE as REACHABLE,
        Reach as Reach,
        ReachMap as ReachMap,
        limited_mechanism as limited_mechanism,
        limits_of as limits_of,
        map_grid as map_grid,
    )
    from .volume import (
        Region as Region,
        SectionMap as SectionMap,
        Volume as Volume,
        map_section as map_section,
        map_volume as map_volume,
        region as region,
    )
    from .workspace_study import workspace_study as workspace_study

public(__name__)
