"""Friction laws, for translation and rotation alike: force or torque over velocity, with a smoothed sign.

Each is a mixin that reads the parameters of the friction model it is mixed into. All are passive: force times
velocity is nowhere negative.
"""

from __future__ import annotations

from typing import Any

from .. import lang as gt


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
