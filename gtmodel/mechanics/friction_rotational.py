"""Friction on a shaft: the laws of friction.py with torques and angular velocities."""

from __future__ import annotations

from typing import Any

from .. import lang as gt
from .frames import Shaft
from .friction import (
    CoulombViscousLaw,
    DirectionalLaw,
    ExactSign,
    PiecewiseLinearSign,
    StribeckLaw,
    StuckOrSliding,
    TanhSign,
    stiction,
)


class RotationalFriction(gt.Model):
    """Base class of friction on a shaft: `torque` [N.m] has the sign of the velocity der(shaft.phi) and opposes it.

    Subclasses define law(velocity); without it, ModelError is raised.

    A custom law for a brake in oil:

    >>> class Brake(gt.mechanics.RotationalFriction):
    ...     def law(self, velocity):
    ...         return 5.0 * gt.tanh(velocity / 0.1) + 0.2 * velocity
    ...
    >>> print(round(Brake().law(10.0), 6))  # N.m at 10 rad/s
    7.0
    """

    shaft = gt.port(Shaft)
    torque = gt.variable(unit="N.m", nominal=10.0, description="friction torque against the motion")

    def equations(self):
        yield self.shaft.t == self.torque
        yield self.torque == self.law(gt.der(self.shaft.phi))
        yield gt.energy(dissipated=self.torque * gt.der(self.shaft.phi))

    def law(self, velocity) -> Any:
        """Return the friction torque [N.m] at an angular velocity [rad/s]."""
        raise gt.ModelError("a RotationalFriction must define law(velocity); use RotationalTanhFriction, ...")


class _CoulombViscous(RotationalFriction):
    coulomb = gt.parameter(0.0, unit="N.m", min=0.0, description="Coulomb friction torque")
    viscous = gt.parameter(0.0, unit="N.m.s/rad", min=0.0, description="viscous friction coefficient")
    velocity_scale = gt.parameter(
        0.1, unit="rad/s", positive=True, description="velocity at which the smoothed sign is close to 1"
    )


