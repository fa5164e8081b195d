"""Measured poses: read from a file, split into fitted and held-out ones, checked before a fit.

Measured, MeasuredSignal, MeasuredPoint, FrameStart, Sag   columns of a file; frames and points of device and robot
read_poses        the poses of a CSV file
MeasuredPoses     poses with information about their file
Refit             parameters specific to a held-out recording
CartPoints, read_cart_points   guideways through measured points of the carts
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from ..variants import read_cart_points as read_cart_points
    from .options import (
        CartPoints as CartPoints,
        FrameStart as FrameStart,
        Measured as Measured,
        MeasuredPoint as MeasuredPoint,
        MeasuredSignal as MeasuredSignal,
        Refit as Refit,
        Sag as Sag,
    )
    from .poses import MeasuredPoses as MeasuredPoses
    from .reading_file import read_poses as read_poses

public(__name__)
