"""Where the frequency response of a loop meets the negative real axis, and where it has a size of one."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable

import numpy as np
import scipy

from .grid import APART, WIDTH, off_poles
from .loop import DelayedLoop

CLOSE = 0.5  # rad: a phase that turns back this near to the negative real axis is looked at
EXACT = 1e-15  # relative, of a frequency
SAME = 0.05  # relative: L at zero and at the lowest frequency


def gain_crossings(loop: DelayedLoop) -> np.ndarray:
    """(n, 3) gains at which poles lie on the unit circle, rising, their angular frequency [rad/s], and by how many the
    unstable poles grow there: 2, or 1 where the pole is real, below 0 where they leave.

    At such a gain P L = -1, and a pole moves outwards with the gain where the imaginary part of L rises with the
    frequency: d ln z / dP = -1 / (P z L'(z)).
    """
    w, g = loop.sampled
    real, imaginary = np.real(g), np.imag(g)
    rows = []

    def add(low: float, high: float, rises: bool) -> None:
        at = _root(lambda x: loop.response_at(x).imag, low, high)
        value = loop.response_at(at).real
        if value < 0 and len(off_poles(loop, np.array([at]))):  # an undamped pole is on the circle at a gain of zero
            rows.append((-1 / value, at, 2.0 if rises else -2.0))

    ends = np.minimum(real[:-1], real[1:]) < 0
    sign = np.where(imaginary >= 0, 1, -1)
    for i in np.flatnonzero((sign[:-1] != sign[1:]) & ends & (w[1:] < np.pi / loop.cycle)).tolist():
        add(float(w[i]), float(w[i + 1]), bool(sign[i] < 0))
    for low, middle, high, side in _turned_back(loop, w, g, sign):
        add(low, middle, side < 0)
        add(middle, high, side > 0)
    if real[-1] < 0:  # real by symmetry at the Nyquist frequency, where the imaginary part changes its sign
        rows.append((-1 / float(real[-1]), float(w[-1]), 1.0 if imaginary[-2] < 0 else -1.0))
    static = _static(loop, complex(g[0]))
    if static < 0:
        rows.append((-1 / static, 0.0, 1.0 if imaginary[0] > 0 else -1.0))
    return np.array(sorted(rows), float).reshape(-1, 3)


def size_crossings(loop: DelayedLoop, gain: float) -> np.ndarray:
    """Angular frequencies (n,) [rad/s], rising, at which P L has a size of one."""
    w, g = loop.sampled
    with np.errstate(divide="ignore"):
        sizes = np.log(np.abs(gain * g))
    above = sizes > 0

    def log_size(x: float) -> float:
        return math.log(max(abs(gain * loop.response_at(x)), 1e-300))

    roots = [_root(log_size, float(w[i]), float(w[i + 1])) for i in np.flatnonzero(above[:-1] != above[1:])]
    # a size that comes near to one between two frequencies may pass it
    for i in turns(np.abs(sizes), above, APART):
        side = 1.0 if above[i] else -1.0
        x, value = least_of(lambda x, side=side: side * log_size(x), float(w[i - 1]), float(w[i + 1]))
        if value < 0:
            roots += [_root(log_size, float(w[i - 1]), x), _root(log_size, x, float(w[i + 1]))]
    return np.array(sorted(roots))


def largest_in_sector(loop: DelayedLoop, phase: float) -> float:
    """The largest size of the response where it is nearer than `phase` [rad] to the negative real axis; 0 if it never
    is. At gains below its inverse every frequency at which P L has a size of one keeps at least this phase margin."""
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
    for i in turns(np.abs(apart - phase), inside, CLOSE):  # in and out again between two frequencies
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
    """Where a function of a frequency is least between two of them, and how small."""
    best = scipy.optimize.minimize_scalar(f, bounds=(low, high), method="bounded", options={"xatol": WIDTH * high})
    return float(best.x), float(best.fun)


def _turned_back(
    loop: DelayedLoop, w: np.ndarray, g: np.ndarray, sign: np.ndarray
) -> list[tuple[float, float, float, int]]:
    """Frequencies before, on and behind a piece beyond the negative real axis that lies between grid points, and the
    sign of the imaginary part around it."""
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
    """Inner grid points that are nearest, below `near`, with both neighbours on the same side."""
    inner = distance[1:-1]
    least = (inner <= distance[:-2]) & (inner < distance[2:]) & (inner < near)
    same = (side[1:-1] == side[:-2]) & (side[1:-1] == side[2:])
    return (1 + np.flatnonzero(least & same)).tolist()


def _root(f: Callable[[float], float], low: float, high: float) -> float:
    before, behind = f(low), f(high)
    if before == 0:
        return low
    if np.sign(before) == np.sign(behind):  # a root on the grid, up to rounding
        return high if abs(behind) < abs(before) else low
    return float(scipy.optimize.brentq(f, low, high, xtol=EXACT * high, rtol=4 * EXACT))


def _static(loop: DelayedLoop, near: complex) -> float:
    """L at frequency zero; 0 where it has no end there, for then no real pole crosses at one. near: L close by."""
    a, early, late = loop.transition
    la, lb, lc, ld = loop.law_matrices
    if np.abs(np.concatenate(loop.poles) - 1).min() < WIDTH:
        return 0.0
    value = float(loop.plant.C @ np.linalg.solve(np.eye(len(a)) - a, early + late))
    value *= ld + float(lc @ np.linalg.solve(np.eye(len(la)) - la, lb)) if len(la) else ld
    return value if abs(value - near) < SAME * abs(value) else 0.0
