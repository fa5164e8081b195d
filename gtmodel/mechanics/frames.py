"""Connectors of mechanics, and the world with its gravity."""

from __future__ import annotations

from .. import lang as gt


class PointFrame(gt.Connector):
    """A point in the world frame: position r [m]; force f [N] acting on the component at that point."""

    r = gt.potential(3, unit="m", description="position in the world frame")
    f = gt.flow(3, unit="N", description="force on the component")


class Flange(gt.Connector):
    """A translational flange: coordinate s [m]; force f [N] acting on the component along it."""

    s = gt.potential(unit="m", description="coordinate along the axis")
    f = gt.flow(unit="N", description="force on the component")


class World(gt.Model):
    """Gravity; the default points along -z."""

    g = gt.parameter([0.0, 0.0, -9.81], unit="m/s2", description="gravitational acceleration")
