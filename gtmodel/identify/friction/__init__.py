"""Friction of the actuators and the mass they hold, from runs at constant velocity."""

from .gravity import MassByNorm, mass_by_norm
from .levels import FrictionFit, identify_friction
from .options import Coefficients, HeldPose, Steady, SyntheticRuns
from .pattern import gravity_pattern
from .published import PublishedFriction, published_friction_study
from .steady import Runs, constant_velocity_log, joined, steady_runs
from .study import FrictionStudy, friction_study

__all__ = [
    "Coefficients", "FrictionFit", "FrictionStudy", "HeldPose", "MassByNorm", "PublishedFriction", "Runs", "Steady",
    "SyntheticRuns", "constant_velocity_log", "friction_study", "gravity_pattern", "identify_friction", "joined",
    "mass_by_norm", "published_friction_study", "steady_runs",
]  # fmt: skip
