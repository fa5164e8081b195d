"""A robot in space, in one HTML file: its parts from its model, its motion over time, its forces beside it.

scene         the scene of a robot and a motion
RobotScene    points over time, parts that join them, signals; as a page
VisiblePart   a bar, joint, cart, face, guideway, path or set of axes
points_of     names of the points of a model
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .robot import points_of as points_of, scene as scene
    from .space import RobotScene as RobotScene, VisiblePart as VisiblePart

public(__name__)
