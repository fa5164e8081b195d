"""Estimates of the tool position from measured signals, as maps of whole runs: Dressler 2012, (7.7), (7.17), (7.21)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from ...results import ArgumentError
from .axis import AxisPlant
from .kalman import ExtendedKalman
from .lifted import Array, Lifted, identity
from .plants import SAMPLE_TIME


def of_motors(sections: Any, size: int) -> Lifted:
    """Return M for runs of `size` samples: a straight line plus the low-passed rest."""
    line = fitted_line(size)
    return line + padded_zero_phase(sections, size) @ (identity(size) - line)


def of_acceleration(sections: Any, size: int, sample_time: float) -> Lifted:
    """Return (I - M) J for runs of `size` samples."""
    return (identity(size) - of_motors(sections, size)) @ double_integral(size, sample_time)


def fitted_line(size: int) -> Lifted:
    """Return P, the projection onto straight lines, which is its own adjoint."""
    k = np.arange(size) - (size - 1) / 2
    rows = np.vstack([np.ones(size) / np.sqrt(size), k / np.linalg.norm(k)])

    def forward(x: Array) -> Array:
        return rows.T @ (rows @ x)

    return Lifted(size, forward, forward)


def double_integral(size: int, sample_time: float) -> Lifted:
    """Return J, from accelerations, linear between samples, to positions, from rest at zero."""
    from ...filtering.family.complementary import twice_integrated

    T = sample_time

    def backward(y: Array) -> Array:
        # w: weight of a step of position, s: weight of a step of speed
        w = np.cumsum(y[:0:-1], axis=0)[::-1]
        s = T * (np.cumsum(w[::-1], axis=0)[::-1] - w)
        x = np.zeros_like(y)
        x[:-1] += s * T / 2 + w * T**2 / 3
        x[1:] += s * T / 2 + w * T**2 / 6
        return x

    return Lifted(size, lambda x: twice_integrated(x, T), backward)


def padded_zero_phase(sections: Any, size: int) -> Lifted:
    """Return G, equal to `scipy.signal.sosfiltfilt`: odd extension at the ends, and each pass starts in the steady
    state of its first sample."""
    sos = np.asarray(sections, float)
    taps = 2 * len(sos) + 1
    pad = 3 * (taps - min(int((sos[:, 2] == 0).sum()), int((sos[:, 5] == 0).sum())))
    long = size + 2 * pad
    zi = scipy.signal.sosfilt_zi(sos)
    steady = scipy.signal.sosfilt(sos, np.zeros(long), zi=zi)[0][:, None]  # response to this state alone

    def extended(x: Array) -> Array:
        return np.concatenate([2 * x[:1] - x[pad:0:-1], x, 2 * x[-1:] - x[-2 : -pad - 2 : -1]])

    def folded(y: Array) -> Array:
        before, x, after = y[:pad], y[pad : pad + size].copy(), y[pad + size :]
        x[0] += 2 * before.sum(axis=0)
        x[1 : pad + 1] -= before[::-1]
        x[-1] += 2 * after.sum(axis=0)
        x[-pad - 1 : -1] -= after[::-1]
        return x

    def once(x: Array) -> Array:
        return np.asarray(scipy.signal.sosfilt(sos, x, axis=0)) + steady * x[:1]

    def once_back(y: Array) -> Array:
        x = np.asarray(scipy.signal.sosfilt(sos, y[::-1], axis=0))[::-1].copy()
        x[:1] += steady.T @ y
        return x

    def forward(x: Array) -> Array:
        return once(once(extended(x))[::-1])[::-1][pad : pad + size]

    def backward(y: Array) -> Array:
        wide = np.zeros((long, y.shape[1]))
        wide[pad : pad + size] = y
        return folded(once_back(once_back(wide[::-1])[::-1]))

    return Lifted(size, forward, backward)


PADDED = 3  # samples of padding, times the filter order plus two


@dataclass(frozen=True, eq=False)
class ToolEstimate:
    """zhat = sum of F_s y_s over the measured signals s: Dressler 2012, (7.7).

    maps: F_s by signal name. responses: their frequency responses, functions of frequencies (k,) in Hz.

    >>> learning = gt.control.learning
    >>> estimate = learning.measured(300)
    >>> seen = estimate.seen(learning.flexible_axis(11.5, 0.05).maps(300))
    >>> seen.size
    300
    """

    maps: Mapping[str, Lifted]
    responses: Mapping[str, Callable[[np.ndarray], np.ndarray]]

    def __call__(self, signals: Mapping[str, Any]) -> Array:
        """Return zhat (N,) of a run from its signals (N,) by name. Raises ArgumentError if one is missing."""
        missing = [name for name in self.maps if name not in signals]
        if missing:
            raise ArgumentError(f"the estimate also needs {', '.join(missing)}", "signals")
        return sum((F(signals[name]) for name, F in self.maps.items()), np.zeros(1))

    def seen(self, plant: Mapping[str, Lifted]) -> Lifted:
        """Return F_u + F_y T_uy of (7.15), from the input to the estimate."""
        total, *others = [F @ plant[name] for name, F in self.maps.items()]
        for other in others:
            total = total + other
        return total

    def response(self, plant: AxisPlant, frequency: np.ndarray) -> np.ndarray:
        """Return the frequency response of `seen` (k,) at frequencies (k,) in Hz."""
        T = plant.responses(frequency, self.responses)
        return np.sum([F(frequency) * T[name] for name, F in self.responses.items()], axis=0)


def kinematic(size: int) -> ToolEstimate:
    """Return zhat = z_c, forward kinematics of the motors: case 1.

    >>> gt.control.learning.kinematic(3)({"motor": [1.0, 2.0, 3.0]}).tolist()
    [1.0, 2.0, 3.0]
    """
    return ToolEstimate({"motor": identity(size)}, {"motor": np.ones_like})


def measured(size: int) -> ToolEstimate:
    """Return zhat = z, the measured tool: case 3.

    >>> gt.control.learning.measured(2)({"tool": [1.0, 2.0]}).tolist()
    [1.0, 2.0]
    """
    return ToolEstimate({"tool": identity(size)}, {"tool": np.ones_like})


def complementary_estimate(size: int, cutoff: float, sample_time: float = SAMPLE_TIME, order: int = 2) -> ToolEstimate:
    """Return (7.17): motors below the cutoff [Hz], integrated acceleration above it: case 2A, for whole runs.

    It equals `gtmodel.filtering.complementary`. Raises ArgumentError if the cutoff is out of range, or if a run is not
    longer than the filter's padding.

    >>> gt.control.learning.complementary_estimate(50, cutoff=4.5).maps["motor"].size
    50
    """
    if not 0 < cutoff < 0.5 / sample_time:
        raise ArgumentError(f"expected a cutoff above 0 and below {0.5 / sample_time:g} Hz; found {cutoff:g}", "cutoff")
    if size <= PADDED * (order + 2):
        raise ArgumentError(f"the filter's padding exceeds the {size} samples of the run; use a longer run", "size")
    sections = scipy.signal.butter(order, cutoff, fs=1 / sample_time, output="sos")

    def low(f: np.ndarray) -> np.ndarray:
        return np.abs(scipy.signal.sosfreqz(sections, f, fs=1 / sample_time)[1]) ** 2

    def high(f: np.ndarray) -> np.ndarray:
        # double integral, linear between samples: (Ts2 / 6) (z + 4 + 1/z) / (z - 2 + 1/z); 1 - G cancels its pole at 1
        c = np.cos(2 * np.pi * f * sample_time)
        with np.errstate(divide="ignore", invalid="ignore"):
            twice = sample_time**2 / 6 * (2 * c + 4) / (2 * c - 2)
            return np.where(c < 1, (1 - low(f)) * twice, 0.0)

    return ToolEstimate(
        {"motor": of_motors(sections, size), "acceleration": of_acceleration(sections, size, sample_time)},
        {"motor": low, "acceleration": high},
    )


def kalman_estimate(size: int, filter: ExtendedKalman) -> ToolEstimate:
    """Return (7.21) and (7.22), a model from the motor side to the tool corrected by the acceleration: case 2B.

    >>> learning = gt.control.learning
    >>> filter = learning.ExtendedKalman(learning.tool_model(11.5, 0.05), process=1e-12, noise=0.07)
    >>> learning.kalman_estimate(100, filter).maps["acceleration"].size
    100
    """
    from .lifted import shifted, toeplitz

    system = filter.system
    columns = filter.pulses(size)
    motor = toeplitz(columns[0])
    for k in range(1, len(columns) - 1):
        motor = motor + toeplitz(columns[k]) @ shifted(size, 1.0, k)

    def of_motor(f: np.ndarray) -> np.ndarray:
        z = np.exp(2j * np.pi * f * filter.sample_time)
        return np.sum([z**k * filter.response(f, k) for k in range(len(columns) - 1)], axis=0)

    def of_acceleration(f: np.ndarray) -> np.ndarray:
        return filter.response(f, len(columns) - 1)

    assert system.nstates
    return ToolEstimate(
        {"motor": motor, "acceleration": toeplitz(columns[-1])},
        {"motor": of_motor, "acceleration": of_acceleration},
    )
