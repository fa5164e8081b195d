"""Friction of the actuators and the mass they hold, from runs at constant velocity."""

from .gravity import MassByNorm as MassByNorm, mass_by_norm as mass_by_norm
from .levels import FrictionFit as FrictionFit, identify_friction as identify_friction
from .options import (
    FrictionCoefficients as FrictionCoefficients,
    HeldPose as HeldPose,
    Steady as Steady,
    SyntheticRuns as SyntheticRuns,
)
from .pattern import gravity_pattern as gravity_pattern
from .published import PublishedFriction as PublishedFriction, published_friction_study as published_friction_study
from .steady import (
    Runs as Runs,
    constant_velocity_log as constant_velocity_log,
    joined as joined,
    steady_runs as steady_runs,
)
from .study import FrictionStudy as FrictionStudy, friction_study as friction_study
