"""One axis of a robot with a flexible tool: from its reference to motor, tool and acceleration (Dressler 2012, 7.1)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..._pickling import Portable
from ...linear.state_space import held, ramped
from ...results import ArgumentError
from .lifted import Lifted, lifted
from .plants import SAMPLE_TIME, Plant, SampledSystem, frequency_response

Signal = Literal["motor", "tool", "acceleration"]


@dataclass(frozen=True, eq=False)
class AxisPlant(Portable):
    """Plants from the reference of an axis, including the learned input, to its measured signals, from rest.

    signals: a plant for each of "motor" (z_c, the tool by forward kinematics [m]), "tool" (z [m]) and "acceleration"
    (of the tool [m/s2]); signals that are not measured may be missing. sample_time: [s].

    >>> axis = gt.control.learning.flexible_axis(frequency=11.5, damping=0.05)
    >>> sorted(axis.signals)
    ['acceleration', 'motor', 'tool']
    """

    signals: Mapping[str, Plant]
    sample_time: float = SAMPLE_TIME

    def maps(self, size: int) -> dict[str, Lifted]:
        """Return each signal's map of runs of `size` samples."""
        return {name: lifted(plant, size) for name, plant in self.signals.items()}

    def responses(self, frequency: np.ndarray, names: Iterable[str] | None = None) -> dict[str, np.ndarray]:
        """Return the response (k,) of each signal, or of these, at frequencies (k,) in Hz."""
        return {n: frequency_response(self.signals[n], frequency) for n in (self.signals if names is None else names)}


def flexible_axis(
    frequency: float, damping: float, *, lag: float = 0.02, delay: int = 5, sample_time: float = SAMPLE_TIME
) -> AxisPlant:
    """Return an axis with a motor loop (delay and first-order lag) that carries a tool on a spring and damper.

    z'' = w2 (z_c - z) + 2 zeta w (z_c' - z') with the motor side z_c; the tool does not react on the motor side. The
    model is our own; those of the thesis are not published.

    Args:
        frequency, damping: of the tool [Hz] and [1]. lag: of the loop [s]. delay: of the loop, in samples.

    Raises ArgumentError for numbers out of range.

    >>> learning = gt.control.learning
    >>> axis = learning.flexible_axis(11.5, 0.05)
    >>> bool(abs(learning.pulse_response(axis.signals["tool"], 800).sum() - 1) < 1e-3)  # unit static gain
    True
    """
    for name, value in (("frequency", frequency), ("damping", damping), ("lag", lag), ("sample_time", sample_time)):
        if not value > 0:
            raise ArgumentError(f"expected a number above 0; found {value:g}", name)
    if delay < 0:
        raise ArgumentError(f"must not be negative; found {delay} samples", "delay")
    w = 2 * np.pi * frequency
    A = np.array([[-1 / lag, 0, 0], [0, 0, 1], [w**2 - 2 * damping * w / lag, -(w**2), -2 * damping * w]])
    B = np.array([[1 / lag], [0], [2 * damping * w / lag]])
    C, D, signals = np.vstack([np.eye(3)[:2], A[2]]), np.array([[0], [0], [B[2, 0]]]), {}
    a, b = held(A, B, sample_time)
    for row, name in enumerate(("motor", "tool", "acceleration")):
        signals[name] = delayed(SampledSystem(a, b, C[row : row + 1], D[row : row + 1], sample_time), delay)
    return AxisPlant(signals, sample_time)


def delayed(plant: SampledSystem, delay: int) -> SampledSystem:
    """Return a plant of one input with its input delayed by `delay` samples."""
    if not delay:
        return plant
    A, B, C, D = (np.asarray(m, float) for m in (plant.A, plant.B, plant.C, plant.D))
    n, p = len(A), len(C)
    big = np.zeros((n + delay, n + delay))
    big[:n, :n] = A
    big[:n, n : n + 1] = B
    big[n:-1, n + 1 :] = np.eye(delay - 1)
    first = np.zeros((n + delay, 1))
    first[-1] = 1.0
    return SampledSystem(big, first, np.hstack([C, D, np.zeros((p, delay - 1))]), np.zeros((p, 1)), plant.dt)


def tool_model(frequency: float, damping: float, sample_time: float = SAMPLE_TIME) -> SampledSystem:
    """Return the model from the motor side at this and the next sample, linear in between, to the tool.

    frequency: [Hz]. `kalman_estimate` uses this model, or an identified model of one input.

    >>> model = gt.control.learning.tool_model(11.5, 0.05)
    >>> model.ninputs, model.noutputs, model.nstates
    (2, 1, 2)
    """
    w = 2 * np.pi * frequency
    # z'' = w2 (z_c - z) + 2 zeta w (z_c' - z'), with v = z' - 2 zeta w z_c in place of z'
    A = np.array([[0.0, 1.0], [-(w**2), -2 * damping * w]])
    B = np.array([[2 * damping * w], [w**2 - (2 * damping * w) ** 2]])
    F, first, last = ramped(A, B, sample_time)
    return SampledSystem(F, np.hstack([first, last]), [[1.0, 0.0]], np.zeros((1, 2)), sample_time)
