"""Friction laws, for translation and rotation alike: force or torque over velocity, with a smoothed sign.

Each is a mixin that reads the parameters of the friction model it is mixed into. All are passive: force times
velocity is nowhere negative.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from .. import lang as gt

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
