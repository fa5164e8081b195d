"""Friction laws as functions of velocity, and friction on a translational flange: smoothed for simulation and
optimisation, or exact."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from .. import lang as gt
from .frames import Flange

STANDSTILL = 1e-8  # a start velocity below this share of the velocity scale is rest


class TanhSign:
    """Sign smoothed by tanh(velocity / velocity_scale)."""

    def smooth_sign(self, ratio: Any) -> Any:
        return gt.tanh(ratio)


class PiecewiseLinearSign:
    """Sign smoothed by a straight line between -velocity_scale and velocity_scale."""

    def smooth_sign(self, ratio: Any) -> Any:
        return gt.clip(ratio, -1.0, 1.0)


class ExactSign:
    """The exact sign, 0 at standstill; velocity_scale is not used."""

    def smooth_sign(self, ratio: Any) -> Any:
        return gt.sign(ratio)


class CoulombViscousLaw:
    """Coulomb and viscous friction, the same in both directions (Dressler 2012, eq. (6.8))."""

    def law(self: Any, velocity: Any) -> Any:
        return self.coulomb * self.smooth_sign(velocity / self.velocity_scale) + self.viscous * velocity


class DirectionalLaw:
    """Coulomb and viscous friction with coefficients for each direction (Dressler 2012, section 6.2 and Table 6.1).

    The smoothed sign of the Coulomb friction also blends both coefficients: it adds no corner, and where the sign is 1
    (-1) the law is that of the plus (minus) side.
    """

    def law(self: Any, velocity: Any) -> Any:
        s = self.smooth_sign(velocity / self.velocity_scale)
        coulomb = self.coulomb * ((1.0 + s) / 2) + self.coulomb_minus * ((1.0 - s) / 2)
        viscous = self.viscous * ((1.0 + s) / 2) + self.viscous_minus * ((1.0 - s) / 2)
        return coulomb * s + viscous * velocity


class StribeckLaw:
    """Viscous friction plus friction that falls from `breakaway` at standstill to `coulomb` as a Gaussian."""

    def law(self: Any, velocity: Any) -> Any:
        fall = gt.exp(-((velocity / self.stribeck_velocity) ** 2))
        level = self.coulomb + (self.breakaway - self.coulomb) * fall
        return level * self.smooth_sign(velocity / self.velocity_scale) + self.viscous * velocity


class StuckOrSliding:
    """The sign from the state `slides`: 1 forward, -1 backward, 0 stuck; velocity_scale is not used."""

    def smooth_sign(self: Any, ratio: Any) -> Any:
        return self.slides


def stiction(friction: Any, coordinate: Any, force: Any) -> Generator[Any, None, None]:
    """Yield the equations of a friction with the state `slides`, on a coordinate.

    Stuck: the acceleration is zero, and the force follows from that until it exceeds the break-away force. Sliding: the
    force follows from the law until the velocity is zero; then the state is stuck, at least for this instant.
    """
    breakaway = friction.breakaway_ratio * friction.coulomb
    velocity, stuck = gt.der(coordinate), (friction.slides > -0.5) & (friction.slides < 0.5)
    yield gt.If(stuck, gt.der(coordinate, 2) == 0.0, force == friction.law(velocity))
    # at exactly the break-away force it still sticks
    yield gt.when(stuck & (force > breakaway), friction.slides == 1.0)
    yield gt.when(stuck & (force < -breakaway), friction.slides == -1.0)
    yield gt.when(friction.slides * velocity <= 0.0, friction.slides == 0.0)
    # at the start it slides if it moves, or if the force exceeds the break-away force
    moves, pushed = velocity / friction.velocity_scale, force / breakaway
    yield gt.when(
        gt.initial() & stuck, friction.slides == gt.sign(2.0 * _direction(moves, STANDSTILL) + _direction(pushed, 1.0))
    )


def _direction(x: Any, least: float) -> Any:
    """Return 1 above `least`, -1 below -`least`, 0 in between."""
    return gt.sign(gt.sign(x - least) + gt.sign(x + least))


class Friction(gt.Model):
    """Base class of friction on a flange: `force` [N] has the sign of the velocity der(flange.s) and opposes it.

    Subclasses define law(velocity); without it, ModelError is raised.

    A custom law, fluid drag quadratic in the velocity, on a carriage that coasts at 2 m/s:

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
        """Return the friction force [N] at a velocity [m/s]."""
        raise gt.ModelError("a Friction must define law(velocity); use Frictionless, TanhFriction, ...")


