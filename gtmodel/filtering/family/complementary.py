"""The complementary filter: low frequencies from one signal, high ones from another, without a noise model."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from ...results.interpolation import smooth
from ...results.refusal import ArgumentError
from ...results.trajectory import Trajectory

UNEVEN = 1e-6  # of a period


def complementary(
    slow: Trajectory, acceleration: Trajectory, cutoff: Any, *, order: int = 2, zero_phase: bool = True
) -> Trajectory:
    """Combine a slow signal and an acceleration: z = G z_c + (1 - G) z_a, with a Butterworth low-pass filter G.

    z_c is accurate at low frequencies, such as the tool position from the motors; z_a is the acceleration integrated
    twice, accurate at high ones. The factor 1 - G suppresses the drift of z_a. Dressler 2012, (7.17).

    Args:
        slow: one signal, z_c (K,) or (K, n), at even times.
        acceleration: one signal with the same times and size, in the same axes, without gravity.
        cutoff: [Hz], a number or one per component; Dressler 2012, (7.18): 4.50 and 2.63.
        order: of the Butterworth filter. zero_phase: run it forward and backward over the log, which halves its gain
            at the cutoff; if false, it is causal.

    Returns a trajectory with the name and unit of `slow`; wrapped angles are unwrapped. Raises ArgumentError if the
    signals do not match.

    >>> t = 0.004 * np.arange(500)
    >>> truth = 0.01 * np.sin(2 * np.pi * 10 * t)
    >>> slow = gt.Trajectory(t, {"z": np.zeros(500)}, {"z": "m"})  # the motors do not see this motion
    >>> felt = gt.Trajectory(t, {"a": -(2 * np.pi * 10) ** 2 * truth + 0.05}, {"a": "m/s2"})
    >>> z = gt.filtering.complementary(slow, felt, 2.0)["z"]
    >>> bool(np.abs(z - truth)[100:400].max() < 0.05 * 0.01)
    True
    """
    name, z_c = _single(smooth(slow), "slow")
    _, a = _single(acceleration, "acceleration")
    t = slow.time
    if a.shape != z_c.shape or not np.array_equal(t, acceleration.time):
        raise ArgumentError(
            f"expected the times and the size of the slow signal, {z_c.shape}; found {a.shape}", "acceleration"
        )
    steps = np.diff(t)
    if len(t) < 3 or np.any(np.abs(steps - steps.mean()) > UNEVEN * steps.mean()):
        raise ArgumentError("expected even times; resample the signals first", "slow")
    dt, frequencies = float(steps.mean()), np.asarray(cutoff, float)
    if np.any(frequencies <= 0) or np.any(frequencies >= 0.5 / dt) or frequencies.shape not in ((), z_c.shape[1:]):
        raise ArgumentError(
            f"expected frequencies above 0 and below {0.5 / dt:g} Hz, one or one per component; found {cutoff!r}",
            "cutoff",
        )
    columns, felt = z_c.reshape(len(t), -1), a.reshape(len(t), -1)
    z_a = twice_integrated(felt, dt)
    combined = np.empty_like(columns)
    for n, f in enumerate(np.broadcast_to(frequencies, columns.shape[1:])):
        sections = scipy.signal.butter(order, f, fs=1 / dt, output="sos")
        # G z_c + (1 - G) z_a = z_a + G (z_c - z_a); the line is the integration constants
        difference = columns[:, n] - z_a[:, n]
        line = np.polynomial.Polynomial.fit(t, difference, 1)(t)
        rest = difference - line
        low = scipy.signal.sosfiltfilt(sections, rest) if zero_phase else scipy.signal.sosfilt(sections, rest)
        combined[:, n] = z_a[:, n] + line + low
    return Trajectory(t, {name: combined.reshape(z_c.shape)}, {name: slow.units[name]}, title="complementary filter")


def twice_integrated(a: np.ndarray, dt: float) -> np.ndarray:
    """Positions (K, n) from accelerations (K, n) that are linear between instants, from rest at zero."""
    v = np.concatenate([np.zeros((1, a.shape[1])), np.cumsum((a[:-1] + a[1:]) * (dt / 2), axis=0)])
    return np.concatenate(
        [np.zeros((1, a.shape[1])), np.cumsum(v[:-1] * dt + (2 * a[:-1] + a[1:]) * (dt**2 / 6), axis=0)]
    )


def _single(trajectory: Trajectory, argument: str) -> tuple[str, np.ndarray]:
    if len(trajectory.names) != 1:
        raise ArgumentError(f"expected one signal; found {', '.join(trajectory.names)}", argument)
    return trajectory.names[0], np.asarray(trajectory[trajectory.names[0]], float)
