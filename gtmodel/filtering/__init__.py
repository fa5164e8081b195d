"""State estimation with any compiled model: Kalman and particle filters, smoothing, and tests of their consistency.

ProcessModel, DiscreteProcess    a model with noise as inputs; a process given as its step in discrete time
LinearProcess    matrices A, C, Q, or a `control.StateSpace`
Sensor           measured quantity with its noise, period, delay, scale, offset, gate
System           process and sensors, compiled: transitions, measurement functions, Jacobians
Manifold, StatePart   vectors, unit quaternions, directions: plus and minus
make             a filter by its name: "kf", "ekf", "iekf", "ukf", "imm", "particle", "steady", "additive"
ErrorState, kalman    error-state Kalman filter, extended and iterated; the Kalman filter of a linear system
Unscented, Interacting, ParticleFilter, SteadyState    sigma points, several models, particles, constant gain
complementary    low frequencies from one signal, high ones from an accelerometer, without a noise model
AdditiveQuaternion    a quaternion as four plain numbers, for comparison
TranslatingBody, TurningBody    bodies with an inertial unit, driven by white jerk
TrackedPath, BodyMotion    paths at constant speed in closed form
synthetic_readings, draw, Drawn    synthetic readings of a known motion, or of motions drawn from the process
consistency, Consistency, chi_squared_band    innovations against exact bands, with a verdict in words
judged, JudgedErrors    errors of many runs against the filter's own covariance
find_faults, FaultSearch    the offset, scale, delay, parameter or noise that explains a log best
tune, Tuned      maximum-likelihood noise densities and standard deviations
estimate_noise, NoiseEstimate, RestingLog    noise and initial state from a log: from its rest, and by likelihood
filter_study     any filter over a log or synthetic readings: estimates, pictures and a verdict; takes
                 MeasuredQuantity, FilterStart, DrawnReadings
fusion_study     accuracy that an inertial unit adds to a laser tracker along a known path
InitialState, Readings, Filtered    initial estimate, readings of one sensor, filtered log
Buffer           a filter on a live stream with late readings, in any order
smooth, fixed_lag    estimates that use later readings too
ScheduledNoise, likely_modes    noise that changes with time, to smooth a run of interacting models
allan_fit, from_rest    noise of a sensor, attitude and biases from a log at rest
ControllerFilter    the filter as a step function, for C code in a control loop
MovingHorizon    least squares over a window, with bounds on states and noise
attitude_study   a gyro calibrated against reference orientations, and the attitude between them, from a recording;
                 takes AttitudeRecording, AttitudeJudging, SyntheticAttitude
calibrate_gyro, sampled_instants, attitude_filter, GyroCarriedBody    parts of attitude_study
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .allan import AllanFit as AllanFit, allan_deviation as allan_deviation, allan_fit as allan_fit
    from .at_rest import AtRest as AtRest, from_rest as from_rest
    from .attitude.attitude_study import attitude_study as attitude_study
    from .attitude.between_references import GyroCarriedBody as GyroCarriedBody, attitude_filter as attitude_filter
    from .attitude.gyro_calibration import GyroCalibration as GyroCalibration, calibrate_gyro as calibrate_gyro
    from .attitude.gyro_path import RateCorrection as RateCorrection, ReferenceNoise as ReferenceNoise
    from .attitude.options import (
        AttitudeJudging as AttitudeJudging,
        AttitudeStudy as AttitudeStudy,
        SyntheticAttitude as SyntheticAttitude,
    )
    from .attitude.recording import (
        AttitudeRecording as AttitudeRecording,
        sampled_instants as sampled_instants,
        synthetic_attitude as synthetic_attitude,
    )
    from .belief import Belief as Belief, InitialState as InitialState, Innovation as Innovation, Readings as Readings
    from .buffer import Buffer as Buffer
    from .consistency import (
        Consistency as Consistency,
        JudgedErrors as JudgedErrors,
        chi_squared_band as chi_squared_band,
        consistency as consistency,
        judged as judged,
    )
    from .controller.controller_filter import ControllerFilter as ControllerFilter
    from .discrete_process import DiscreteProcess as DiscreteProcess, LinearProcess as LinearProcess
    from .error_state import ErrorState as ErrorState, Filter as Filter, kalman as kalman
    from .family.by_name import make as make
    from .family.complementary import complementary as complementary
    from .family.interacting import Interacting as Interacting
    from .family.kalman import (
        AdditiveQuaternion as AdditiveQuaternion,
        SteadyState as SteadyState,
        Unscented as Unscented,
    )
    from .family.particle import ParticleFilter as ParticleFilter
    from .faults import FaultSearch as FaultSearch, Suspect as Suspect, find_faults as find_faults
    from .filter_study import filter_study as filter_study
    from .filtered import Filtered as Filtered
    from .fusion.options import (
        FusionFilter as FusionFilter,
        FusionSensors as FusionSensors,
        FusionStudy as FusionStudy,
        FusionSweep as FusionSweep,
    )
    from .fusion.scene import TranslatingBody as TranslatingBody, TurningBody as TurningBody
    from .fusion.study import fusion_study as fusion_study
    from .manifold import Manifold as Manifold, StatePart as StatePart
    from .moving_horizon import HorizonEstimate as HorizonEstimate, MovingHorizon as MovingHorizon
    from .noise_estimate import NoiseEstimate as NoiseEstimate, estimate_noise as estimate_noise
    from .options import (
        DrawnReadings as DrawnReadings,
        FilterStart as FilterStart,
        FilterStudy as FilterStudy,
        MeasuredQuantity as MeasuredQuantity,
    )
    from .paths import BodyMotion as BodyMotion, TrackedPath as TrackedPath
    from .process import ProcessModel as ProcessModel
    from .resting import RestingLog as RestingLog
    from .sensors import Sensor as Sensor
    from .smoother import Smoothed as Smoothed, fixed_lag as fixed_lag, smooth as smooth
    from .synthetic import Drawn as Drawn, draw as draw, synthetic_readings as synthetic_readings
    from .system import System as System
    from .tuning import ScheduledNoise as ScheduledNoise, Tuned as Tuned, likely_modes as likely_modes, tune as tune

public(__name__)