class Frictionless(Friction):
    """No friction; replaces a friction part and accepts its parameters, which have no effect.

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

    coulomb = gt.parameter(0.0, unit="N", min=0.0, description="no effect")
    viscous = gt.parameter(0.0, unit="kg/s", min=0.0, description="no effect")
    velocity_scale = gt.parameter(0.1, unit="m/s", positive=True, description="no effect")

    def law(self, velocity):
        return 0.0


class _CoulombViscous(Friction):
    coulomb = gt.parameter(0.0, unit="N", min=0.0, description="Coulomb friction force")
    viscous = gt.parameter(0.0, unit="kg/s", min=0.0, description="viscous friction coefficient")
    velocity_scale = gt.parameter(
        0.1, unit="m/s", positive=True, description="velocity at which the smoothed sign is close to 1"
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

    Half of the Coulomb friction at half the velocity scale, full friction from the velocity scale on:

    >>> friction = gt.mechanics.PiecewiseLinearFriction(coulomb=100.0, viscous=50.0, velocity_scale=0.1)
    >>> print(friction.law(0.05), friction.law(0.1), friction.law(-0.2))
    52.5 105.0 -110.0
    """


class SignFriction(ExactSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction exactly as in Dressler 2012, eq. (6.8): for identification away from zero velocity.

    An optimisation with this part raises an error, because the force is discontinuous at standstill. A simulation
    switches there and ends if
    the motion would stay at zero velocity; use `StictionFriction` for that.

    The discontinuity at standstill:

    >>> friction = gt.mechanics.SignFriction(coulomb=100.0, viscous=50.0)
    >>> print(friction.law(-0.2), friction.law(0.0), friction.law(0.2))
    -110.0 0.0 110.0
    """


class StictionFriction(StuckOrSliding, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction with sticking, for simulation: stuck, sliding forward or sliding backward.

    In the stuck state it bears up to breakaway_ratio times the Coulomb friction without creeping; in the sliding states
    its force is that of `SignFriction`. `slides` is 1 forward, -1 backward and 0 stuck. Its value at the start follows
    from the velocity, and at rest from the force. It can replace any law with the same parameters; optimisation needs a
    smooth one. Do not use it on a flange with prescribed motion, nor twice on rigidly coupled flanges: the friction
    forces of two stuck parts are not unique.

    The force on a carriage of 2 kg grows by 10 N/s. It breaks away at 1.2 times 5 N, after 0.6 s:

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

    coulomb = gt.parameter(unit="N", positive=True, description="Coulomb friction force while sliding")
    velocity_scale = gt.parameter(
        0.1, unit="m/s", positive=True, description="a start velocity below 1e-8 of it is rest"
    )
    breakaway_ratio = gt.parameter(1.0, unit="1", min=1.0, description="break-away force over Coulomb friction")
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
    """Direction-dependent Coulomb and viscous friction (Dressler 2012, Table 6.1).

    The sign is smoothed by tanh(velocity / velocity_scale).

    Cart 1 of the L1 (Table 6.1) at 0.5 m/s in both directions; all coefficients are positive numbers:

    >>> friction = gt.mechanics.DirectionalTanhFriction(
    ...     coulomb=189.12, viscous=205.03, coulomb_minus=145.69, viscous_minus=158.01, velocity_scale=0.05
    ... )
    >>> print(round(friction.law(0.5), 2), round(friction.law(-0.5), 2))
    291.63 -224.69
    """


class DirectionalPiecewiseLinearFriction(PiecewiseLinearSign, DirectionalLaw, _Directional):
    """Direction-dependent Coulomb and viscous friction (Dressler 2012, Table 6.1), sign smoothed by a straight line.

    Beyond the velocity scale, each direction has exactly its own coefficients:

    >>> friction = gt.mechanics.DirectionalPiecewiseLinearFriction(
    ...     coulomb=100.0, viscous=50.0, coulomb_minus=80.0, viscous_minus=40.0, velocity_scale=0.05
    ... )
    >>> print(friction.law(0.5), friction.law(-0.5))
    125.0 -100.0
    """


class DirectionalSignFriction(ExactSign, DirectionalLaw, _Directional):
    """Direction-dependent Coulomb and viscous friction (Dressler 2012, Table 6.1), with the exact sign.

    For identification away from zero velocity: optimisation refuses it, and a simulation ends if it would stick.

    All coefficients are positive numbers; the force has the sign of the velocity:

    >>> friction = gt.mechanics.DirectionalSignFriction(
    ...     coulomb=100.0, viscous=50.0, coulomb_minus=80.0, viscous_minus=40.0
    ... )
    >>> print(friction.law(0.01), friction.law(-0.01))
    100.5 -80.4
    """


class StribeckFriction(TanhSign, StribeckLaw, _CoulombViscous):
    """Stribeck friction, which falls from `breakaway` to `coulomb` at the onset of motion; sign smoothed by tanh.

    The decay is exp(-(velocity / stribeck_velocity)^2). Choose velocity_scale well below stribeck_velocity, otherwise
    the smoothing removes the peak.

    The force falls from about 150 N at the onset of motion to 100 N:

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
