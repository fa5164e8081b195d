"""Identification of dynamics from motion: friction from constant velocities, regressors, weighted least squares.

Friction
    friction_study, FrictionStudy          from logs, measured runs or synthetic runs; options HeldPose,
                                           ConstantVelocity, SyntheticRuns
    published_friction_study               the mass from printed friction lines; FrictionCoefficients, PublishedFriction
    gravity_pattern        efforts that hold one kilogram, by pose
    identify_friction      coefficients by direction and the payload, from runs at constant velocity
    constant_velocity_runs, concatenate   the runs of one log, of several logs
    mass_by_norm           the payload that minimises three norms of the residuals
    constant_velocity_log  a synthetic log of such runs
Motion
    study, IdentificationStudy             masses and friction from a recording; options Fitting, Processing, ClosedLoop
    synthetic_study        the same from a synthetic log, compared with the truth; SyntheticLog, read_motion
    Regressor              efforts as a linear function of parameters
    Processing, rows_of    logs as filtered rows of a regressor
    corrected              delays, scales and offsets, estimated together with the parameters
    identify               weighted least squares: values, intervals, residual tests; bias_of omitted parameters
    delay_of               delay between efforts and positions, and its effect on the parameters
    work_of                work of friction and energy balance
    exchanged_efforts      whether another order or sign of the effort columns fits far better
Excitation
    excitation_study, ExcitationStudy      of a robot; options Family, IdentificationExperiment, ExcitationSearch,
                                           RandomMotions, MonteCarloFits
    optimise_excitation    the most informative motion within the limits of an ExcitationTask
    FourierSeries, ClosedSpline   families of motions at rest at both ends
    random_excitations     random feasible motions: start points and a baseline
    condition, singular_values, predicted_deviations   what a stacked regressor determines, and how well
Synthetic
    LogSimulator, Sensors  logs of a motion, by seed; multisine and Tracking make the motion
    leave_out_in_turn      cross-validation: each block of rows predicted by a fit without it; LeftOutInTurn
    repeat_identification  Monte Carlo: bias of the estimates and coverage of the intervals
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .alignment import corrected as corrected
    from .base_parameters import BaseRegressor as BaseRegressor
    from .bodies import (
        ConsistentInertias as ConsistentInertias,
        consistent_inertias as consistent_inertias,
        pseudo_inertia as pseudo_inertia,
    )
    from .checks import (
        Exchanged as Exchanged,
        MechanicalWork as MechanicalWork,
        exchanged_efforts as exchanged_efforts,
        work_of as work_of,
    )
    from .delay import Delay as Delay, delay_of as delay_of
    from .excitation import (
        ClosedSpline as ClosedSpline,
        Excitation as Excitation,
        ExcitationSearch as ExcitationSearch,
        ExcitationStudy as ExcitationStudy,
        ExcitationTask as ExcitationTask,
        Family as Family,
        FourierSeries as FourierSeries,
        IdentificationExperiment as IdentificationExperiment,
        MonteCarloFits as MonteCarloFits,
        RandomMotions as RandomMotions,
        condition as condition,
        excitation_study as excitation_study,
        optimise_excitation as optimise_excitation,
        predicted_deviations as predicted_deviations,
        random_excitations as random_excitations,
        singular_values as singular_values,
    )
    from .friction import (
        ConstantVelocity as ConstantVelocity,
        FrictionCoefficients as FrictionCoefficients,
        FrictionFit as FrictionFit,
        FrictionStudy as FrictionStudy,
        HeldPose as HeldPose,
        MassByNorm as MassByNorm,
        PublishedFriction as PublishedFriction,
        Runs as Runs,
        SyntheticRuns as SyntheticRuns,
        concatenate as concatenate,
        constant_velocity_log as constant_velocity_log,
        constant_velocity_runs as constant_velocity_runs,
        friction_study as friction_study,
        gravity_pattern as gravity_pattern,
        identify_friction as identify_friction,
        mass_by_norm as mass_by_norm,
        published_friction_study as published_friction_study,
    )
    from .identification_result import IdentificationStudy as IdentificationStudy
    from .identification_study import study as study, synthetic_study as synthetic_study
    from .inertia import (
        Identification as Identification,
        LeftOut as LeftOut,
        Validation as Validation,
        bias_of as bias_of,
        identify as identify,
    )
    from .options import (
        ClosedLoop as ClosedLoop,
        Fitting as Fitting,
        Processing as Processing,
        SyntheticLog as SyntheticLog,
    )
    from .regressor import Regressor as Regressor, RegressorRows as RegressorRows
    from .repeated_fits import (
        LeftOutInTurn as LeftOutInTurn,
        Repeated as Repeated,
        leave_out_in_turn as leave_out_in_turn,
        repeat_identification as repeat_identification,
    )
    from .rows import Rows as Rows, rows_of as rows_of, with_offsets as with_offsets
    from .simulated_log import (
        LogSimulator as LogSimulator,
        Sensors as Sensors,
        Tracking as Tracking,
        multisine as multisine,
        read_motion as read_motion,
    )

public(__name__)
