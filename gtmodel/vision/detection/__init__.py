"""Detect the marks of planar targets in pictures with subpixel accuracy. Needs OpenCV: pip install "gtmodel[vision]".

FiveSquares, Chessboard, Charuco   the targets: black squares of a tool, a board, a board with coded marks
detect                     detect the marks of a target in one picture; all marks that the target needs, or none
Detection, DetectionStatus the detected marks, or the reason why there are none
background                 the median of pictures in which the tool moves
detected_corners, corners_csv   pictures of several cameras and poses to one table of corners
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .marks import (
        CornerRow as CornerRow,
        background as background,
        corners_csv as corners_csv,
        detect as detect,
        detected_corners as detected_corners,
    )
    from .targets import (
        Charuco as Charuco,
        Chessboard as Chessboard,
        Detection as Detection,
        DetectionStatus as DetectionStatus,
        FiveSquares as FiveSquares,
    )

public(__name__)
