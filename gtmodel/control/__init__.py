"""Control laws on a model's inverse dynamics, and models of the loops that they close.

Feedforward      forces that a model needs for a reference, with a PD feedback beside them
ComputedTorque   inverse dynamics at the measured state for a commanded acceleration
Feedback         the PD feedback alone
tracking_loop    a plant under one of them, as a model to simulate
track            such a simulation, with its tracking error
zero_vibration, zero_vibration_derivative, Shaper   motions shaped so that a flexible mode ends at rest
residual_vibration    how far a mass on a spring swings after a motion
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
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
    from .tracking_loop import Tracked as Tracked, track as track, tracking_loop as tracking_loop

public(__name__)
