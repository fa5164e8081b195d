"""Identification of dynamics from motion: friction from constant velocities, regressors, weighted least squares.

Friction
    friction_study, FrictionStudy          from logs, runs or made-up ones; options HeldPose, Steady, SyntheticRuns
    published_friction_study               the mass of printed lines; Coefficients, PublishedFriction
    gravity_pattern        forces that hold one kilogram, by pose
    identify_friction      coefficients by direction and the mass held, from runs at constant velocity
    steady_runs, joined    the runs of a log, of several logs
    mass_by_norm           the mass by three norms of what is left
    constant_velocity_log  a synthetic log of such runs
Motion
    study, IdentificationStudy             masses and friction from a recording; options Fitting, Processing, ClosedLoop
    synthetic_study        the same from a log made up, against its truth; SyntheticLog, read_motion
    Regressor              efforts as a linear function of parameters
    Processing, rows_of    logs as filtered rows of a regressor
    corrected              delays, scales and offsets estimated beside the parameters
    identify               weighted least squares: values, intervals, residual tests; bias_of what is left out
    delay_of               whether the efforts come later than the positions, and what that moves
    work_of                whether friction brakes, and whether the energy balances
    exchanged_efforts      whether another order or sign of the efforts' columns fits far better
Excitation
    excitation_study, ExcitationStudy      of a robot; options Family, Experiment, Search, RandomMotions, MonteCarloFits
    optimise_excitation    the motion that tells most of an ExcitationTask within its limits
    FourierSeries, ClosedSpline   families of motions at rest at both ends
    random_excitations     feasible motions to compare with and to start from
    condition, singular_values, predicted_deviations   what a stacked regressor tells
Synthetic
    LogSimulator, Sensors  logs of a motion, by seed; multisine and Tracking make the motion
    repeat_identification  many of them: unbiased, and do intervals hold?
"""

from .corrected import corrected
from .delay import Delay, delay_of
from .exchanged import Exchanged, exchanged_efforts
from .excitation import (
    ClosedSpline,
    Excitation,
    ExcitationStudy,
    ExcitationTask,
    Experiment,
    Family,
    FourierSeries,
    MonteCarloFits,
    RandomMotions,
    Search,
    condition,
    excitation_study,
    optimise_excitation,
    predicted_deviations,
    random_excitations,
    singular_values,
)
from .friction import (
    Coefficients,
    FrictionFit,
    FrictionStudy,
    HeldPose,
    MassByNorm,
    PublishedFriction,
    Runs,
    Steady,
    SyntheticRuns,
    constant_velocity_log,
    friction_study,
    gravity_pattern,
    identify_friction,
    joined,
    mass_by_norm,
    published_friction_study,
    steady_runs,
)
from .identification_study import study, synthetic_study
from .identified import IdentificationStudy
from .inertia import Identification, LeftOut, Validation, bias_of, identify
from .options import ClosedLoop, Fitting, SyntheticLog
from .reference_motion import multisine, read_motion
from .regressor import Regressor, RegressorRows
from .repeated import Repeated, repeat_identification
from .rows import Processing, Rows, rows_of, with_offsets
from .simulated_log import LogSimulator, Sensors
from .tracking import Tracking
from .work import Work, work_of

__all__ = [
    "ClosedLoop",
    "ClosedSpline",
    "Coefficients",
    "Delay",
    "Exchanged",
    "Excitation",
    "ExcitationStudy",
    "ExcitationTask",
    "Experiment",
    "Family",
    "Fitting",
    "FourierSeries",
    "FrictionFit",
    "FrictionStudy",
    "HeldPose",
    "Identification",
    "IdentificationStudy",
    "LeftOut",
    "LogSimulator",
    "MassByNorm",
    "MonteCarloFits",
    "Processing",
    "PublishedFriction",
    "RandomMotions",
    "Regressor",
    "RegressorRows",
    "Repeated",
    "Rows",
    "Runs",
    "Search",
    "Sensors",
    "Steady",
    "SyntheticLog",
    "SyntheticRuns",
    "Tracking",
    "Validation",
    "Work",
    "bias_of",
    "condition",
    "constant_velocity_log",
    "corrected",
    "delay_of",
    "exchanged_efforts",
    "excitation_study",
    "friction_study",
    "gravity_pattern",
    "identify",
    "identify_friction",
    "joined",
    "mass_by_norm",
    "multisine",
    "optimise_excitation",
    "predicted_deviations",
    "published_friction_study",
    "random_excitations",
    "read_motion",
    "repeat_identification",
    "rows_of",
    "singular_values",
    "steady_runs",
    "study",
    "synthetic_study",
    "with_offsets",
    "work_of",
]
