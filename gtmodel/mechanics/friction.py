"""Friction on a translational flange, regularised so that simulation and optimisation can use it."""

from __future__ import annotations

from typing import Any

from .. import lang as gt
from .frames import Flange
from .friction_law import CoulombViscousLaw, DirectionalLaw, ExactSign, PiecewiseLinearSign, StribeckLaw, TanhSign


class Friction(gt.Model):
    """Base of friction on a flange: `force` [N] has the sign of the velocity der(flange.s) and resists it.

    Subclasses define law(velocity); raises ModelError where none does.

    A law of one's own, quadratic in the velocity as of a fluid, on a carriage that coasts at 2 m/s:

    >>> class Drag(gt.mechanics.Friction):
    ...     c = gt.parameter(unit="kg/m", min=0.0, description="force per square of the velocity")
    ...
    ...     def law(self, velocity):
    ...         return self.c * velocity * gt.absolute(velocity)
    ...
    >>> bench = gt.Builder("bench")
    >>> carriage = bench.part("carriage", gt.mechanics.Mass(m=12.0))
    >>> drag = bench.part("drag", Drag(c=6.0))
    >>> bench.add(gt.connect(carriage.flange, drag.flange))
    >>> coast = bench.causal(targets=["drag.force", "der(carriage.flange.s,2)"], prefer="carriage.flange.s")
    >>> force, acceleration, status = coast(2.0)
    >>> print(force, acceleration)
    24.0 -2.0
    """

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
    """No friction: takes the place of a friction part, whose parameters it accepts and which have no effect here.

    A carriage at constant velocity needs no force.

    >>> bench = gt.Builder("bench")
    >>> carriage = bench.part("carriage", gt.mechanics.Mass(m=12.0))
    >>> slide = bench.part("slide", gt.mechanics.Frictionless())
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> bench.add(gt.connect([carriage.flange, slide.flange], [motor.flange, motor.flange]))
    >>> inverse = bench.causal(known="motor.flange.s", targets=["slide.force", "motor.force"])
    >>> friction, force, status = inverse(0.0, 2.0, 0.0)  # at 2 m/s
    >>> print(friction, force)
    0.0 0.0
    """

    coulomb = gt.parameter(0.0, unit="N", min=0.0, description="without effect")
    viscous = gt.parameter(0.0, unit="kg/s", min=0.0, description="without effect")
    velocity_scale = gt.parameter(0.1, unit="m/s", positive=True, description="without effect")

    def law(self, velocity):
        return 0.0


class _CoulombViscous(Friction):
    coulomb = gt.parameter(0.0, unit="N", min=0.0, description="Coulomb friction force")
    viscous = gt.parameter(0.0, unit="kg/s", min=0.0, description="viscous friction coefficient")
    velocity_scale = gt.parameter(
        0.1, unit="m/s", positive=True, description="velocity at which the smoothed sign is near its end value"
    )


