"""Control laws on a model's inverse dynamics, and models of the loops that they close.

Feedforward      forces that a model needs for a reference, with a PD feedback beside them
ComputedTorque   inverse dynamics at the measured state for a commanded acceleration
Feedback         the PD feedback alone
tracking_loop    a plant under one of them, as a model to simulate
sampled_loop     a plant under one of them at samples, with a delay, as a digital controller has it
sampled_law      such a law as a block, for loops of your own; law_function, law_causal: as a function,
                 the second one for gt.cgen
linearize_sampled    the same as a linear system in discrete time, from a point at rest: poles, margins
track            a simulation of either, with its tracking error
loop_simulation  a robot under a law at samples as a study; Move, LoopSampling, TrackingLimits -> LoopSimulationStudy
zero_vibration, zero_vibration_derivative, Shaper   motions shaped so that a flexible mode ends at rest
residual_vibration    how far a mass on a spring swings after a motion
delayed_feedback   how far late corrections from an external sensor may be turned up: `DelayedFeedbackStudy`; its
                 options, limits, margins and plants stand in `gtmodel.control.delayed`
learning         iterative learning control: laws, their convergence, what they leave
lead_through     guiding by hand with force sensors at handle and tool
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from . import delayed as delayed, lead_through as lead_through, learning as learning
    from .delayed import DelayedFeedbackStudy as DelayedFeedbackStudy, delayed_feedback as delayed_feedback
    from .feedforward import (
        ComputedTorque as ComputedTorque,
        Feedback as Feedback,
        Feedforward as Feedforward,
        Law as Law,
    )
    from .input_shaping import (
        Shaper as Shaper,
        residual_vibration as residual_vibration,
        zero_vibration as zero_vibration,
        zero_vibration_derivative as zero_vibration_derivative,
    )
    from .loop_options import (
        LoopSampling as LoopSampling,
        LoopSimulationStudy as LoopSimulationStudy,
        Move as Move,
        TrackingLimits as TrackingLimits,
    )
    from .loop_study import Tracked as Tracked, loop_simulation as loop_simulation, track as track
    from .sampled_loop import (
        law_causal as law_causal,
        law_function as law_function,
        sampled_law as sampled_law,
        sampled_loop as sampled_loop,
        tracking_loop as tracking_loop,
    )
    from .sampled_poles import linearize_sampled as linearize_sampled

public(__name__)
