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
LARGE = 120  # states beyond which a crossing of the response is not bisected on eigenvalues, exact as it is
AT_REST = 1e-12  # below one: a modulus of a pole of the plant above says that it does not come to rest
REACHED = 1e-13  # relative singular value: a motion is neither corrected nor measured


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

    The frequency response gives all gains at which poles lie on the circle, and whether they leave or return there;
    below the first, eigenvalues count the unstable ones. The first boundary is then bisected on the largest eigenvalue.
    Raises ArgumentError where small gains are unstable already, as with a plant that does not come to rest by itself.

    >>> plant = gt.control.delayed.equivalent_plant(3.0, 57.7, 34200.0, cycle=0.004)
    >>> loop = gt.control.delayed.DelayedLoop(plant, cycle=0.004, delay=0.052)
    >>> limit = gt.control.delayed.gain_limit(loop)
    >>> round(limit.gain, 3), round(limit.frequency, 1), bool(abs(loop.radius(limit.gain) - 1) < 1e-9)
    (0.243, 20.0, True)
    """
    boundaries, ranges = stability_ranges(loop)
    if not ranges or ranges[0][0] > 0:
        later = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in ranges)
        raise ArgumentError(
            "the loop is unstable at the smallest gains already: without corrections the plant does not come to rest, "
            "or the correction has the wrong sign" + (f"; only gains of {later} are stable" if later else "")
        )
    end = ranges[0][1]
    if not np.isfinite(end):
        return GainLimit(np.inf, 0.0)
    at = int(np.argmin(np.abs(boundaries[:, 0] - end)))
    frequency = float(boundaries[at, 1] / (2 * np.pi))
    return GainLimit(_on_the_circle(loop, boundaries[:, 0], at), frequency, tuple(ranges[1:]))


def stability_ranges(loop: DelayedLoop) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Crossings (n, 3) as `gain_crossings` gives them, and the ranges of gains above 0 that are stable, rising.

    Raises ArgumentError for a plant or law that keeps moving in a way that no correction reaches or no measurement
    sees.
    """
    _check_that_motions_are_seen(loop)
    crossings = gain_crossings(loop)
    edges = np.concatenate([[0.0], crossings[:, 0], [np.inf]])
    first = edges[1] / 2 if len(crossings) else 1.0
    unstable = int(np.sum(np.abs(np.linalg.eigvals(loop.matrix(float(first)))) >= 1))
    counts = unstable + np.concatenate([[0.0], np.cumsum(crossings[:, 2])])
    ranges: list[tuple[float, float]] = []
    for (low, high), count in zip(pairwise(edges.tolist()), counts.tolist(), strict=True):
        if count == 0 and high > low * (1 + EXACT):
            if ranges and ranges[-1][1] == low:
                ranges[-1] = (ranges[-1][0], high)
            else:
                ranges.append((low, high))
    return crossings, ranges


def _check_that_motions_are_seen(loop: DelayedLoop) -> None:
    """Raises ArgumentError for a motion that stays at every gain."""
    a, early, late = loop.transition
    la, lb, lc, _ = loop.law_matrices
    for name, A, poles, entries, leaves in (
        ("plant", a, loop.poles[0], np.stack([early, late], axis=1), loop.plant.C[None]),
        ("law", la, loop.poles[1], lb[:, None], lc[None]),
    ):
        for pole in poles[np.abs(poles) > 1 - AT_REST]:
            turned = pole * np.eye(len(A)) - A
            for rows, said in (
                (np.concatenate([turned, leaves]), "the measurement does not see it"),
                (np.concatenate([turned, entries], axis=1).T, "no correction reaches it"),
            ):
                sizes = np.linalg.svd(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300), compute_uv=False)
                if sizes[-1] < REACHED * sizes[0]:
                    raise ArgumentError(
                        f"the {name} has a motion that does not come to rest by itself, and {said}; "
                        "leave that motion out of it"
                    )


def _on_the_circle(loop: DelayedLoop, crossings: np.ndarray, at: int) -> float:
    """The gain of a crossing, from the eigenvalues."""
    gain = float(crossings[at])
    if len(loop) > LARGE:
        return gain
    near = np.abs(np.delete(crossings, at) - gain).min(initial=gain) / 2
    step = min(near, BESIDE * gain)

    def beyond(P: float) -> float:
        return loop.radius(P) - 1

    if not beyond(gain - step) < 0 < beyond(gain + step):
        return gain  # two crossings at one gain: the response's is exact to rounding
    return float(scipy.optimize.brentq(beyond, gain - step, gain + step, xtol=EXACT * gain, rtol=4 * EXACT))
