"""Workspace of a robot: which tool centre points it reaches under limits, and area, boundary and volume of them.

Points: Grid, box_grid, section_grid. The robot: InverseKinematics, Poses. Limits: ActuatorLimits, BallJointCones,
CartesianBox, Singularities, Obstacles, LinkClearance, FrameClearance. Maps: Reach, map_grid, map_section, map_volume.
Shapes: Region, region.
"""

from .clearance import FrameClearance, LinkClearance, Obstacles
from .cross_section import Region, region
from .grid import Grid, box_grid, section_grid
from .limits import ActuatorLimits, BallJointCones, CartesianBox, Limit, Singularities
from .poses import InverseKinematics, Poses
from .reach import FIRST_LIMIT, NOT_LOOKED_AT, REACHABLE, Reach, ReachMap, map_grid
from .volume import SectionMap, Volume, map_section, map_volume

__all__ = [
    "FIRST_LIMIT",
    "NOT_LOOKED_AT",
    "REACHABLE",
    "ActuatorLimits",
    "BallJointCones",
    "CartesianBox",
    "FrameClearance",
    "Grid",
    "InverseKinematics",
    "Limit",
    "LinkClearance",
    "Obstacles",
    "Poses",
    "Reach",
    "ReachMap",
    "Region",
    "SectionMap",
    "Singularities",
    "Volume",
    "box_grid",
    "map_grid",
    "map_section",
    "map_volume",
    "region",
    "section_grid",
]
