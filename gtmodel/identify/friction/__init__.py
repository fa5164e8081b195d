"""Friction of carts that carry a plate, and the mass that they carry, from runs at constant velocity."""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .constant_velocity import (
        Runs as Runs,
        concatenate as concatenate,
        constant_velocity_log as constant_velocity_log,
        constant_velocity_runs as constant_velocity_runs,
    )
    from .gravity import MassByNorm as MassByNorm, gravity_pattern as gravity_pattern, mass_by_norm as mass_by_norm
    from .levels import FrictionFit as FrictionFit, identify_friction as identify_friction
    from .options import (
        ConstantVelocity as ConstantVelocity,
        FrictionCoefficients as FrictionCoefficients,
        FrictionStudy as FrictionStudy,
        HeldPose as HeldPose,
        SyntheticRuns as SyntheticRuns,
    )
    from .study import (
        PublishedFriction as PublishedFriction,
        friction_study as friction_study,
        published_friction_study as published_friction_study,
    )

public(__name__)
