"""Stability of one cut by semi-discretisation of the delayed equations (Insperger and Stepan 2004): slow to converge,
and independent of the collocation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..linear.state_space import held, second_order
from .cutter import Cut, Cutter, immersion, tooth_frequency
from .directional import directional_matrix, plane
from .oscillators import Oscillators

DISCS = 12
UNEVEN = 1e-9  # rad


def semi_discretised_radius(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), intervals: int,
) -> float:  # fmt: skip
    """Largest modulus of the Floquet multipliers over one tooth period: below 1 the cut is stable.

    One pose, even pitch, helix included; speed [1/s]. The period is cut into `intervals` in which the force's
    coefficient and the delayed displacement are constant: 20 in a period of the fastest mode are good to a percent.
    Raises ValueError for impossible values and uneven pitch.
    """
    period = 1 / tooth_frequency(speed, cutter.teeth)
    if np.ptp(cutter.pitch) > UNEVEN:
        raise ValueError("the pitch of the teeth is uneven; leave out `intervals`, which takes even pitch only")
    if intervals < 4:
        raise ValueError(f"found {intervals} intervals; expected four or more")
    step, P = period / intervals, plane(feed, up)
    W = cut.axial_depth * np.einsum("ji,tjk,kl->til", P, mean_matrices(cutter, cut, intervals), P)
    m, c, k = (np.diag(x[0]) for x in (oscillators.m, oscillators.c, oscillators.k))
    A, B, _ = second_order(m, c, k - W, -W)
    free, regenerated = held(A, B, step)
    # columns: what the state now and x at the last `intervals` grid times becomes
    size = 6 + 3 * intervals
    now = np.eye(6, size)
    history = np.concatenate([np.eye(3, size)[None], np.eye(3 * intervals, size, 6).reshape(intervals, 3, size)])
    past = list(history)  # past[j] is x at j steps before
    for i in range(intervals):
        delayed = (past[-1] + past[-2]) / 2
        now = free[i] @ now + regenerated[i] @ delayed
        past = [now[:3], *past[:-1]]
    monodromy = np.concatenate([now, *past[1:]])
    return float(np.abs(np.linalg.eigvals(monodromy)).max())


def mean_matrices(cutter: Cutter, cut: Cut, intervals: int) -> np.ndarray:
    """(intervals, 2, 2) [N/m2] over the tooth period, averaged over each interval and over the helix."""
    start, end = immersion(cut.mode, cut.radial_depth, cutter.diameter)
    fine = 8
    phi = 2 * np.pi / cutter.teeth * (np.arange(intervals * fine) + 0.5) / (intervals * fine)
    lag = cutter.lag(cut.axial_depth) * (np.arange(DISCS) + 0.5) / DISCS
    means = np.zeros((intervals, 2, 2))
    for angle in 2 * np.pi * np.arange(cutter.teeth) / cutter.teeth:
        D = directional_matrix(cutter, phi[:, None] + angle - lag, start, end)
        means += D.reshape(intervals, fine * DISCS, 2, 2).mean(axis=1)
    return means
