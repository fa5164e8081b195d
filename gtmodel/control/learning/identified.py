"""The tool's model from a log: motors and measured tool, by a subspace method."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..._lazy import hint
from .plants import SAMPLE_TIME

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")


def identified_tool(motor: Any, tool: Any, sample_time: float = SAMPLE_TIME, order: int | None = None) -> StateSpace:
    """The model from the motor side to the tool that `ExtendedKalman` takes, identified from one log.

    Args:
        motor, tool: (N,) [m], under an input that excites both, such as a random one. order: of the model; chosen by
            the error on held-out samples if left out.

    The input is the mean of this sample and the next one: held alone the motor side would be half a sample late, which
    is more than the tool's own error. Raises ArgumentError as `gtmodel.vibration.identify_subspace`.

    >>> learning = gt.control.learning
    >>> r = 1e-3 * np.repeat(np.random.default_rng(1).normal(size=200), 10)
    >>> log = {name: T(r) for name, T in learning.flexible_axis(11.5, 0.05).maps(2000).items()}
    >>> model = learning.identified_tool(log["motor"], log["tool"], order=3)
    >>> model.ninputs, model.nstates
    (2, 3)
    """
    import control

    from ...vibration import Record, identify_subspace

    at, z = np.asarray(motor, float), np.asarray(tool, float)
    made = identify_subspace(Record((at[:-1] + at[1:]) / 2, z[:-1], sample_time), order=order).system
    half = np.asarray(made.B, float) / 2
    return control.StateSpace(made.A, np.hstack([half, half]), made.C, np.zeros((1, 2)), sample_time)
