"""Whether a cut chatters, and to which depth it is known not to, by semi-discretisation of the delayed equations
(Insperger and Stepan)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..linear.roots import crossing
from ..linear.state_space import held, second_order
from .cutter import Cut, Cutter, immersion, tooth_frequency
from .floquet import TooSlowError, multipliers, teeth_by_delay
from .forces import directional_matrix, plane
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


DEEPEST = 1.0  # m; beyond it no limit is looked for
STEP = 1.2  # ratio of one depth that is tried to the next
# with a helix, islands of period doubling lie between multiples of the teeth's axial pitch, parts of it deep: finer
# steps, up to some multiples, beyond which the force hardly changes with the angle any more
HELIX_STEPS, HELIX_PITCHES = 16, 4
PROBES = 6  # of such a peak
TOLERANCE = 1e-3  # relative, of the place of such a peak
CLOSE = 1e-5  # relative, of a limit
EDGE = 1e-9  # rad, beside an angle where a tooth enters or leaves


def spectral_radius(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), intervals: int | None = None,
) -> float:  # fmt: skip
    """Largest modulus of the Floquet multipliers over one tooth period: below 1 the cut is stable.

    The first pose counts. Helix and pitch are included (with uneven pitch it is the growth over a turn, per tooth),
    runout is not; speed [1/s] of the spindle. The method is Gauss collocation, good to some 1e-6; with `intervals` it
    is semi-discretisation, for even pitch only. Raises ValueError for impossible values, and for a spindle so slow that
    more than 300 nodes are needed.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> radius = gt.milling.spectral_radius(robot, cutter, cut, speed=25.0, feed=[1.0, 0.0, 0.0])
    >>> round(radius, 3)  # above 1: it chatters
    1.059
    """
    if intervals is not None:
        return semi_discretised_radius(oscillators, cutter, cut, speed, feed, up=up, intervals=intervals)
    P = plane(feed, up)
    values = multipliers(oscillators, cutter, cut.mode, cut.radial_depth, cut.axial_depth, speed, P)
    period, _ = teeth_by_delay(cutter)
    return float(np.abs(values).max() ** (2 * np.pi / (cutter.teeth * period)))


def stable_depth(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), low: float, high: float, intervals: int | None = None, tolerance: float = 1e-3,
) -> float:  # fmt: skip
    """Greatest axial depth [m] between low and high found stable, by Brent's method to a relative tolerance.

    Raises ValueError unless `low` is stable and `high` is not.

    >>> from gtmodel.milling import CuttingCoefficients, Cut, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> cut = Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> depth = gt.milling.stable_depth(robot, cutter, cut, speed=25.0, feed=[1.0, 0.0, 0.0], low=1e-4, high=5e-3)
    >>> round(1e3 * depth, 2)  # [mm]
    0.77
    """

    @cache
    def radius(depth: float) -> float:
        deeper = replace(cut, axial_depth=depth)
        return spectral_radius(oscillators, cutter, deeper, speed, feed, up=up, intervals=intervals)

    if radius(low) >= 1 or radius(high) < 1:
        raise ValueError(f"expected a stable depth and an unstable one; found {radius(low):.3g} at {low:g} m and "
                         f"{radius(high):.3g} at {high:g} m")  # fmt: skip
    return crossing(lambda depth: np.log(radius(depth)), low, high, tolerance)[0]


def certain_depth(
    oscillators: Oscillators, cutter: Cutter, mode: str, radial_depth: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0),
) -> float:  # fmt: skip
    """Axial depth [m] below which the first pose is stable at every speed: 1 / (2 sup |D| sup |H|).

    It follows from the small-gain theorem: |x - x before| is at most twice |x| over all time, so a deflection shrinks
    each time that it goes round the loop of tool and cut. It holds for any helix and any pitch, and lies below the true
    limit by a factor of some 3 to 30. Raises ValueError for a radial depth beyond the diameter.

    >>> from gtmodel.milling import CuttingCoefficients, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> depth = gt.milling.certain_depth(robot, cutter, "climb", radial_depth=0.006, feed=[1.0, 0.0, 0.0])
    >>> round(1e3 * depth, 3)  # [mm]
    0.047
    """
    start, end = immersion(mode, radial_depth, cutter.diameter)
    angles = cutter.angles
    phi = np.concatenate([np.linspace(0, 2 * np.pi, 1441), start - angles, end - angles])
    largest = 0.0
    for beside in (-EDGE, EDGE):
        D = sum(np.linalg.norm(directional_matrix(cutter, phi + beside + a, start, end), 2, axis=(1, 2))
                for a in angles)  # fmt: skip
        largest = max(largest, float(np.max(D)))
    P = plane(feed, up)
    zeta = np.minimum(oscillators.damping_ratio[0], np.sqrt(0.5))
    # no axis passes its own peak
    peak = 1 / (oscillators.k[0] * 2 * zeta * np.sqrt(1 - zeta**2))
    return 1 / (2 * largest * float(peak[(P**2).sum(axis=0) > EDGE].max()))


def proven_depth(
    oscillators: Oscillators, cutter: Cutter, mode: str, radial_depth: float, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), deepest: float = DEEPEST,
) -> float:  # fmt: skip
    """Axial depth [m], `deepest` at most, up to which the first pose is found stable at a speed [1/s].

    Depths are tried by their spectral radius from `certain_depth` on, each a fifth or, with a helix, a 16th of the
    teeth's axial pitch deeper than the one before, and between them where the radius peaks near 1; the first that is
    unstable is approached to a part in 100,000. For a spindle too slow for that it is `certain_depth`. Raises
    ValueError for impossible values.

    >>> from gtmodel.milling import CuttingCoefficients, Cutter
    >>> cutter = Cutter(0.02, 2, CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8))  # diameter [m], teeth
    >>> robot = gt.milling.Oscillators.with_damping_ratio(m=[350, 350, 250], k=[2e6, 1.5e6, 3e6], zeta=[0.03] * 3)
    >>> depth = gt.milling.proven_depth(robot, cutter, "climb", radial_depth=0.006, speed=25.0, feed=[1.0, 0.0, 0.0])
    >>> round(1e3 * depth, 2)  # [mm]
    0.77
    """
    tooth_frequency(speed, cutter.teeth)
    low = certain_depth(oscillators, cutter, mode, radial_depth, feed, up=up)
    P = plane(feed, up)

    @cache
    def radius(depth: float) -> float:
        return float(np.abs(multipliers(oscillators, cutter, mode, radial_depth, depth, speed, P)).max())

    if deepest <= low:
        return deepest
    tried: list[tuple[float, float]] = []
    for depth in _depths(cutter, low, deepest):
        try:
            tried.append((depth, radius(depth)))
            high = _unstable(tried, radius)
        except TooSlowError:  # too many nodes: nothing is proven from here on
            return tried[-1][0] if tried else low
        if high is not None:
            below = [depth for depth, _ in tried if depth < high[0]]
            return crossing(lambda x: np.log(radius(x)), below[-1], high[0], CLOSE)[0] if below else low
    return deepest


def _depths(cutter: Cutter, low: float, deepest: float) -> list[float]:
    """From one depth to the other [m], both included."""
    depths = np.geomspace(low, deepest, 2 + int(np.log(deepest / low) / np.log(STEP)))
    lag = cutter.lag(1.0)
    if lag == 0:
        return depths.tolist()
    pitch = 2 * np.pi / cutter.teeth / lag
    fine = pitch / HELIX_STEPS * np.arange(1, HELIX_STEPS * HELIX_PITCHES + 1)
    steps = np.diff(depths)
    # only where a fifth is more than a step of the helix
    wide = fine[(fine > low) & (fine < deepest) & (steps[np.searchsorted(depths, fine).clip(1, len(steps)) - 1]
                                                   > pitch / HELIX_STEPS)]  # fmt: skip
    return np.union1d(depths, wide).tolist()


def _unstable(tried: list[tuple[float, float]], radius: Callable[[float], float]) -> tuple[float, float] | None:
    """A depth found unstable and its radius: the last tried, or a peak of the radius about the one before it."""
    if not tried[-1][1] < 1:
        return tried[-1]
    if len(tried) < 3:
        return None
    (a, r0), (_, r1), (b, r2) = tried[-3:]
    # a peak rises above its middle by less than the steeper side does
    if not (r1 > r0 and r1 > r2 and 2 * r1 - min(r0, r2) >= 1):
        return None
    peak: Any = scipy.optimize.minimize_scalar(lambda x: -radius(float(x)), bounds=(a, b), method="bounded",
                                options={"xatol": TOLERANCE * a, "maxiter": PROBES})  # fmt: skip
    return (float(peak.x), float(-peak.fun)) if -peak.fun >= 1 else None
