"""Direction-dependent friction on the three-link Gantry-Tau, and Table 6.3 of Dressler 2012 as declared variants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import lang as gt
from ..mechanics import DirectionalSignFriction, DirectionalTanhFriction, SignFriction, TanhFriction
from . import catalogue
from .three_link import Arm, GantryTau

# friction laws of each smoothing: symmetric, direction-dependent
LAWS = {"sign": (SignFriction, DirectionalSignFriction), "tanh": (TanhFriction, DirectionalTanhFriction)}


class GantryTauViscousByDirection(GantryTau):
    """Direction-dependent viscous friction, symmetric Coulomb friction (model 4 of Table 6.3).

    `viscous` applies at positive and `viscous_minus` at negative velocity; both are positive numbers. The friction part
    of the arms must be direction-dependent: arm=dict(friction=DirectionalSignFriction).

    Viscous friction [kg/s] at positive and at negative velocity, one value per cart:

    >>> robot = gt.robots.inertia_variant("model_4").robot
    >>> print(robot.viscous, robot.viscous_minus)
    [205.03 190.   185.94] [158.01 133.76 197.52]
    """

    viscous_minus = gt.parameter([0.0] * 3, unit="kg/s", min=0.0, description="viscous friction at negative velocity")
    arm = gt.parts(
        3,
        Arm,
        A=GantryTau.A,
        v=GantryTau.v,
        m_c=GantryTau.m_c,
        rod=lambda self: [dict(L=self.L[i], m=self.m_a[i]) for i in range(3)],
        friction=lambda self: [self.law(i) for i in range(3)],
    )

    def law(self, i: int) -> dict[str, Any]:
        """Return the friction parameters of arm i."""
        return dict(
            coulomb=self.coulomb[i],
            coulomb_minus=self.coulomb[i],
            viscous=self.viscous[i],
            viscous_minus=self.viscous_minus[i],
            velocity_scale=self.velocity_scale,
        )


class GantryTauByDirection(GantryTauViscousByDirection):
    """Direction-dependent viscous and Coulomb friction (Dressler 2012, Table 6.1); see GantryTauViscousByDirection.

    Friction force of cart 1 of the L1 at 0.3 m/s in both directions:

    >>> robot = gt.robots.inertia_variant("model_3", smoothing="tanh").robot
    >>> friction = robot.causal(known="q", targets="arm[0].friction.force")
    >>> for velocity in (0.3, -0.3):
    ...     force, status = friction(np.zeros(3), [velocity, 0.0, 0.0])
    ...     print(round(force, 2))
    ...
    249.55
    -192.51
    """

    coulomb_minus = gt.parameter(
        [0.0] * 3, unit="N", min=0.0, description="Coulomb friction at negative velocity, positive"
    )

    def law(self, i: int) -> dict[str, Any]:
        return super().law(i) | {"coulomb_minus": self.coulomb_minus[i]}


@dataclass(frozen=True)
class InertiaVariant:
    """A selection of masses and friction parameters to identify.

    robot: the model. free: names of the parameters to identify; all others are fixed. description: the selection in
    words.
    """

    robot: GantryTau
    free: tuple[str, ...]
    description: str


VARIANTS = {
    "model_1": (("m_p", "m_c", "coulomb"), "symmetric Coulomb friction only"),
    "model_2": (("m_p", "m_c", "coulomb", "viscous"), "symmetric Coulomb and viscous friction"),
    "model_3": (("m_p", "m_c"), "friction by direction fixed to Table 6.1"),
    "model_4": (("m_p", "m_c", "coulomb"), "symmetric Coulomb friction, viscous friction fixed to Table 6.1"),
    "links": (("m_p", "m_c", "m_a", "coulomb", "viscous"), "thirteen parameters: model 2 with link masses"),
}


def inertia_variant(name: str, geometry: str = "l1_tape", smoothing: str = "sign", **modifiers: Any) -> InertiaVariant:
    """Return a model of Dressler 2012, Table 6.3, or the variant "links", for a three-link robot.

    Link masses are neglected except in "links". The free parameters (m_p, m_c, friction) take the values of model 2 as
    nominal values. smoothing: "sign", for identification, or "tanh". modifiers: any parameter of GantryTau.

    Raises ModelError for an unknown name or smoothing.

    Model 4 of Table 6.3, with the names of its free parameters:

    >>> variant = gt.robots.inertia_variant("model_4")
    >>> print(variant.free, variant.description)
    ('m_p', 'm_c', 'coulomb') symmetric Coulomb friction, viscous friction fixed to Table 6.1
    """
    if name not in VARIANTS or smoothing not in LAWS:
        known = VARIANTS if name not in VARIANTS else LAWS
        what, word = ("inertia variant", name) if name not in VARIANTS else ("smoothing", smoothing)
        raise gt.ModelError(f"there is no {what} '{word}'; there are {', '.join(known)}")
    free, words = VARIANTS[name]
    symmetric, by_direction = LAWS[smoothing]
    cls, law, friction = GantryTau, symmetric, {}
    table = friction_by_direction()
    if name == "model_1":
        friction = dict(viscous=[0.0] * 3)
    elif name == "model_3":
        cls, law, friction = GantryTauByDirection, by_direction, table
    elif name == "model_4":
        cls, law = GantryTauViscousByDirection, by_direction
        friction = {k: table[k] for k in ("viscous", "viscous_minus")}
    nominal = catalogue.gantry_tau(geometry, inertia="model_2")._modifiers
    return InertiaVariant(cls(**{**nominal, **friction, "arm": dict(friction=law), **modifiers}), free, words)


def friction_by_direction() -> dict[str, np.ndarray]:
    """Return Coulomb [N] and viscous [kg/s] friction of the L1 carts for each direction (Dressler 2012, Table 6.1).

    One value per cart:

    >>> friction = gt.robots.friction_by_direction()
    >>> print(friction["coulomb"], friction["coulomb_minus"])
    [189.12 262.59 239.06] [145.69 119.23 177.22]
    """
    table = catalogue.dynamics_table()["friction_constant_velocity"]
    keys = {"coulomb": "coulomb_plus_N", "coulomb_minus": "coulomb_minus_N"}
    keys |= {"viscous": "viscous_plus_kg_s", "viscous_minus": "viscous_minus_kg_s"}
    return {name: np.array(table[key], dtype=float) for name, key in keys.items()}


def actuator_closed_loop() -> dict[str, Any]:
    """Return the position-controlled L1 carts as first-order lags (Dressler 2012, eq. (6.11)).

    b and a (3,) are the coefficients of each cart's transfer function b z^-delay / (1 - a z^-1) from reference to
    position; delay [samples], sample_time [s].

    A first-order lag per cart, with a delay of five samples of 4 ms:

    >>> loop = gt.robots.actuator_closed_loop()
    >>> print(loop["a"], loop["delay"], loop["sample_time"])
    (0.9647, 0.9656, 0.9728) 5 0.004
    """
    table = catalogue.dynamics_table()["actuator_closed_loop"]
    return dict(
        b=tuple(table["b"]), a=tuple(table["a"]), delay=int(table["delay_samples"]), sample_time=table["sample_time_s"]
    )
