"""Optimal motions of serial arms through waypoints, with distances of the links kept.

arm_study            the optimal motion of an arm, re-simulated and checked: `ArmStudy`
ArmPose, Waypoint, ArmLimits   its options, with `AxisCost`, `AxisMesh`, `Solver` and `kinematics.Clearance`
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .motion_study import arm_study as arm_study
    from .options import ArmLimits as ArmLimits, ArmPose as ArmPose, ArmStudy as ArmStudy, Waypoint as Waypoint

public(__name__)
