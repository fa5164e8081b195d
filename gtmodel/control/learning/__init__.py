"""Iterative learning control of repeated motions; rate and remaining error are predicted first (Dressler 2012, 7).

study            rate and floor before the first iteration, then the runs -> LearningStudy; options LearningRobot,
                 LearningDesign, LearningNoise; SyntheticExperiment, AxisLearning, design_axis;
                 SimulatedMotion, ElasticTip: a robot with its controller and an elastic tool
next_input       from one measured run to the next input -> NextInputStudy
Lifted           a linear map of whole signals with its adjoint; constructors: lifted, toeplitz, shifted, filtered,
                 zero_phase, symmetric, weighted, matrix, identity
LearningLaw      u(k+1) = Q (u(k) + L e(k)); simple_law: case 1; ramp_weights, input_window: (7.12), (7.14)
largest_gain, spectral_radius, frequency_bound    convergence: (7.16), (7.15), and in the frequency domain
rate, floor, learn    rate of convergence, remaining error, and runs; above_cutoff: share above a frequency
SampledSystem, delayed_lag, ACTUATORS, pulse_response, frequency_response    plants, including (6.11)
AxisPlant        motor, tool and acceleration of an axis; flexible_axis: a synthetic one; tool_model: its tool
ModelledRobot    a robot by plants of its axes; lag_robot: from b and a; linear_axis: from a model;
                 identified_robot, identified_axis, identified_tool, begin (of a pulse response): from a log
SquarePath       the reference of the experiments
kinematic, measured, complementary_estimate, kalman_estimate    estimates of the tool position: cases 1, 3, 2A, 2B
ExtendedKalman, most_likely_filter    the filter of (7.21), and its noise by maximum likelihood of the innovations
mismatch         error of the estimates against the error of the model -> MismatchStudy
robust_filter, rests_of, best_shift    Q for a set of models, and the shift
norm_optimal_law, model_inverse_law, inverse, bounded_update, bounded_limit    norm-optimal laws, with bounds
"""

from typing import TYPE_CHECKING

from ..._lazy import public

if TYPE_CHECKING:
    from .axis import AxisPlant as AxisPlant, flexible_axis as flexible_axis, tool_model as tool_model
    from .course import (
        Course as Course,
        Floor as Floor,
        Rate as Rate,
        RepeatedMotion as RepeatedMotion,
        SyntheticExperiment as SyntheticExperiment,
        above_cutoff as above_cutoff,
        floor as floor,
        learn as learn,
        rate as rate,
    )
    from .design import (
        AxisLearning as AxisLearning,
        RobustFilter as RobustFilter,
        best_shift as best_shift,
        design_axis as design_axis,
        rests_of as rests_of,
        robust_filter as robust_filter,
    )
    from .estimators import (
        ToolEstimate as ToolEstimate,
        complementary_estimate as complementary_estimate,
        kalman_estimate as kalman_estimate,
        kinematic as kinematic,
        measured as measured,
    )
    from .identified import begin as begin, identified_axis as identified_axis, identified_tool as identified_tool
    from .kalman import ExtendedKalman as ExtendedKalman, most_likely_filter as most_likely_filter
    from .law import (
        LearningLaw as LearningLaw,
        Peak as Peak,
        frequencies as frequencies,
        frequency_bound as frequency_bound,
        input_window as input_window,
        largest_gain as largest_gain,
        ramp_weights as ramp_weights,
        simple_law as simple_law,
        spectral_radius as spectral_radius,
    )
    from .lifted import (
        Lifted as Lifted,
        filtered as filtered,
        identity as identity,
        lifted as lifted,
        matrix as matrix,
        shifted as shifted,
        symmetric as symmetric,
        toeplitz as toeplitz,
        weighted as weighted,
        zero_phase as zero_phase,
    )
    from .next_run import next_input as next_input
    from .norm_optimal import (
        bounded_limit as bounded_limit,
        bounded_update as bounded_update,
        inverse as inverse,
        model_inverse_law as model_inverse_law,
        norm_optimal_law as norm_optimal_law,
    )
    from .options import (
        ElasticTip as ElasticTip,
        LearningDesign as LearningDesign,
        LearningNoise as LearningNoise,
        LearningRobot as LearningRobot,
        LearningStudy as LearningStudy,
        NextInputStudy as NextInputStudy,
    )
    from .plants import (
        ACTUATOR_DELAY as ACTUATOR_DELAY,
        ACTUATORS as ACTUATORS,
        SampledSystem as SampledSystem,
        delayed_lag as delayed_lag,
        frequency_response as frequency_response,
        pulse_response as pulse_response,
        stable as stable,
    )
    from .references import SquarePath as SquarePath
    from .robot import (
        ModelledRobot as ModelledRobot,
        identified_robot as identified_robot,
        lag_robot as lag_robot,
        linear_axis as linear_axis,
    )
    from .simulated import SimulatedMotion as SimulatedMotion
    from .study import MismatchStudy as MismatchStudy, mismatch as mismatch, study as study

public(__name__)