class TanhFriction(TanhSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction (Dressler 2012, eq. (6.8)), sign smoothed by tanh(velocity / velocity_scale).

    At twice the velocity scale the smoothed sign is tanh(2) = 0.96:

    >>> friction = gt.mechanics.TanhFriction(coulomb=100.0, viscous=50.0, velocity_scale=0.1)
    >>> print(round(friction.law(0.2), 3), round(friction.law(-0.2), 3))
    106.403 -106.403
    """


class PiecewiseLinearFriction(PiecewiseLinearSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction (Dressler 2012, eq. (6.8)), sign smoothed by a straight line between
    -velocity_scale and velocity_scale.

    Half of the Coulomb friction at half the velocity scale, all of it from the scale on:

    >>> friction = gt.mechanics.PiecewiseLinearFriction(coulomb=100.0, viscous=50.0, velocity_scale=0.1)
    >>> print(friction.law(0.05), friction.law(0.1), friction.law(-0.2))
    52.5 105.0 -110.0
    """


class SignFriction(ExactSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction exactly as in Dressler 2012, eq. (6.8): for identification away from zero velocity.

    Simulation and optimisation refuse it, because the force jumps at standstill.

    The jump at standstill; the law itself takes numbers:

    >>> friction = gt.mechanics.SignFriction(coulomb=100.0, viscous=50.0)
    >>> print(friction.law(-0.2), friction.law(0.0), friction.law(0.2))
    -110.0 0.0 110.0
    """


class _Directional(_CoulombViscous):
    coulomb = gt.parameter(0.0, unit="N", min=0.0, description="Coulomb friction force at positive velocity")
    viscous = gt.parameter(0.0, unit="kg/s", min=0.0, description="viscous friction coefficient at positive velocity")
    coulomb_minus = gt.parameter(unit="N", min=0.0, description="Coulomb friction force at negative velocity, positive")
    viscous_minus = gt.parameter(unit="kg/s", min=0.0, description="viscous friction coefficient at negative velocity")


class DirectionalTanhFriction(TanhSign, DirectionalLaw, _Directional):
    """Coulomb and viscous friction by direction (Dressler 2012, Table 6.1).

    The sign is smoothed by tanh(velocity / velocity_scale).

    Cart 1 of the L1 of Table 6.1 at 0.5 m/s both ways; coefficients of both directions are positive numbers:

    >>> friction = gt.mechanics.DirectionalTanhFriction(
    ...     coulomb=189.12, viscous=205.03, coulomb_minus=145.69, viscous_minus=158.01, velocity_scale=0.05
    ... )
    >>> print(round(friction.law(0.5), 2), round(friction.law(-0.5), 2))
    291.63 -224.69
    """


class DirectionalPiecewiseLinearFriction(PiecewiseLinearSign, DirectionalLaw, _Directional):
    """Coulomb and viscous friction by direction (Dressler 2012, Table 6.1), sign smoothed by a straight line.

    From the velocity scale on, each direction has its own coefficients in full:

    >>> friction = gt.mechanics.DirectionalPiecewiseLinearFriction(
    ...     coulomb=100.0, viscous=50.0, coulomb_minus=80.0, viscous_minus=40.0, velocity_scale=0.05
    ... )
    >>> print(friction.law(0.5), friction.law(-0.5))
    125.0 -100.0
    """


class DirectionalSignFriction(ExactSign, DirectionalLaw, _Directional):
    """Coulomb and viscous friction by direction (Dressler 2012, Table 6.1), with the exact sign.

    For identification away from zero velocity only: simulation and optimisation refuse it.

    Positive numbers for both directions; the force has the sign of the velocity:

    >>> friction = gt.mechanics.DirectionalSignFriction(
    ...     coulomb=100.0, viscous=50.0, coulomb_minus=80.0, viscous_minus=40.0
    ... )
    >>> print(friction.law(0.01), friction.law(-0.01))
    100.5 -80.4
    """


class StribeckFriction(TanhSign, StribeckLaw, _CoulombViscous):
    """Friction that falls from `breakaway` to `coulomb` as the motion begins; sign smoothed by tanh.

    The fall is exp(-(velocity / stribeck_velocity)^2). Choose velocity_scale well below stribeck_velocity, or the peak
    is lost in the smoothing.

    From about 150 N at the onset of motion it falls to 100 N:

    >>> friction = gt.mechanics.StribeckFriction(
    ...     coulomb=100.0, breakaway=150.0, stribeck_velocity=0.05, velocity_scale=0.002
    ... )
    >>> print(*[round(friction.law(v), 1) for v in (0.005, 0.05, 0.2)])
    147.5 118.4 100.0
    """

    breakaway = gt.parameter(
        unit="N", min=_CoulombViscous.coulomb, description="friction force at the onset of motion, at least `coulomb`"
    )
    stribeck_velocity = gt.parameter(unit="m/s", positive=True, description="velocity over which friction falls")
