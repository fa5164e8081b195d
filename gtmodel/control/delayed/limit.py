"""Gain limit of a delayed loop from crossings of its response, and the least limit over uncertain parameters."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise, product
from weakref import WeakKeyDictionary

import numpy as np
import scipy

from ...results import ArgumentError
from .loop import APART, WIDTH, DelayedLoop, off_poles

CLOSE = 0.5  # rad: a phase that turns back within this distance of the negative real axis is refined
EXACT = 1e-15  # relative tolerance of a frequency
SAME = 0.05  # relative difference of L at zero and at the lowest frequency, at most


def gain_crossings(loop: DelayedLoop) -> np.ndarray:
    """Return rows (n, 3), by increasing gain: the gain at which poles lie on the unit circle, their angular frequency
    [rad/s], and the change in the number of unstable poles there: 2, or 1 for a real pole; negative if poles return.

    At these gains P L = -1. With increasing gain a pole moves outwards if the imaginary part of L rises with the
    frequency: d ln z / dP = -1 / (P z L'(z)).
    """
    w, g = loop.sampled
    real, imaginary = np.real(g), np.imag(g)
    rows = []

    def add(low: float, high: float, rises: bool) -> None:
        omega = _root(lambda x: loop.response_at(x).imag, low, high)
        value = loop.response_at(omega).real
        if value < 0 and len(off_poles(loop, np.array([omega]))):  # an undamped pole is on the circle at zero gain
            rows.append((-1 / value, omega, 2.0 if rises else -2.0))

    ends = np.minimum(real[:-1], real[1:]) < 0
    sign = np.where(imaginary >= 0, 1, -1)
    for i in np.flatnonzero((sign[:-1] != sign[1:]) & ends & (w[1:] < np.pi / loop.cycle)).tolist():
        add(float(w[i]), float(w[i + 1]), bool(sign[i] < 0))
    for low, middle, high, side in _turned_back(loop, w, g, sign):
        add(low, middle, side < 0)
        add(middle, high, side > 0)
    if real[-1] < 0:  # L is real at the Nyquist frequency, where the imaginary part changes its sign
        rows.append((-1 / float(real[-1]), float(w[-1]), 1.0 if imaginary[-2] < 0 else -1.0))
    static = _static(loop, complex(g[0]))
    if static < 0:
        rows.append((-1 / static, 0.0, 1.0 if imaginary[0] > 0 else -1.0))
    return np.array(sorted(rows), float).reshape(-1, 3)


def size_crossings(loop: DelayedLoop, gain: float) -> np.ndarray:
    """Return the angular frequencies (n,) [rad/s], increasing, at which |P L| = 1."""
    w, g = loop.sampled
    with np.errstate(divide="ignore"):
        sizes = np.log(np.abs(gain * g))
    above = sizes > 0

    def log_size(x: float) -> float:
        return math.log(max(abs(gain * loop.response_at(x)), 1e-300))

    roots = [_root(log_size, float(w[i]), float(w[i + 1])) for i in np.flatnonzero(above[:-1] != above[1:])]
    # |P L| may cross one twice between two grid frequencies
    for i in turns(np.abs(sizes), above, APART):
        side = 1.0 if above[i] else -1.0
        x, value = least_of(lambda x, side=side: side * log_size(x), float(w[i - 1]), float(w[i + 1]))
        if value < 0:
            roots += [_root(log_size, float(w[i - 1]), x), _root(log_size, x, float(w[i + 1]))]
    return np.array(sorted(roots))


def largest_in_sector(loop: DelayedLoop, phase: float) -> float:
    """Return the largest |L| where L is within `phase` [rad] of the negative real axis; 0 if it never is.

    At gains below the inverse of this number the loop keeps at least this phase margin.
    """
    w, g = loop.sampled
    apart = np.abs(np.angle(-g))
    inside = apart <= phase
    sizes = np.abs(g)
    largest = float(sizes[inside].max(initial=0.0))

    def beyond(x: float) -> float:
        return abs(cmath.phase(-loop.response_at(x))) - phase

    def smallness(x: float) -> float:
        return -abs(loop.response_at(x)) if beyond(x) <= 0 else 0.0

    edges = [(float(w[i]), float(w[i + 1])) for i in np.flatnonzero(inside[:-1] != inside[1:])]
    for i in turns(np.abs(apart - phase), inside, CLOSE):  # in and out again between two grid frequencies
        x, value = least_of(
            lambda x, side=-1.0 if inside[i] else 1.0: side * beyond(x), float(w[i - 1]), float(w[i + 1])
        )
        edges += [(float(w[i - 1]), x), (x, float(w[i + 1]))] if value < 0 else []
    for low, high in edges:
        largest = max(largest, abs(loop.response_at(_root(beyond, low, high))))
    peak = np.concatenate([[False], (sizes[1:-1] >= sizes[:-2]) & (sizes[1:-1] >= sizes[2:]), [False]]) & inside
    for i in np.flatnonzero(peak & (sizes > largest * (1 - APART))).tolist():
        largest = max(largest, -least_of(smallness, float(w[i - 1]), float(w[i + 1]))[1])
    return largest


def least_of(f: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Return the frequency between `low` and `high` that minimises a function, and the minimum."""
    best = scipy.optimize.minimize_scalar(f, bounds=(low, high), method="bounded", options={"xatol": WIDTH * high})
    return float(best.x), float(best.fun)


def _turned_back(
    loop: DelayedLoop, w: np.ndarray, g: np.ndarray, sign: np.ndarray
) -> list[tuple[float, float, float, int]]:
    """Frequencies before, on and after a piece beyond the negative real axis between grid points, and the sign of the
    imaginary part on both sides of it."""
    phase = np.abs(np.angle(-g))
    rows = []
    for i in turns(phase, sign, CLOSE):
        side = int(sign[i])

        def imaginary(x: float, side: int = side) -> float:
            value = loop.response_at(x)
            return side * value.imag / max(abs(value), 1e-300)

        x, value = least_of(imaginary, float(w[i - 1]), float(w[i + 1]))
        if value < 0:
            rows.append((float(w[i - 1]), x, float(w[i + 1]), side))
    return rows


def turns(distance: np.ndarray, side: np.ndarray, near: float) -> list[int]:
    """Return the inner grid points where `distance` has a minimum below `near`, both neighbours on the same side."""
    inner = distance[1:-1]
    least = (inner <= distance[:-2]) & (inner < distance[2:]) & (inner < near)
    same = (side[1:-1] == side[:-2]) & (side[1:-1] == side[2:])
    return (1 + np.flatnonzero(least & same)).tolist()


def _root(f: Callable[[float], float], low: float, high: float) -> float:
    try:
        return float(scipy.optimize.brentq(f, low, high, xtol=EXACT * high, rtol=4 * EXACT))
    except ValueError:  # equal signs: a root on the grid, up to rounding
        return high if abs(f(high)) < abs(f(low)) else low


def _static(loop: DelayedLoop, near: complex) -> float:
    """L at frequency zero; 0 if it has no limit there, because then no real pole crosses at z = 1. near: L close by."""
    a, early, late = loop.transition
    la, lb, lc, ld = loop.law_matrices
    if np.abs(np.concatenate(loop.poles) - 1).min() < WIDTH:
        return 0.0
    value = float(loop.plant.C @ np.linalg.solve(np.eye(len(a)) - a, early + late))
    value *= ld + float(lc @ np.linalg.solve(np.eye(len(la)) - la, lb)) if len(la) else ld
    return value if abs(value - near) < SAME * abs(value) else 0.0


EXACT_GAIN = 1e-14  # relative distance of two crossings at one gain, at most
AT_REST = 1e-12  # a plant with a pole of modulus above 1 - AT_REST does not come to rest
REACHED = 1e-13  # relative singular value below which a motion is uncontrollable or unobservable


@dataclass(frozen=True)
class GainLimit:
    """Result of `gain_limit`.

    gain: the loop is stable from zero up to this gain; infinite if no gain makes it unstable. frequency [Hz]: of the
    oscillation at the limit. returns: ranges (from, to) of greater gains at which the loop is stable again. They are
    of no use in practice, because the gains below them are unstable.
    """

    gain: float
    frequency: float
    returns: tuple[tuple[float, float], ...] = ()


def gain_limit(loop: DelayedLoop) -> GainLimit:
    """Return the first gain above zero at which an eigenvalue of the companion matrix reaches the unit circle.

    The frequency response gives all gains at which poles lie on the circle, and whether they leave or return there. The
    eigenvalues below the first such gain give the number of unstable poles. Raises ArgumentError if already small gains
    are unstable, for example because the plant does not come to rest by itself.

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
            "the loop is unstable even at the smallest gains: the plant does not come to rest without corrections, "
            "or the correction has the wrong sign" + (f"; only gains of {later} are stable" if later else "")
        )
    end = ranges[0][1]
    if not np.isfinite(end):
        return GainLimit(np.inf, 0.0)
    row = int(np.argmin(np.abs(boundaries[:, 0] - end)))
    frequency = float(boundaries[row, 1] / (2 * np.pi))
    return GainLimit(float(end), frequency, tuple(ranges[1:]))


Ranges = tuple[np.ndarray, list[tuple[float, float]]]
_KNOWN: WeakKeyDictionary[DelayedLoop, Ranges] = WeakKeyDictionary()  # of loops that are asked for limit and margins


def stability_ranges(loop: DelayedLoop) -> Ranges:
    """Return the crossings (n, 3) of `gain_crossings`, and the stable ranges of gains above 0, in increasing order.

    Raises ArgumentError if plant or law have an uncontrollable or unobservable motion that does not decay.
    """
    if loop not in _KNOWN:
        _KNOWN[loop] = _stability_ranges(loop)
    return _KNOWN[loop]


def _stability_ranges(loop: DelayedLoop) -> Ranges:
    _check_that_motions_are_seen(loop)
    crossings = gain_crossings(loop)
    edges = np.concatenate([[0.0], crossings[:, 0], [np.inf]])
    first = edges[1] / 2 if len(crossings) else 1.0
    unstable = int(np.sum(np.abs(np.linalg.eigvals(loop.matrix(float(first)))) >= 1))
    counts = unstable + np.concatenate([[0.0], np.cumsum(crossings[:, 2])])
    ranges: list[tuple[float, float]] = []
    for (low, high), count in zip(pairwise(edges.tolist()), counts.tolist(), strict=True):
        if count == 0 and high > low * (1 + EXACT_GAIN):
            if ranges and ranges[-1][1] == low:
                ranges[-1] = (ranges[-1][0], high)
            else:
                ranges.append((low, high))
    return crossings, ranges


def _check_that_motions_are_seen(loop: DelayedLoop) -> None:
    """Raise ArgumentError if a motion that does not decay is uncontrollable or unobservable."""
    a, early, late = loop.transition
    la, lb, lc, _ = loop.law_matrices
    for name, A, poles, entries, leaves in (
        ("plant", a, loop.poles[0], np.stack([early, late], axis=1), loop.plant.C[None]),
        ("law", la, loop.poles[1], lb[:, None], lc[None]),
    ):
        for pole in poles[np.abs(poles) > 1 - AT_REST]:
            shifted = pole * np.eye(len(A)) - A
            for rows, reason in (
                (np.concatenate([shifted, leaves]), "the measurement does not see"),
                (np.concatenate([shifted, entries], axis=1).T, "no correction reaches"),
            ):
                sizes = np.linalg.svd(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300), compute_uv=False)
                if sizes[-1] < REACHED * sizes[0]:
                    raise ArgumentError(
                        f"the {name} has a motion that does not come to rest by itself and that {reason}; "
                        "leave this motion out of the model"
                    )


DRAWS = 1000
MOST_SIDES = 12  # of a box: n sides have 2^n vertices
SEARCHES = 3  # local searches from the worst points
SPREAD = 0.2  # of a side of the box: least distance between the starts of searches
NEAR = 1e-9  # relative tolerance of a search
ON_GRID = 1e-9  # of a step: a limit this close to a multiple of the step is that multiple


@dataclass(frozen=True, eq=False)
class WorstCase:
    """Result of `worst_case`.

    gain: least limit found in the box; point: its parameters. nominal: limit at the centre of the box. limits (n,): at
    the random points. The least limit is not a proven bound, and its point need not be a vertex.
    """

    gain: float
    point: dict[str, float]
    nominal: float
    limits: np.ndarray


def worst_case(
    loop_of: Callable[[Mapping[str, float]], DelayedLoop],
    box: Mapping[str, tuple[float, float]],
    *,
    limit_of: Callable[[DelayedLoop], float] = lambda loop: gain_limit(loop).gain,
    draws: int = DRAWS,
    seed: int = 0,
) -> WorstCase:
    """Return the least gain limit over a box of parameters: all vertices, random points, local searches from the worst.

    Args:
        loop_of: returns the loop for given parameters.
        box: range (from, to) of each parameter, by name.
        limit_of: the gain to minimise: the gain limit by default, or one that keeps margins (`margin_limit`).
        draws: number of random points, uniform in the box; seed: of the random points.

    The result is not a proven bound. The limit is 0 at points where already the smallest gains are unstable. Raises
    ArgumentError if the box is empty or has more than twelve sides, if a range is not finite or not increasing, and
    whatever `loop_of` raises.

    >>> def loop_of(p):
    ...     plant = gt.control.delayed.equivalent_plant(p["m"], 57.7, 34200.0, cycle=0.004)
    ...     return gt.control.delayed.DelayedLoop(plant, cycle=0.004, delay=p["delay"])
    >>> worst = gt.control.delayed.worst_case(loop_of, {"m": (2.7, 3.3), "delay": (0.05, 0.054)}, draws=50)
    >>> round(worst.nominal, 3), round(worst.gain, 3), {name: round(x, 3) for name, x in worst.point.items()}
    (0.243, 0.176, {'m': 2.7, 'delay': 0.054})
    """
    if not box or len(box) > MOST_SIDES:
        raise ArgumentError(f"expected 1 to {MOST_SIDES} parameters; found {len(box)}", "box")
    for name, (low, high) in box.items():
        if not (np.isfinite(low) and np.isfinite(high) and low <= high):
            raise ArgumentError(
                f"the range of '{name}' is {low:g} to {high:g}; expected finite numbers, the smaller first", "box"
            )
    if draws < 1:
        raise ArgumentError(f"expected at least 1; found {draws}", "draws")
    names, low, high = list(box), np.array([b[0] for b in box.values()]), np.array([b[1] for b in box.values()])

    def limit(share: np.ndarray) -> float:
        values = low + np.clip(share, 0.0, 1.0) * (high - low)
        loop = loop_of(dict(zip(names, values.tolist(), strict=True)))
        try:
            return limit_of(loop)
        except ArgumentError:  # unstable at the smallest gains; DelayedLoop has checked everything else
            return 0.0

    shares = np.random.default_rng(seed).random((draws, len(names)))
    drawn = np.array([limit(s) for s in shares])
    corners = np.array(list(product((0.0, 1.0), repeat=len(names))))
    points = np.concatenate([corners, shares])
    limits = np.concatenate([[limit(s) for s in corners], drawn])
    order = np.argsort(limits, kind="stable")
    best, worst = float(limits[order[0]]), points[order[0]]
    for begin in points[_apart(points[order], order)] if best > 0 else ():
        search = scipy.optimize.minimize(
            limit, begin, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(names),
            options={"fatol": NEAR * min(best, 1e300), "xatol": 1e-6, "adaptive": len(names) > 4},
        )  # fmt: skip
        if float(search.fun) < best:
            best, worst = float(search.fun), np.clip(search.x, 0.0, 1.0)
    point = dict(zip(names, (low + worst * (high - low)).tolist(), strict=True))
    return WorstCase(best, point, limit(np.full(len(names), 0.5)), drawn)


def _apart(points: np.ndarray, order: np.ndarray) -> list[int]:
    """Indices of the starts of searches, lowest limit first, each further than `SPREAD` from the earlier ones."""
    chosen: list[int] = []
    for i in range(len(points)):
        if all(np.abs(points[i] - points[j]).max() > SPREAD for j in chosen):
            chosen.append(i)
        if len(chosen) == SEARCHES:
            break
    return order[chosen].tolist()


def recommended_gain(limit: float, step: float) -> float:
    """Return the greatest multiple of `step` that does not exceed a gain limit; infinite for an infinite limit.

    Pass the limit with margins at the worst point, from `worst_case(..., limit_of=...)`; below a quantile of limits
    some loops are unstable. A limit of 0 means that no gain is safe. Raises ArgumentError if the limit is negative or
    the step not positive.

    >>> gt.control.delayed.recommended_gain(0.0212, step=0.01)
    0.02
    """
    if not limit >= 0:
        raise ArgumentError(f"expected a number, at least 0; found {limit!r}", "limit")
    if not (np.isfinite(step) and step > 0):
        raise ArgumentError(f"must be a number above 0; found {step!r}", "step")
    return float(Decimal(int(np.floor(limit / step + ON_GRID))) * Decimal(repr(step))) if np.isfinite(limit) else np.inf
