"""Synthetic measurements: a robot with known errors at the poses of a grid, measured with noise.

Synthetic      options: seed, grid, sizes of the errors, device
made_poses     the poses for a study, with the text of the files and the robot with the errors
make, SyntheticFile   only the text of the files
disturbed      the robot with the errors
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
