"""Synthetic measurements: a robot with known errors put to poses of a grid and measured with noise.

Synthetic      seed, grid, sizes of the errors, device
made_poses     the poses as a study takes them, with the texts of the files and the robot with the errors
make, SyntheticFile   the texts alone
disturbed      the robot that is measured
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .measurements import (
        SyntheticFile as SyntheticFile,
        disturbed as disturbed,
        made_poses as made_poses,
        make as make,
    )
    from .options import Synthetic as Synthetic

public(__name__)
