"""Friction laws, force or torque over velocity, and friction on a translational flange, regularised for simulation and
optimisation or exact."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from .. import lang as gt
from .frames import Flange

# of the velocity scale: what starts slower starts at rest
STANDSTILL = 1e-8


class TanhSign:
    """Sign smoothed by tanh(velocity / velocity_scale)."""

    def smooth_sign(self, ratio: Any) -> Any:
        return gt.tanh(ratio)


class PiecewiseLinearSign:
    """Sign smoothed by a straight line between -velocity_scale and velocity_scale."""

    def smooth_sign(self, ratio: Any) -> Any:
        return gt.clip(ratio, -1.0, 1.0)


class ExactSign:
    """The sign itself, 0 at standstill; velocity_scale is not used."""

    def smooth_sign(self, ratio: Any) -> Any:
        return gt.sign(ratio)


class CoulombViscousLaw:
    """Coulomb and viscous friction, the same in both directions (Dressler 2012, eq. (6.8))."""

    def law(self: Any, velocity: Any) -> Any:
        return self.coulomb * self.smooth_sign(velocity / self.velocity_scale) + self.viscous * velocity


class DirectionalLaw:
    """Coulomb and viscous friction with coefficients by direction (Dressler 2012, section 6.2 and Table 6.1).

    Both coefficients pass from one value to the other with the same smoothed sign that smooths the Coulomb friction:
    no corner is added, and the law is that of the plus (minus) side wherever the sign is 1 (-1).
    """

    def law(self: Any, velocity: Any) -> Any:
        s = self.smooth_sign(velocity / self.velocity_scale)
        coulomb = self.coulomb * ((1.0 + s) / 2) + self.coulomb_minus * ((1.0 - s) / 2)
        viscous = self.viscous * ((1.0 + s) / 2) + self.viscous_minus * ((1.0 - s) / 2)
        return coulomb * s + viscous * velocity


class StribeckLaw:
    """Friction that falls from `breakaway` at standstill to `coulomb` over stribeck_velocity, Gaussian, and viscous."""

    def law(self: Any, velocity: Any) -> Any:
        fall = gt.exp(-((velocity / self.stribeck_velocity) ** 2))
        level = self.coulomb + (self.breakaway - self.coulomb) * fall
        return level * self.smooth_sign(velocity / self.velocity_scale) + self.viscous * velocity


class StuckOrSliding:
    """The sign by the state `slides` of the friction: 1 forward, -1 backward, 0 stuck; velocity_scale is not used."""

    def smooth_sign(self: Any, ratio: Any) -> Any:
        return self.slides


def stiction(friction: Any, coordinate: Any, force: Any) -> Generator[Any, None, None]:
    """Equations of a friction with the state `slides`, on a coordinate.

    Stuck: no acceleration, and the force that this takes, until it reaches the break-away force. Sliding: its law,
    until the velocity is zero; there it is stuck, for this instant at least.
    """
    breakaway = friction.breakaway_ratio * friction.coulomb
    velocity, stuck = gt.der(coordinate), (friction.slides > -0.5) & (friction.slides < 0.5)
    yield gt.If(stuck, gt.der(coordinate, 2) == 0.0, force == friction.law(velocity))
    # at the break-away force itself it holds
    yield gt.when(stuck & (force > breakaway), friction.slides == 1.0)
    yield gt.when(stuck & (force < -breakaway), friction.slides == -1.0)
    yield gt.when(friction.slides * velocity <= 0.0, friction.slides == 0.0)
    # what moves at the start slides, and so does what is pushed hard enough
    moves, pushed = velocity / friction.velocity_scale, force / breakaway
    yield gt.when(
        gt.initial() & stuck, friction.slides == gt.sign(2.0 * _direction(moves, STANDSTILL) + _direction(pushed, 1.0))
    )


def _direction(x: Any, least: float) -> Any:
    """1 above `least`, -1 below -`least`, 0 in between."""
    return gt.sign(gt.sign(x - least) + gt.sign(x + least))


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

    Optimisation refuses it, because the force jumps at standstill. A simulation switches there, and ends where the
    motion would stay at zero velocity: `StictionFriction` sticks.

    The jump at standstill; the law itself takes numbers:

    >>> friction = gt.mechanics.SignFriction(coulomb=100.0, viscous=50.0)
    >>> print(friction.law(-0.2), friction.law(0.0), friction.law(0.2))
    -110.0 0.0 110.0
    """


class StictionFriction(StuckOrSliding, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction that sticks: the states stuck, forward and backward, for simulation.

    Stuck it holds against up to breakaway_ratio times the Coulomb friction, without creeping; sliding its force is
    that of `SignFriction`. `slides` is 1 forward, -1 backward and 0 stuck. At the start it follows from the velocity,
    and at rest from the force. It takes the place of any law with the same parameters; optimisations take a smooth
    one. Not for a flange whose motion is prescribed, nor twice on rigidly coupled flanges: the forces of two that
    stick have no unique values there.

    A motor pushes a carriage of 2 kg ever harder, by 10 N/s. It breaks away at 1.2 times 5 N, after 0.6 s:

    >>> bench = gt.Builder("bench")
    >>> motor = bench.part("motor", gt.mechanics.ForceMotor())
    >>> carriage = bench.part("carriage", gt.mechanics.Mass(m=2.0))
    >>> slide = bench.part("slide", gt.mechanics.StictionFriction(coulomb=5.0, breakaway_ratio=1.2))
    >>> bench.add(gt.connect([motor.flange, slide.flange], [carriage.flange, carriage.flange]))
    >>> start = {"carriage.flange.s": 0.0, "der(carriage.flange.s)": 0.0}
    >>> run = bench.simulate(1.0, start=start, inputs={"motor.force": lambda t: 10.0 * t})
    >>> [round(e.time, 9) for e in run.events], run.trajectory["slide.slides"][[0, -1]].tolist()
    ([0.6], [0.0, 1.0])
    """

    coulomb = gt.parameter(unit="N", positive=True, description="Coulomb friction force while it slides")
    velocity_scale = gt.parameter(
        0.1, unit="m/s", positive=True, description="what starts slower than 1e-8 of it starts at rest"
    )
    breakaway_ratio = gt.parameter(
        1.0, unit="1", min=1.0, description="break-away force in parts of the Coulomb friction"
    )
    slides = gt.discrete(0.0, description="1 forward, -1 backward, 0 stuck")

    def equations(self):
        yield self.flange.f == self.force
        yield from stiction(self, self.flange.s, self.force)
        yield gt.energy(dissipated=self.force * gt.der(self.flange.s))


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

    For identification away from zero velocity: optimisation refuses it, and a simulation ends where it would stick.

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
