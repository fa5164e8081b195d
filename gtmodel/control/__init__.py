"""Control laws based on a model's inverse dynamics, and models of the closed loops.

Feedforward      inverse dynamics along the reference plus PD feedback
ComputedTorque   inverse dynamics at the measured state for a commanded acceleration
Feedback         PD feedback alone
tracking_loop    a plant under a continuous-time law, as a model to simulate
sampled_loop     a plant under a sampled law with a delay, like a digital controller
sampled_law      a law as a sampled block for your own loops; law_function and law_causal: as a function,
                 law_causal for gt.cgen
linearize_sampled    a sampled loop as a discrete-time linear system about a point at rest: poles, margins
track            simulate either loop and return the tracking error
loop_simulation  study of a robot under a sampled law; Move, LoopSampling, TrackingLimits -> LoopSimulationStudy
zero_vibration, zero_vibration_derivative, Shaper   input shaping, so that a flexible mode ends at rest
residual_vibration    vibration amplitude of a mass on a spring after a motion
delayed_feedback   gain limits of delayed corrections from an external sensor: `DelayedFeedbackStudy`; its
                 options, limits, margins and plants are in `gtmodel.control.delayed`
learning         iterative learning control: laws, convergence, remaining error
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
