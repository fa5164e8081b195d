"""All assembly modes of a platform on six legs, with a certificate that none is missing.

Modes
    assembly_modes        of one platform: joints A, B (6, 3), lengths L (6,) -> AssemblyModes
    assembly_modes_batch  of many platforms or poses at once
    AssemblyModes         real modes R, T, all complex ones, status, message, certificate
    Certificate           finite, real, distinct, residual, nearest other mode, retries

The study
    modes_study           of a robot in one pose or many, or of bare platforms: a ModesStudy
    CommandedPose, read_poses   poses of the robot, one by one or from a CSV file
    Hands, bare, draw     legs of platforms: of a robot, from arrays, or random

Start systems
    start_systems         the stored random complex platforms with their 40 solutions each
    StartSystem           one of them; run the module ``start_system`` to generate them again
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .modes import AssemblyModes as AssemblyModes, Certificate as Certificate
    from .modes_of_poses import modes_study as modes_study, read_poses as read_poses
    from .options import CommandedPose as CommandedPose, ModesStudy as ModesStudy
    from .six_links import Hands as Hands, bare as bare, draw as draw
    from .solve import assembly_modes as assembly_modes, assembly_modes_batch as assembly_modes_batch
    from .start_system import StartSystem as StartSystem, start_systems as start_systems

public(__name__)
