"""Friction of the actuators and the mass they hold, from runs at constant velocity."""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .constant_velocity import (
        Runs as Runs,
        concatenate as concatenate,
        constant_velocity_log as constant_velocity_log,
        constant_velocity_runs as constant_velocity_runs,
    )
    from .friction_result import FrictionStudy as FrictionStudy
    from .gravity import MassByNorm as MassByNorm, mass_by_norm as mass_by_norm
    from .levels import FrictionFit as FrictionFit, identify_friction as identify_friction
    from .options import (
        ConstantVelocity as ConstantVelocity,
        FrictionCoefficients as FrictionCoefficients,
        HeldPose as HeldPose,
        SyntheticRuns as SyntheticRuns,
    )
    from .pattern import gravity_pattern as gravity_pattern
    from .published import PublishedFriction as PublishedFriction, published_friction_study as published_friction_study
    from .study import friction_study as friction_study

public(__name__)
