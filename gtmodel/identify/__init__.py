"""Identification of dynamics from motion: friction from constant velocities, regressors, weighted least squares.

Friction
    identify_friction      coefficients by direction and the mass held, from runs at constant velocity
    steady_runs, joined    the runs of a log, of several logs
    mass_by_norm           the mass by three norms of what is left
    constant_velocity_log  a synthetic log of such runs
Motion
    Regressor              efforts as a linear function of parameters
"""

from .friction import FrictionError, FrictionFit, identify_friction
from .gravity import MassByNorm, mass_by_norm
from .regressor import Regressor, RegressorRows
from .steady import Runs, constant_velocity_log, joined, steady_runs

__all__ = [
    "FrictionError",
    "FrictionFit",
    "MassByNorm",
    "Regressor",
    "RegressorRows",
    "Runs",
    "constant_velocity_log",
    "identify_friction",
    "joined",
    "mass_by_norm",
    "steady_runs",
]
