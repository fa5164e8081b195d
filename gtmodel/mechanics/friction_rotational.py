"""Friction on a shaft: the laws of friction.py with torques and angular velocities."""

from __future__ import annotations

from .. import lang as gt
from .frames import Shaft
from .friction_law import CoulombViscousLaw, DirectionalLaw, PiecewiseLinearSign, StribeckLaw, TanhSign


class RotationalFriction(gt.Model):
    """Base: the shaft feels `torque` [N.m], positive against positive velocity."""

    shaft = gt.port(Shaft)
    torque = gt.variable(unit="N.m", nominal=10.0, description="friction torque against the motion")

    def equations(self):
        yield self.shaft.t == self.torque
        yield self.torque == self.law(gt.der(self.shaft.phi))
        yield gt.energy(dissipated=self.torque * gt.der(self.shaft.phi))

    def law(self, velocity):
        """Friction torque [N.m] as a function of angular velocity [rad/s]."""
        raise gt.ModelError("a RotationalFriction must define law(velocity); use RotationalTanhFriction, ...")


class _CoulombViscous(RotationalFriction):
    coulomb = gt.parameter(0.0, unit="N.m", min=0.0, description="Coulomb friction torque")
    viscous = gt.parameter(0.0, unit="N.m.s/rad", min=0.0, description="viscous friction coefficient")
    velocity_scale = gt.parameter(
        0.1, unit="rad/s", positive=True, description="velocity at which the smoothed sign is near its end value"
    )


class RotationalTanhFriction(TanhSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction, sign smoothed by tanh(velocity / velocity_scale)."""


class RotationalPiecewiseLinearFriction(PiecewiseLinearSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction, sign smoothed by a straight line between -velocity_scale and velocity_scale."""


class _Directional(_CoulombViscous):
    coulomb = gt.parameter(0.0, unit="N.m", min=0.0, description="Coulomb friction torque at positive velocity")
    viscous = gt.parameter(
        0.0, unit="N.m.s/rad", min=0.0, description="viscous friction coefficient at positive velocity"
    )
    coulomb_minus = gt.parameter(
        unit="N.m", min=0.0, description="Coulomb friction torque at negative velocity, positive"
    )
    viscous_minus = gt.parameter(
        unit="N.m.s/rad", min=0.0, description="viscous friction coefficient at negative velocity"
    )


class RotationalDirectionalTanhFriction(TanhSign, DirectionalLaw, _Directional):
    """Coefficients by direction, sign smoothed by tanh(velocity / velocity_scale)."""


class RotationalDirectionalPiecewiseLinearFriction(PiecewiseLinearSign, DirectionalLaw, _Directional):
    """Coefficients by direction, sign smoothed by a straight line."""


class RotationalStribeckFriction(TanhSign, StribeckLaw, _CoulombViscous):
    """Friction that falls from `breakaway` to `coulomb` as the motion begins; sign smoothed by tanh.

    velocity_scale well below stribeck_velocity, or the peak is lost in the smoothing.
    """

    breakaway = gt.parameter(
        unit="N.m",
        min=_CoulombViscous.coulomb,
        description="friction torque at the onset of motion, at least `coulomb`",
    )
    stribeck_velocity = gt.parameter(unit="rad/s", positive=True, description="velocity over which friction falls")