class RotationalTanhFriction(TanhSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction, sign smoothed by tanh(velocity / velocity_scale).

    A rotor of 0.5 kg m2 coasting at 10 rad/s is decelerated by 5 N.m:

    >>> bench = gt.Builder("bench")
    >>> rotor = bench.part("rotor", gt.mechanics.Inertia(J=0.5))
    >>> bearing = bench.part("bearing", gt.mechanics.RotationalTanhFriction(coulomb=3.0, viscous=0.2))
    >>> bench.add(gt.connect(rotor.shaft, bearing.shaft))
    >>> coast = bench.causal(targets=["bearing.torque", "der(rotor.shaft.phi,2)"], prefer="rotor.shaft.phi")
    >>> torque, acceleration, status = coast(10.0)
    >>> print(round(torque, 6), round(acceleration, 6))
    5.0 -10.0
    """


class RotationalPiecewiseLinearFriction(PiecewiseLinearSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction, sign smoothed by a straight line between -velocity_scale and velocity_scale.

    Half of the Coulomb torque at half the velocity scale, full torque from the velocity scale on:

    >>> friction = gt.mechanics.RotationalPiecewiseLinearFriction(coulomb=3.0, viscous=0.2, velocity_scale=0.1)
    >>> print(friction.law(0.05), friction.law(10.0), friction.law(-10.0))
    1.51 5.0 -5.0
    """


class RotationalSignFriction(ExactSign, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction with the exact sign, 0 at standstill: for identification.

    A simulation ends if the motion would stay at standstill; use `RotationalStictionFriction` for that.

    >>> bench = gt.Builder("bench")
    >>> motor = bench.part("motor", gt.mechanics.TorqueMotor())
    >>> bearing = bench.part("bearing", gt.mechanics.RotationalSignFriction(coulomb=3.0, viscous=0.2))
    >>> bench.add(gt.connect(motor.shaft, bearing.shaft))
    >>> torque, status = bench.causal(known="motor.shaft.phi", targets="bearing.torque")(0.0, -10.0)
    >>> print(round(torque, 6))
    -5.0
    """


class RotationalStictionFriction(StuckOrSliding, CoulombViscousLaw, _CoulombViscous):
    """Coulomb and viscous friction with sticking: `StictionFriction` on a shaft.

    A rotor of 0.5 kg m2 coasts from 12 rad/s under 3 N.m. It stops after 2 s and sticks:

    >>> bench = gt.Builder("bench")
    >>> rotor = bench.part("rotor", gt.mechanics.Inertia(J=0.5))
    >>> bearing = bench.part("bearing", gt.mechanics.RotationalStictionFriction(coulomb=3.0))
    >>> bench.add(gt.connect(rotor.shaft, bearing.shaft))
    >>> start = {"rotor.shaft.phi": 0.0, "der(rotor.shaft.phi)": 12.0}
    >>> run = bench.simulate(3.0, start=start, outputs="rotor.shaft.phi")
    >>> [round(e.time, 9) for e in run.events], float(run.trajectory["rotor.shaft.phi"][-1].round(9))
    ([0.0, 2.0], 12.0)
    """

    coulomb = gt.parameter(unit="N.m", positive=True, description="Coulomb friction torque while sliding")
    velocity_scale = gt.parameter(
        0.1, unit="rad/s", positive=True, description="a start velocity below 1e-8 of it is rest"
    )
    breakaway_ratio = gt.parameter(1.0, unit="1", min=1.0, description="break-away torque over Coulomb friction")
    slides = gt.discrete(0.0, description="1 forward, -1 backward, 0 stuck")

    def equations(self):
        yield self.shaft.t == self.torque
        yield from stiction(self, self.shaft.phi, self.torque)
        yield gt.energy(dissipated=self.torque * gt.der(self.shaft.phi))


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
    """Direction-dependent Coulomb and viscous friction, sign smoothed by tanh(velocity / velocity_scale).

    At 10 rad/s in both directions; all coefficients are positive numbers:

    >>> friction = gt.mechanics.RotationalDirectionalTanhFriction(
    ...     coulomb=3.0, viscous=0.2, coulomb_minus=2.0, viscous_minus=0.1
    ... )
    >>> print(round(friction.law(10.0), 6), round(friction.law(-10.0), 6))
    5.0 -3.0
    """


class RotationalDirectionalPiecewiseLinearFriction(PiecewiseLinearSign, DirectionalLaw, _Directional):
    """Direction-dependent Coulomb and viscous friction, sign smoothed by a straight line.

    At 10 rad/s in both directions:

    >>> friction = gt.mechanics.RotationalDirectionalPiecewiseLinearFriction(
    ...     coulomb=3.0, viscous=0.2, coulomb_minus=2.0, viscous_minus=0.1
    ... )
    >>> print(friction.law(10.0), friction.law(-10.0))
    5.0 -3.0
    """


class RotationalStribeckFriction(TanhSign, StribeckLaw, _CoulombViscous):
    """Stribeck friction, which falls from `breakaway` to `coulomb` at the onset of motion; sign smoothed by tanh.

    The decay is exp(-(velocity / stribeck_velocity)^2). Choose velocity_scale well below stribeck_velocity, otherwise
    the smoothing removes the peak.

    The torque falls from about 5 N.m at the onset of motion to 3 N.m:

    >>> friction = gt.mechanics.RotationalStribeckFriction(
    ...     coulomb=3.0, breakaway=5.0, stribeck_velocity=0.5, velocity_scale=0.02
    ... )
    >>> print(*[round(friction.law(w), 2) for w in (0.05, 0.5, 2.0)])
    4.91 3.74 3.0
    """

    breakaway = gt.parameter(
        unit="N.m",
        min=_CoulombViscous.coulomb,
        description="friction torque at the onset of motion, at least `coulomb`",
    )
    stribeck_velocity = gt.parameter(unit="rad/s", positive=True, description="velocity over which friction falls")
