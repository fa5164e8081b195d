"""The gain at which a late loop loses its stability: the first crossing from zero upwards, never a later one."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from ...results import ArgumentError
from .crossings import gain_crossings
from .loop import DelayedLoop

EXACT = 1e-14  # relative, of a gain
BESIDE = 1e-3  # of the first crossing: how far beside it the eigenvalues are asked at most
SPREAD = 10.0  # times the greatest crossing: a gain beyond all


@dataclass(frozen=True)
class GainLimit:
    """gain: below it, from zero on, the loop is stable; infinite where nothing limits it. frequency [Hz]: at which it
    swings there. returns: ranges (from, to) of greater gains at which it is stable again, which are no use in practice:
    on the way to them it was not.
    """

    gain: float
    frequency: float
    returns: tuple[tuple[float, float], ...] = ()


def gain_limit(loop: DelayedLoop) -> GainLimit:
    """The first gain from zero upwards at which an eigenvalue of the companion matrix reaches the unit circle.

    The frequency response gives all gains at which a pole lies on the circle; between them the number of unstable poles
    is constant, and the eigenvalues there decide. The first boundary is then bisected on the largest eigenvalue. Raises
    ArgumentError where small gains are unstable already, as with a plant that does not come to rest by itself.

    >>> plant = gt.control.delayed.equivalent_plant(3.0, 57.7, 34200.0, cycle=0.004)
    >>> loop = gt.control.delayed.DelayedLoop(plant, cycle=0.004, delay=0.052)
    >>> limit = gt.control.delayed.gain_limit(loop)
    >>> round(limit.gain, 3), round(limit.frequency, 1), bool(abs(loop.radius(limit.gain) - 1) < 1e-9)
    (0.243, 20.0, True)
    """
    boundaries, ranges = stability_ranges(loop)
    if not ranges or ranges[0][0] > 0:
        raise ArgumentError(
            "the loop is unstable at the smallest gains already: without corrections the plant does not come to rest, "
            "or the correction has the wrong sign"
        )
    end = ranges[0][1]
    if not np.isfinite(end):
        return GainLimit(np.inf, 0.0)
    at = int(np.argmin(np.abs(boundaries[:, 0] - end)))
    frequency = float(boundaries[at, 1] / (2 * np.pi))
    return GainLimit(_on_the_circle(loop, boundaries[:, 0], at), frequency, tuple(ranges[1:]))


def stability_ranges(loop: DelayedLoop) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Crossings (n, 2) as `gain_crossings` gives them, and the ranges of gains above 0 that are stable, rising."""
    crossings = gain_crossings(loop)
    edges = np.concatenate([[0.0], crossings[:, 0], [np.inf]])
    ranges: list[tuple[float, float]] = []
    for low, high in pairwise(edges.tolist()):
        if high - low <= EXACT * high or not loop.stable(_between(low, high)):
            continue
        if ranges and ranges[-1][1] == low:
            ranges[-1] = (ranges[-1][0], high)
        else:
            ranges.append((low, high))
    return crossings, ranges


def _between(low: float, high: float) -> float:
    if not np.isfinite(high):
        return SPREAD * low if low else 1.0
    return (low + high) / 2 if low else high / 2


def _on_the_circle(loop: DelayedLoop, crossings: np.ndarray, at: int) -> float:
    """The gain of a crossing, from the eigenvalues."""
    gain = float(crossings[at])
    near = np.abs(np.delete(crossings, at) - gain).min(initial=gain) / 2
    step = min(near, BESIDE * gain)

    def beyond(P: float) -> float:
        return loop.radius(P) - 1

    if not beyond(gain - step) < 0 < beyond(gain + step):
        return gain  # two crossings at one gain: the response's is exact to rounding
    return float(scipy.optimize.brentq(beyond, gain - step, gain + step, xtol=EXACT * gain, rtol=4 * EXACT))
