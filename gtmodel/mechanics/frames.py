"""Connectors of mechanics, and the world with its gravity.

As states, coordinates of joints come before those of connectors: angles and travels 0, w -1, quaternions -2,
positions -3, rotation matrices -4.
"""

from __future__ import annotations

from typing import ClassVar

from .. import lang as gt


class PointFrame(gt.Connector):
    """A point in the world frame: position r [m]; force f [N] acting on the component at that point."""

    r = gt.potential(3, unit="m", prefer=-3, description="position in the world frame")
    f = gt.flow(3, unit="N", description="force on the component")


class Frame(gt.Connector):
    """A frame fixed to a rigid body; all vectors in world coordinates.

    R (3, 3) takes frame coordinates to world coordinates (its columns are the frame's axes) and w is its angular
    velocity, der(R) = w x R. The force f acts on the component at the frame's origin, the torque t is taken about it.
    """

    overdetermined: ClassVar[str] = (
        "the orientation R of a Frame has nine numbers for three degrees of freedom, so a loop of it contradicts "
        "itself; close the loop through rods or spherical joints, which pass no orientation on"
    )
    r = gt.potential(3, unit="m", prefer=-3, description="origin in the world frame")
    R = gt.potential((3, 3), unit="1", prefer=-4, description="rotation from frame to world coordinates")
    w = gt.potential(3, unit="rad/s", prefer=-1, description="angular velocity, world coordinates")
    f = gt.flow(3, unit="N", description="force on the component, world coordinates")
    t = gt.flow(3, unit="N.m", description="torque on the component about the origin, world coordinates")


class Flange(gt.Connector):
    """A translational flange: coordinate s [m]; force f [N] acting on the component along it."""

    s = gt.potential(unit="m", description="coordinate along the axis")
    f = gt.flow(unit="N", description="force on the component")


class Shaft(gt.Connector):
    """A rotational flange: angle phi [rad]; torque t [N.m] acting on the component along it."""

    phi = gt.potential(unit="rad", description="angle about the axis")
    t = gt.flow(unit="N.m", description="torque on the component")


class World(gt.Model):
    """Gravity; the default points along -z."""

    g = gt.parameter([0.0, 0.0, -9.81], unit="m/s2", description="gravitational acceleration")
