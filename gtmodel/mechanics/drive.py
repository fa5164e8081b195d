"""Drive trains on flanges and shafts: inertias, gear, rack and pinion."""

from __future__ import annotations

from .. import lang as gt
from .frames import Flange, Shaft


class Inertia(gt.Model):
    """Moment of inertia J [kg m2] on a shaft."""

    J = gt.parameter(unit="kg.m2", min=0.0, description="moment of inertia about the shaft")
    shaft = gt.port(Shaft)

    def equations(self):
        yield self.shaft.t == self.J * gt.der(self.shaft.phi, 2)
        yield gt.energy(stored=self.J / 2 * gt.der(self.shaft.phi) ** 2)


class Mass(gt.Model):
    """Mass m [kg] on a translational flange, without weight."""

    m = gt.parameter(unit="kg", min=0.0, description="mass moved along the flange")
    flange = gt.port(Flange)

    def equations(self):
        yield self.flange.f == self.m * gt.der(self.flange.s, 2)
        yield gt.energy(stored=self.m / 2 * gt.der(self.flange.s) ** 2)


class Gear(gt.Model):
    """Ideal gear: shaft a turns `ratio` times as fast as shaft b, backwards if it is negative; no losses."""

    ratio = gt.parameter(unit="1", nonzero=True, description="angle of a per angle of b")
    a = gt.port(Shaft)
    b = gt.port(Shaft)

    def equations(self):
        yield self.a.phi == self.ratio * self.b.phi
        yield self.ratio * self.a.t + self.b.t == 0


class RackAndPinion(gt.Model):
    """Pinion, belt or spindle: the flange moves by `radius` [m] per radian of the shaft; no losses."""

    radius = gt.parameter(unit="m", nonzero=True, description="travel per radian, pitch/(2 pi) of a spindle")
    shaft = gt.port(Shaft)
    flange = gt.port(Flange)

    def equations(self):
        yield self.flange.s == self.radius * self.shaft.phi
        yield self.shaft.t + self.radius * self.flange.f == 0
