"""What keeps clear: capsules around links, obstacles, and the required distance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from ...results.options import Long, Options, Unit, Within


@dataclass(frozen=True)
class LinkCapsule(Options):
    """A capsule around a link: all points within `radius` of the segment from begin to end; a sphere if these are
    equal.

    >>> gt.kinematics.LinkCapsule("forearm", begin=[0.0, 0.0, 0.0], end=[0.4, 0.0, 0.0], radius=0.05).radius
    0.05
    """

    link: Annotated[str, "name of the link, or of the base"]
    begin: Annotated[list[float], Unit("m"), Long(3), "one end of its segment, in the frame of the link"]
    end: Annotated[list[float], Unit("m"), Long(3), "the other end"]
    radius: Annotated[float, Unit("m"), Within(above=0.0), "its radius"]


@dataclass(frozen=True)
class CapsuleObstacle(Options):
    """A capsule in the world, or a sphere if begin and end are equal.

    >>> gt.kinematics.CapsuleObstacle([0.4, 0.0, 0.0], [0.4, 0.0, 0.5], 0.05).radius
    0.05
    """

    begin: Annotated[list[float], Unit("m"), Long(3), "one end of its segment, world coordinates"]
    end: Annotated[list[float], Unit("m"), Long(3), "the other end; that of a sphere is the same"]
    radius: Annotated[float, Unit("m"), Within(above=0.0), "its radius"]


@dataclass(frozen=True)
class BoxObstacle(Options):
    """A box in the world.

    >>> gt.kinematics.BoxObstacle([0.4, 0.0, 0.1], [0.2, 0.3, 0.2]).rpy
    [0.0, 0.0, 0.0]
    """

    center: Annotated[list[float], Unit("m"), Long(3), "its centre, world coordinates"]
    size: Annotated[list[float], Unit("m"), Within(above=0.0), Long(3), "its edge lengths"]
    rpy: Annotated[
        list[float], Unit("rad", written="deg"), Long(3), "its orientation: Rz(yaw) Ry(pitch) Rx(roll)"
    ] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # fmt: skip


@dataclass(frozen=True)
class PlaneObstacle(Options):
    """A plane, such as floor or wall; the links stay on the side to which its normal points.

    >>> gt.kinematics.PlaneObstacle([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]).normal
    [0.0, 0.0, 1.0]
    """

    point: Annotated[list[float], Unit("m"), Long(3), "a point of the plane, world coordinates"]
    normal: Annotated[list[float], Long(3), "its normal, towards the free side; of any length"]


@dataclass(frozen=True)
class Clearance(Options):
    """Required distance between the links of an arm, and from obstacles.

    capsules: around links; those of a link replace the shapes of its file. A URDF's collision geometry is the default:
    spheres, and capsules around cylinders and boxes; meshes count as nothing. Pairs of neighbouring links are left out.

    >>> floor = gt.kinematics.PlaneObstacle(point=[0.0, 0.0, 0.0], normal=[0.0, 0.0, 1.0])
    >>> gt.kinematics.Clearance(distance=0.02, planes=[floor]).distance  # [m]
    0.02
    """

    distance: Annotated[float, Unit("m"), Within(least=0.0), "required distance"] = 0.01
    capsules: Annotated[
        list[LinkCapsule], "capsules around links, in place of those that the URDF gives to these links"
    ] = field(default_factory=list)  # fmt: skip
    ignored: Annotated[
        list[list[str]], "further pairs of links that are not compared, such as [[\"wrist_1\", \"wrist_3\"]]"
    ] = field(default_factory=list)  # fmt: skip
    obstacles: Annotated[list[CapsuleObstacle], "capsules and spheres to avoid"] = field(default_factory=list)
    boxes: Annotated[list[BoxObstacle], "boxes to avoid"] = field(default_factory=list)
    planes: Annotated[list[PlaneObstacle], "planes to stay above"] = field(default_factory=list)
