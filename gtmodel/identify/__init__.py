"""Identification of dynamics from motion: friction from constant velocities."""

from .friction import FrictionError, FrictionFit, identify_friction
from .gravity import MassByNorm, mass_by_norm
from .steady import Runs, constant_velocity_log, joined, steady_runs

__all__ = [
    "FrictionError",
    "FrictionFit",
    "MassByNorm",
    "Runs",
    "constant_velocity_log",
    "identify_friction",
    "joined",
    "mass_by_norm",
    "steady_runs",
]
