"""Friction on a translational flange, regularised so that simulation and optimisation can use it."""

from __future__ import annotations

from .. import lang as gt
from .frames import Flange


class Friction(gt.Model):
    """Base: the flange feels `force` [N], positive against positive velocity."""

    flange = gt.port(Flange)
    force = gt.variable(unit="N", nominal=100.0, description="friction force against the motion")

    def equations(self):
        yield self.flange.f == self.force
        yield self.force == self.law(gt.der(self.flange.s))

    def law(self, velocity):
        """Friction force [N] as a function of velocity [m/s]."""
        raise gt.ModelError("a Friction must define law(velocity); use Frictionless, TanhFriction, ...")


class Frictionless(Friction):
    """No friction."""

    def law(self, velocity):
        return 0.0


class _CoulombViscous(Friction):
    """Coulomb and viscous friction (Dressler 2012, eq. (6.8)) with a smoothed sign."""

    coulomb = gt.parameter(0.0, unit="N", description="Coulomb friction force")
    viscous = gt.parameter(0.0, unit="kg/s", description="viscous friction coefficient")
    velocity_scale = gt.parameter(
        0.1, unit="m/s", positive=True, description="velocity at which the smoothed sign is near its end value"
    )

    def law(self, velocity):
        return self.coulomb * self.smooth_sign(velocity / self.velocity_scale) + self.viscous * velocity


class TanhFriction(_CoulombViscous):
    """Sign smoothed by tanh(velocity / velocity_scale)."""

    def smooth_sign(self, ratio):
        return gt.tanh(ratio)


class PiecewiseLinearFriction(_CoulombViscous):
    """Sign smoothed by a straight line between -velocity_scale and velocity_scale."""

    def smooth_sign(self, ratio):
        return gt.clip(ratio, -1.0, 1.0)
