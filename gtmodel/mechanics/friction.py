"""Friction on a translational flange, regularised so that simulation and optimisation can use it."""

from __future__ import annotations

from typing import Any

from .. import lang as gt
from .frames import Flange
from .friction_law import CoulombViscousLaw, DirectionalLaw, ExactSign, PiecewiseLinearSign, StribeckLaw, TanhSign


class Friction(gt.Model):
    """Base: the flange feels `force` [N], positive against positive velocity."""

    flange = gt.port(Flange)
    force = gt.variable(unit="N", nominal=100.0, description="friction force against the motion")

    def equations(self):
        yield self.flange.f == self.force
        yield self.force == self.law(gt.der(self.flange.s))
        yield gt.energy(dissipated=self.force * gt.der(self.flange.s))

    def law(self, velocity) -> Any:
        """Friction force [N] as a function of velocity [m/s]."""
        raise gt.ModelError("a Friction must define law(velocity); use Frictionless, TanhFriction, ...")


class Frictionless(Friction):
    """No friction."""

    def law(self, velocity):
        return 0.0


class _CoulombViscous(Friction):
    coulomb = gt.parameter(0.0, unit="N", min=0.0, description="Coulomb friction force")
    viscous = gt.parameter(0.0, unit="kg/s", min=0.0, description="viscous friction coefficient")
    velocity_scale = gt.parameter(
        0.1, unit="m/s", positive=True, description="velocity at which the smoothed sign is near its end value"
    )


class TanhFriction(TanhSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction (Dressler 2012, eq. (6.8)), sign smoothed by tanh(velocity / velocity_scale)."""


class PiecewiseLinearFriction(PiecewiseLinearSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction (Dressler 2012, eq. (6.8)), sign smoothed by a straight line between
    -velocity_scale and velocity_scale."""


class SignFriction(ExactSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction exactly as in Dressler 2012, eq. (6.8): for identification away from zero velocity.

    Simulation and optimisation refuse it, for its jump.
    """


class _Directional(_CoulombViscous):
    coulomb = gt.parameter(0.0, unit="N", min=0.0, description="Coulomb friction force at positive velocity")
    viscous = gt.parameter(0.0, unit="kg/s", min=0.0, description="viscous friction coefficient at positive velocity")
    coulomb_minus = gt.parameter(unit="N", min=0.0, description="Coulomb friction force at negative velocity, positive")
    viscous_minus = gt.parameter(unit="kg/s", min=0.0, description="viscous friction coefficient at negative velocity")


class DirectionalTanhFriction(TanhSign, DirectionalLaw, _Directional):
    """Coefficients by direction (Dressler 2012, Table 6.1), sign smoothed by tanh(velocity / velocity_scale)."""


class DirectionalPiecewiseLinearFriction(PiecewiseLinearSign, DirectionalLaw, _Directional):
    """Coefficients by direction (Dressler 2012, Table 6.1), sign smoothed by a straight line."""


class DirectionalSignFriction(ExactSign, DirectionalLaw, _Directional):
    """Coefficients by direction (Dressler 2012, Table 6.1), for identification away from zero velocity only."""


class StribeckFriction(TanhSign, StribeckLaw, _CoulombViscous):
    """Friction that falls from `breakaway` to `coulomb` as the motion begins; sign smoothed by tanh.

    velocity_scale well below stribeck_velocity, or the peak is lost in the smoothing.
    """

    breakaway = gt.parameter(
        unit="N", min=_CoulombViscous.coulomb, description="friction force at the onset of motion, at least `coulomb`"
    )
    stribeck_velocity = gt.parameter(unit="m/s", positive=True, description="velocity over which friction falls")
