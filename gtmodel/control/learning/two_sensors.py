"""The complementary filter of Dressler 2012, (7.17), as maps of whole runs with their adjoints, for runs of any length.

z = z_a + line + G (z_c - z_a - line) with z_a = J a, J the double integral from rest, line = P (z_c - z_a) the straight
line of least squares, and G the low pass forward and backward with the padding of scipy's `sosfiltfilt`. So with
M = P + G (I - P): z = M z_c + (I - M) J a.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from .lifted import Array, Lifted, identity


def of_motors(sections: Any, size: int) -> Lifted:
    """M of runs of `size` samples."""
    line = fitted_line(size)
    return line + padded_zero_phase(sections, size) @ (identity(size) - line)


def of_acceleration(sections: Any, size: int, sample_time: float) -> Lifted:
    """(I - M) J of runs of `size` samples."""
    return (identity(size) - of_motors(sections, size)) @ double_integral(size, sample_time)


def fitted_line(size: int) -> Lifted:
    """P, the projection onto constants and slopes; its own adjoint."""
    k = np.arange(size) - (size - 1) / 2
    rows = np.vstack([np.ones(size) / np.sqrt(size), k / np.linalg.norm(k)])

    def forward(x: Array) -> Array:
        return rows.T @ (rows @ x)

    return Lifted(size, forward, forward)


def double_integral(size: int, sample_time: float) -> Lifted:
    """J: positions of accelerations that run straight between samples, from rest at zero."""
    from ...filtering.family.complementary import twice_integrated

    T = sample_time

    def backward(y: Array) -> Array:
        # w: what a step of position weighs, s: what a step of speed does
        w = np.cumsum(y[:0:-1], axis=0)[::-1]
        s = T * (np.cumsum(w[::-1], axis=0)[::-1] - w)
        made = np.zeros_like(y)
        made[:-1] += s * T / 2 + w * T**2 / 3
        made[1:] += s * T / 2 + w * T**2 / 6
        return made

    return Lifted(size, lambda x: twice_integrated(x, T), backward)


def padded_zero_phase(sections: Any, size: int) -> Lifted:
    """G as `scipy.signal.sosfiltfilt` runs it: the ends reflected through their last samples, each pass from the steady
    state of its first sample."""
    sos = np.asarray(sections, float)
    taps = 2 * len(sos) + 1
    pad = 3 * (taps - min(int((sos[:, 2] == 0).sum()), int((sos[:, 5] == 0).sum())))
    long = size + 2 * pad
    zi = scipy.signal.sosfilt_zi(sos)
    steady = scipy.signal.sosfilt(sos, np.zeros(long), zi=zi)[0][:, None]  # the answer to that state alone

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
        made = np.asarray(scipy.signal.sosfilt(sos, y[::-1], axis=0))[::-1].copy()
        made[:1] += steady.T @ y
        return made

    def forward(x: Array) -> Array:
        return once(once(extended(x))[::-1])[::-1][pad : pad + size]

    def backward(y: Array) -> Array:
        wide = np.zeros((long, y.shape[1]))
        wide[pad : pad + size] = y
        return folded(once_back(once_back(wide[::-1])[::-1]))

    return Lifted(size, forward, backward)
