"""A robot in space, in one HTML file: its parts from its model, its motion over time, its forces beside it.

scene         the scene of a robot and a motion
around        bodies and the robot at rest
RobotScene    points and frames over time, what joins and covers them, signals; as a page, picture or film
VisiblePart   a bar, joint, cart, face, guideway, path or set of axes
points_of     names of the points of a model

VisibleBody   vertices with triangles, lines or marks, fixed to a frame
dots, groups  marks at positions, all alike or one group for each label
lines, frustum lines of sight, what a camera sees
levels, thinned   marks at positions, in five groups by a value; which points of a grid are drawn
ellipsoid, ellipsoids, error_boxes, error_lines   uncertainty and errors of positions

Cuboid, Cylinder, Sphere, Capsule, MeshFile   what a part looks like, for `visual` of its class
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .bodies import (
        VisibleBody as VisibleBody,
        dots as dots,
        ellipsoid as ellipsoid,
        ellipsoids as ellipsoids,
        error_boxes as error_boxes,
        error_lines as error_lines,
        frustum as frustum,
        groups as groups,
        levels as levels,
        lines as lines,
        thinned as thinned,
    )
    from .robot import around as around, points_of as points_of, scene as scene
    from .solids import (
        Capsule as Capsule,
        Cuboid as Cuboid,
        Cylinder as Cylinder,
        MeshFile as MeshFile,
        Sphere as Sphere,
        VisibleSolid as VisibleSolid,
    )
    from .space import RobotScene as RobotScene, VisiblePart as VisiblePart

public(__name__)
