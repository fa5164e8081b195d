"""Stability of one cut by semi-discretisation of the delayed equations (Insperger and Stepan 2004)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from .cutter import Cut, Cutter, immersion, tooth_frequency
from .directional import directional_matrix, plane
from .oscillators import Oscillators

INTERVALS = 60  # of a tooth period at least
PER_CYCLE = 20  # intervals in a period of the fastest mode that matters
MOST = 1200  # intervals: more are a matrix of 3600 rows and minutes
RIGID = 100.0  # times the least stiffness in the plane of the cut: a mode so stiff does not matter
DISCS = 12


def spectral_radius(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), intervals: int | None = None,
) -> float:  # fmt: skip
    """Largest modulus of the Floquet multipliers over one tooth period: below 1 the cut is stable.

    One pose, even pitch, helix included; speed [1/s]. The period is cut into `intervals` in which the force's
    coefficient and the delayed displacement are constant; if left out, 20 in a period of the fastest mode, 60 at least.
    Raises ValueError for impossible values, and for a spindle so slow that more than 1200 are needed.
    """
    period = 1 / tooth_frequency(speed, cutter.teeth)
    intervals = enough_intervals(oscillators, period, feed, up) if intervals is None else intervals
    if intervals < 4:
        raise ValueError(f"found {intervals} intervals; expected four or more")
    step, P = period / intervals, plane(feed, up)
    W = cut.axial_depth * np.einsum("ji,tjk,kl->til", P, _mean_matrices(cutter, cut, intervals), P)
    m, c, k = (np.diag(x[0]) for x in (oscillators.m, oscillators.c, oscillators.k))
    inverse = np.linalg.inv(m)
    # M = [A, B; 0, 0] gives exp(A h) and the integral of exp(A s) B in one
    system = np.zeros((intervals, 9, 9))
    system[:, :3, 3:6] = np.eye(3)
    system[:, 3:6, :3] = inverse @ (W - k)
    system[:, 3:6, 3:6] = -inverse @ c
    system[:, 3:6, 6:] = -inverse @ W
    E = expm(system * step)
    # columns: what the state now and x at the last `intervals` grid times becomes
    size = 6 + 3 * intervals
    now = np.eye(6, size)
    history = np.concatenate([np.eye(3, size)[None], np.eye(3 * intervals, size, 6).reshape(intervals, 3, size)])
    past = list(history)  # past[j] is x at j steps before
    for i in range(intervals):
        delayed = (past[-1] + past[-2]) / 2
        now = E[i, :6, :6] @ now + E[i, :6, 6:] @ delayed
        past = [now[:3], *past[:-1]]
    monodromy = np.concatenate([now, *past[1:]])
    return float(np.abs(np.linalg.eigvals(monodromy)).max())


def enough_intervals(oscillators: Oscillators, period: float, feed: ArrayLike, up: ArrayLike) -> int:
    """For a tooth period [s] of the first pose. Raises ValueError for too many."""
    moved = (plane(feed, up) ** 2).sum(axis=0) > 1e-9
    k, f = oscillators.k[0][moved], oscillators.frequency[0][moved]
    fastest = float(f[k <= RIGID * k.min()].max())
    needed = max(INTERVALS, int(np.ceil(PER_CYCLE * fastest * period)))
    if needed > MOST:
        raise ValueError(
            f"a mode at {fastest:.3g} Hz swings {fastest * period:.3g} times from tooth to tooth, which needs {needed} "
            f"intervals; expected {MOST} at most: look at the least depth of the stability lobes"
        )
    return needed


def stable_depth(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), low: float, high: float, intervals: int | None = None, tolerance: float = 1e-3,
) -> float:  # fmt: skip
    """Axial depth [m] between low and high where the cut turns unstable, by bisection to a relative tolerance.

    Raises ValueError unless `low` is stable and `high` is not.
    """

    def radius(depth: float) -> float:
        deeper = Cut(cut.mode, cut.radial_depth, depth, cut.feed_per_tooth)
        return spectral_radius(oscillators, cutter, deeper, speed, feed, up=up, intervals=intervals)

    if radius(low) >= 1 or radius(high) < 1:
        raise ValueError(f"expected a stable depth and an unstable one; found {radius(low):.3g} at {low:g} m and "
                         f"{radius(high):.3g} at {high:g} m")  # fmt: skip
    while high - low > tolerance * high:
        middle = (low + high) / 2
        low, high = (middle, high) if radius(middle) < 1 else (low, middle)
    return (low + high) / 2


def _mean_matrices(cutter: Cutter, cut: Cut, intervals: int) -> np.ndarray:
    """(intervals, 2, 2) [N/m2] over the tooth period, averaged over each interval and over the helix."""
    start, end = immersion(cut.mode, cut.radial_depth, cutter.diameter)
    fine = 8
    phi = 2 * np.pi / cutter.teeth * (np.arange(intervals * fine) + 0.5) / (intervals * fine)
    lag = cutter.lag(cut.axial_depth) * (np.arange(DISCS) + 0.5) / DISCS
    found = np.zeros((intervals, 2, 2))
    for angle in 2 * np.pi * np.arange(cutter.teeth) / cutter.teeth:
        D = directional_matrix(cutter, phi[:, None] + angle - lag, start, end)
        found += D.reshape(intervals, fine * DISCS, 2, 2).mean(axis=1)
    return found
