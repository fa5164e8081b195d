"""Cameras that measure a robot: where marks are in pictures, and what cameras and robot say together. Knows no robot.

Packages
    detection      marks of boards and of a tool's squares in pictures, as a table of corners; needs OpenCV
    rendering      synthetic pictures with exact area coverage
    robot_cameras  a robot and cameras calibrated together; where two cameras should stand
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from . import detection as detection, rendering as rendering, robot_cameras as robot_cameras

public(__name__)
