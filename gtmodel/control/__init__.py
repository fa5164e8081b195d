"""Control laws on a model's inverse dynamics, and models of the loops that they close.

Feedforward      forces that a model needs for a reference, with a PD feedback beside them
ComputedTorque   inverse dynamics at the measured state for a commanded acceleration
Feedback         the PD feedback alone
tracking_loop    a plant under one of them, as a model to simulate
track            such a simulation, with its tracking error
"""

from .feedforward import ComputedTorque, Feedback, Feedforward, Law
from .tracking_loop import Tracked, track, tracking_loop

__all__ = ["ComputedTorque", "Feedback", "Feedforward", "Law", "Tracked", "track", "tracking_loop"]
