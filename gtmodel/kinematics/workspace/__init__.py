"""Workspace of a robot: which tool centre points it reaches under limits, and area, boundary and volume of them.

The study: workspace_study, WorkspaceStudy, asked for by Limits, CrossSection, Sections, Bodies, Box, Beam.
Points: Grid, box_grid, section_grid. The robot: InverseKinematics, Poses. Limits: ActuatorLimits, BallJointCones,
CartesianBox, Singularities, Obstacles, LinkClearance, FrameClearance. Maps: Reach, map_grid, map_section, map_volume.
Shapes: Region, region. Robots under limits: limited_mechanism, limits_of.
"""

from ..poses import InverseKinematics, Poses
from ..section import CrossSection
from .clearance import FrameClearance, LinkClearance, Obstacles
from .cross_section import Region, region
from .grid import Grid, box_grid, section_grid
from .limited import limited_mechanism, limits_of
from .limits import ActuatorLimits, BallJointCones, CartesianBox, Limit, Singularities
from .options import Beam, Bodies, Box, Limits, Sections
from .reach import FIRST_LIMIT, NOT_LOOKED_AT, REACHABLE, Reach, ReachMap, map_grid
from .reached import workspace_study
from .result import WorkspaceStudy
from .volume import SectionMap, Volume, map_section, map_volume

__all__ = [
    "FIRST_LIMIT",
    "NOT_LOOKED_AT",
    "REACHABLE",
    "ActuatorLimits",
    "BallJointCones",
    "Beam",
    "Bodies",
    "Box",
    "CartesianBox",
    "CrossSection",
    "FrameClearance",
    "Grid",
    "InverseKinematics",
    "Limit",
    "Limits",
    "LinkClearance",
    "Obstacles",
    "Poses",
    "Reach",
    "ReachMap",
    "Region",
    "SectionMap",
    "Sections",
    "Singularities",
    "Volume",
    "WorkspaceStudy",
    "box_grid",
    "limited_mechanism",
    "limits_of",
    "map_grid",
    "map_section",
    "map_volume",
    "region",
    "section_grid",
    "workspace_study",
]
