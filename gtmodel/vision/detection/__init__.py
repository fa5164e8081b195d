"""Where marks of a flat target are in a picture, to a fraction of a pixel. Needs OpenCV: pip install "gtmodel[vision]".

FiveSquares, Chessboard, Charuco   the targets: black squares of a tool, a board, a board with coded marks
detect                     the marks of a target in one picture: a Detection with a status, never a guess
Detection, DetectionStatus what was seen, and why not
background                 the median of pictures, against which the tool moves
detected_corners, corners_csv   many pictures of cameras and poses as one table of corners
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
