"""Robots written in the language, and the catalogue of printed parameter sets."""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .by_direction import (
        GantryTauByDirection as GantryTauByDirection,
        GantryTauViscousByDirection as GantryTauViscousByDirection,
        InertiaVariant as InertiaVariant,
        actuator_closed_loop as actuator_closed_loop,
        friction_by_direction as friction_by_direction,
        inertia_variant as inertia_variant,
    )
    from .catalogue import gantry_tau as gantry_tau, inertia_names as inertia_names, make as make
    from .configuration_state import configuration as configuration
    from .entries import entries as entries, names as names
    from .f1 import (
        F1 as F1,
        F1BallScrews as F1BallScrews,
        f1_ball_screws as f1_ball_screws,
        f1_five_dof as f1_five_dof,
        f1_gantry_tau as f1_gantry_tau,
        f1_rotation as f1_rotation,
    )
    from .f1_geometry import F1FiveDof as F1FiveDof, F1Rotation as F1Rotation
    from .from_file import mechanism as mechanism
    from .inverse_model import InverseModel as InverseModel
    from .kuka import (
        SphericalWristArm as SphericalWristArm,
        kr500 as kr500,
        kr500_limits as kr500_limits,
        kr500_tables as kr500_tables,
    )
    from .mechanisms import JointedMechanism as JointedMechanism
    from .serial.arm import SerialArm as SerialArm, description as description
    from .serial.dh import as_dh as as_dh, independent_geometry as independent_geometry, serial_arm as serial_arm
    from .serial.from_mjcf import from_mjcf as from_mjcf
    from .serial.from_sdf import from_sdf as from_sdf
    from .serial.from_urdf import from_urdf as from_urdf
    from .serial.to_urdf import robot_table as robot_table, to_urdf as to_urdf
    from .six_link import (
        ExtraCarts as ExtraCarts,
        SixLink as SixLink,
        extra_carts as extra_carts,
        on_guideways as on_guideways,
        queensland_gantry_tau as queensland_gantry_tau,
        six_link_gantry_tau as six_link_gantry_tau,
    )
    from .three_link import GantryTau as GantryTau
    from .with_wrist import GantryTauWrist as GantryTauWrist, gantry_tau_wrist as gantry_tau_wrist

public(__name__)
