"""Robots written in the language, and the catalogue of printed parameter sets."""

from .by_direction import (
    GantryTauByDirection,
    GantryTauViscousByDirection,
    InertiaVariant,
    actuator_closed_loop,
    friction_by_direction,
    inertia_variant,
)
from .catalogue import entries, gantry_tau, inertia_names, make, names
from .configuration_state import configuration
from .f1 import F1, f1_five_dof, f1_gantry_tau, f1_rotation
from .f1_closed_form import F1FiveDof, F1Rotation
from .f1_screws import F1BallScrews
from .five_carts import ExtraCarts, extra_carts
from .kr500 import SphericalWristArm, kr500, kr500_limits, kr500_tables
from .six_link import SixLink, on_guideways, six_link_gantry_tau
from .three_link import GantryTau
from .triangular_link import queensland_gantry_tau
from .with_wrist import GantryTauWrist, gantry_tau_wrist

__all__ = [
    "F1",
    "ExtraCarts",
    "F1BallScrews",
    "F1FiveDof",
    "F1Rotation",
    "GantryTau",
    "GantryTauByDirection",
    "GantryTauViscousByDirection",
    "GantryTauWrist",
    "InertiaVariant",
    "SixLink",
    "SphericalWristArm",
    "actuator_closed_loop",
    "configuration",
    "entries",
    "extra_carts",
    "f1_five_dof",
    "f1_gantry_tau",
    "f1_rotation",
    "friction_by_direction",
    "gantry_tau",
    "gantry_tau_wrist",
    "inertia_names",
    "inertia_variant",
    "kr500",
    "kr500_limits",
    "kr500_tables",
    "make",
    "names",
    "on_guideways",
    "queensland_gantry_tau",
    "six_link_gantry_tau",
]
