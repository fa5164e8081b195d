"""Stability of a cut and depths that are proven stable: the delay equations, with semi-discretisation (Insperger and
Stepan), and with Floquet multipliers from Gauss collocation over one period."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike

from ..linear.roots import crossing
from ..linear.state_space import held, second_order
from .cutter import Cut, Cutter, immersion, tooth_frequency
from .forces import STRAIGHT, directional_antiderivative, directional_matrix, plane
from .oscillators import Oscillators

NODES = 8  # per element
CYCLES = 1.2  # most cycles of the fastest mode in an element: multipliers accurate to 1e-6
ANGLE = 1.2  # most rad of the spindle in an element
MOST = 300  # nodes in a period: more would take seconds for the eigenvalues at one depth
STIFF = 1000.0  # a mode whose dynamic stiffness c w exceeds the least one by this factor is ignored
TINY = 1e-9  # rad: shorter pieces of a period are ignored
EVEN = 1e-12  # relative difference of pitches that count as even


class TooSlowError(ValueError):
    """The spindle is so slow that a period would need too many nodes."""


class EqualDelayTeeth(NamedTuple):
    """Teeth with equal `delay` [rad of the spindle] to the previous cut, and their angles [rad]."""

    delay: float
    angles: np.ndarray


class TimeElement(NamedTuple):
    """Element from angle `start` to `end` [rad] of the period; `first`: index of its first node, -1 without a cut."""

    start: float
    end: float
    first: int


def multipliers(
    oscillators: Oscillators, cutter: Cutter, mode: str, radial_depth: float, depth: float, speed: float, P: np.ndarray
) -> np.ndarray:
    """Return the Floquet multipliers (n,) of the first pose at an axial depth [m] and a speed [1/s], over one tooth
    period with even pitch, otherwise over one turn; P (2, 3): feed and transverse direction, world coordinates.

    Includes helix and pitch, but not runout. Raises ValueError for invalid values and for a spindle so slow that a
    period needs more than 300 nodes.
    """
    span = immersion(mode, radial_depth, cutter.diameter)
    tooth_frequency(speed, cutter.teeth)
    period, groups = teeth_by_delay(cutter)
    turning, lag = 2 * np.pi * speed, cutter.lag(depth)
    elements = _elements(oscillators, cutter, groups, period, span, depth, turning, P)
    nodes = sum(e.first >= 0 for e in elements) * NODES
    size = 6 + 2 * nodes
    state = np.eye(6, size)
    before = np.eye(2 * nodes, size, 6).reshape(nodes, 2, size)  # displacements at the nodes one period ago, and now
    now = np.empty_like(before)
    steps: dict[int, _Step] = {}
    stiffness = _stiffness(cutter)
    at_all = np.concatenate([e.start + _C * (e.end - e.start) for e in elements if e.first >= 0] or [np.zeros(0)])
    W_all = [depth * mean_over_helix(cutter, at_all[:, None] + teeth.angles, lag, span).sum(axis=1) for teeth in groups]
    for e in elements:
        length = (e.end - e.start) / turning
        key = round(length / (TINY * period / turning))  # equal elements differ by rounding
        if key not in steps:
            steps[key] = _step(oscillators, length, P)
        step = steps[key]
        if e.first < 0:
            state = step.over @ state
            continue
        rows = slice(e.first, e.first + NODES)
        push, pull = np.zeros((NODES, 2, 2)), np.zeros((NODES, 2, size))
        for teeth, W_teeth in zip(groups, W_all, strict=True):
            W = W_teeth[rows]
            push += W
            if teeth.delay == period:
                pull += W @ before[rows]
            elif np.abs(W).max() > TINY * depth * stiffness:
                # only cutting teeth: the displacement one delay earlier is stored only if a tooth was cutting then
                pull += W @ _delayed(at_all[rows] - teeth.delay, elements, period, before, now)
        # y = rest - K (push y - pull): rows by direction, then node
        W = np.zeros((2, NODES, 2, NODES))
        W[:, np.arange(NODES), :, np.arange(NODES)] = push
        W = W.reshape(2 * NODES, 2 * NODES)
        pull = pull.swapaxes(0, 1).reshape(2 * NODES, size)
        y = np.linalg.solve(np.eye(2 * NODES) - step.K @ W, step.free @ state - step.K @ pull)
        state = step.over @ state + step.end @ (W @ y - pull)
        now[rows] = y.reshape(2, NODES, size).swapaxes(0, 1)
    return np.linalg.eigvals(np.concatenate([state, now.reshape(2 * nodes, size)]))


def teeth_by_delay(cutter: Cutter) -> tuple[float, list[EqualDelayTeeth]]:
    """Return the angle of the period [rad] and the teeth by delay; even pitch: one tooth period and one group."""
    pitch = cutter.pitch
    if np.ptp(pitch) <= EVEN * 2 * np.pi:
        return 2 * np.pi / cutter.teeth, [EqualDelayTeeth(2 * np.pi / cutter.teeth, cutter.angles)]
    return 2 * np.pi, [EqualDelayTeeth(float(p), cutter.angles[i : i + 1]) for i, p in enumerate(pitch)]


def mean_over_helix(cutter: Cutter, angles: np.ndarray, lag: float, span: tuple[float, float]) -> np.ndarray:
    """Return D (..., 2, 2) [N/m2] of a tooth with its tip at angles (...) [rad], averaged over the lag [rad]."""
    shape, angles = angles.shape, angles.ravel()
    if lag < STRAIGHT:
        return directional_matrix(cutter, angles - lag / 2, *span).reshape(*shape, 2, 2)
    ends = directional_antiderivative(cutter, angles, span), directional_antiderivative(cutter, angles - lag, span)
    return ((ends[0] - ends[1]) / lag).reshape(*shape, 2, 2)


class _Step(NamedTuple):
    """Maps of an element. From the state at its start (x and v/w by axis): over (6, 6) to the state at its end, exact;
    free (2 nodes, 6) to the displacements at the nodes. From the force at the nodes (2 nodes), by direction and node:
    end (6, ...) to the state at the end, K (2 nodes, ...) to the displacements."""

    over: np.ndarray
    end: np.ndarray
    K: np.ndarray
    free: np.ndarray


def _step(o: Oscillators, length: float, P: np.ndarray) -> _Step:
    m, c, k = o.m[0], o.c[0], o.k[0]
    h, damped = (np.sqrt(k / m) * length)[:, None, None], (c / np.sqrt(k * m))[:, None, None]
    # each mode in scaled time: x'' + damped x' + x = F/k
    M = np.empty((3, 2 * NODES, 2 * NODES))
    M[:, :NODES, :NODES], M[:, :NODES, NODES:] = _ONE, -h * _A
    M[:, NODES:, :NODES], M[:, NODES:, NODES:] = h * _A, _ONE + damped * h * _A
    # columns: x and v at the start, force F/k at the nodes
    right = np.zeros((3, 2 * NODES, 2 + NODES))
    right[:, :NODES, 0] = right[:, NODES:, 1] = 1
    right[:, NODES:, 2:] = h * _A
    solution = np.linalg.solve(M, right)
    x, v = solution[:, :NODES], solution[:, NODES:]
    last = np.stack([_B @ (h * v), _B @ (-h * (x + damped * v))], axis=1)
    last[:, 1, 2:] += h[:, 0] * _B
    over = np.zeros((3, 2, 3, 2))
    over[np.arange(3), :, np.arange(3)] = scipy.linalg.expm(
        np.block([[0 * h, h], [-h, -damped * h]])
    )  # used also without a cut
    end = np.einsum("aij,ra->airj", last[..., 2:], P / k)
    K = np.einsum("ra,sa,aij->risj", P, P / k, x[..., 2:])
    free = np.einsum("ra,aij->riaj", P, x[..., :2])
    n = 2 * NODES
    return _Step(over.reshape(6, 6), end.reshape(6, n), K.reshape(n, n), free.reshape(n, 6))


def _elements(
    o: Oscillators, cutter: Cutter, groups: list[EqualDelayTeeth], period: float, span: tuple[float, float],
    depth: float, turning: float, P: np.ndarray,
) -> list[TimeElement]:  # fmt: skip
    """Return the elements of one period. Raises TooSlowError if there are too many nodes."""
    lag, angles = cutter.lag(depth), np.concatenate([teeth.angles for teeth in groups])
    edges = np.concatenate([(edge + late - angles) % period for edge in span for late in (0.0, lag)])
    edges = np.unique(np.concatenate([[0.0, period], edges]))
    edges = edges[np.append(True, np.diff(edges) > TINY)]
    edges[-1] = period
    middles = (edges[1:] + edges[:-1]) / 2
    size = np.abs(mean_over_helix(cutter, middles[:, None] + angles, lag, span)).max(axis=(2, 3)).sum(axis=1)
    cuts = size > TINY * _stiffness(cutter)
    hertz = _fastest(o, P, depth * float(np.max(size)))
    longest = min(ANGLE, CYCLES * turning / hertz, min(teeth.delay for teeth in groups))
    elements, first = [], 0
    for start, end, cut in zip(edges[:-1], edges[1:], cuts, strict=True):
        if not cut:
            elements.append(TimeElement(start, end, -1))
            continue
        number = int(np.ceil((end - start) / longest))
        if first + number * NODES > MOST:
            raise TooSlowError(
                f"at {60 * turning / (2 * np.pi):.4g} rpm a mode at {hertz:.3g} Hz has "
                f"{hertz * period / turning:.3g} cycles in a period of the cut, which needs more than {MOST} nodes: "
                "use the least depth of the stability lobes"
            )
        ends = np.linspace(start, end, number + 1)
        for a, b in pairwise(ends):
            elements.append(TimeElement(a, b, first))
            first += NODES
    return elements


def _stiffness(cutter: Cutter) -> float:
    """Return a scale of the cut's stiffness per depth [N/m2], with all teeth cutting."""
    return cutter.teeth * float(np.abs(cutter.coefficients.cutting[:2]).sum())


def _fastest(o: Oscillators, P: np.ndarray, added: float) -> float:
    """Return the frequency [Hz] of the fastest relevant mode, with the cut's stiffness [N/m] `added`."""
    moved = (P**2).sum(axis=0) > TINY
    m, c, k = o.m[0][moved], o.c[0][moved], o.k[0][moved]
    dynamic = c * np.sqrt(k / m)
    matters = dynamic <= STIFF * dynamic.min()
    return float(np.sqrt((k + added) / m)[matters].max()) / (2 * np.pi)


def _delayed(
    angles: np.ndarray, elements: list[TimeElement], period: float, before: np.ndarray, now: np.ndarray
) -> np.ndarray:
    """Return the displacement (n, 2, ...) at angles (n,) of this period; negative angles: of the previous period."""
    delayed = []
    cutting = [e for e in elements if e.first >= 0]
    starts = np.array([e.start for e in cutting])
    for angle in angles:
        past, angle = (before, angle + period) if angle < -TINY else (now, angle)
        e = cutting[max(0, int(np.searchsorted(starts, angle + TINY, side="right")) - 1)]
        weights = _lagrange((angle - e.start) / (e.end - e.start))
        delayed.append(np.tensordot(weights, past[e.first : e.first + NODES], 1))
    return np.array(delayed)


def _lagrange(x: float) -> np.ndarray:
    """Return interpolation weights (NODES,) of the nodes' values at x in 0 .. 1."""
    gap = x - _C
    near = int(np.argmin(np.abs(gap)))
    if abs(gap[near]) < 1e-12:
        return np.eye(NODES)[near]
    weights = _BARYCENTRIC / gap
    return weights / weights.sum()


def _gauss() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Gauss nodes c and weights b on 0 .. 1, and A, the integrals of the Lagrange basis from 0 to each node."""
    x, weights = leggauss(NODES)
    c = (x + 1) / 2
    A = np.empty((NODES, NODES))
    for j in range(NODES):
        others = np.delete(c, j)
        basis = Polynomial.fromroots(others).integ()
        A[:, j] = (basis(c) - basis(0.0)) / np.prod(c[j] - others)
    return c, weights / 2, A


_C, _B, _A = _gauss()
_ONE = np.eye(NODES)
_BARYCENTRIC = np.array([1 / np.prod(c - np.delete(_C, j)) for j, c in enumerate(_C)])


DISCS = 12
UNEVEN = 1e-9  # rad


def semi_discretised_radius(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), intervals: int,
) -> float:  # fmt: skip
    """Return the largest modulus of the Floquet multipliers over one tooth period: below 1 the cut is stable.

    First pose, even pitch, with helix; speed [1/s]. Within each of the `intervals` of a period the force coefficient
    and the delayed displacement are constant: 20 per cycle of the fastest mode are accurate to a percent. Raises
    ValueError for invalid values and uneven pitch.
    """
    period = 1 / tooth_frequency(speed, cutter.teeth)
    if np.ptp(cutter.pitch) > UNEVEN:
        raise ValueError("the pitch of the teeth is uneven; leave out `intervals`, which needs even pitch")
    if intervals < 4:
        raise ValueError(f"found {intervals} intervals; expected four or more")
    step, P = period / intervals, plane(feed, up)
    W = cut.axial_depth * np.einsum("ji,tjk,kl->til", P, mean_matrices(cutter, cut, intervals), P)
    m, c, k = (np.diag(x[0]) for x in (oscillators.m, oscillators.c, oscillators.k))
    A, B, _ = second_order(m, c, k - W, -W)
    free, regenerated = held(A, B, step)
    # columns: response to the initial state and to x at the last `intervals` grid times
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
    """Return directional matrices (intervals, 2, 2) [N/m2] over the tooth period, averaged over interval and helix."""
    start, end = immersion(cut.mode, cut.radial_depth, cutter.diameter)
    fine = 8
    phi = 2 * np.pi / cutter.teeth * (np.arange(intervals * fine) + 0.5) / (intervals * fine)
    lag = cutter.lag(cut.axial_depth) * (np.arange(DISCS) + 0.5) / DISCS
    means = np.zeros((intervals, 2, 2))
    for angle in 2 * np.pi * np.arange(cutter.teeth) / cutter.teeth:
        D = directional_matrix(cutter, phi[:, None] + angle - lag, start, end)
        means += D.reshape(intervals, fine * DISCS, 2, 2).mean(axis=1)
    return means


DEEPEST = 1.0  # m; deepest limit that is searched for
STEP = 1.2  # ratio of successive trial depths
# with a helix there are islands of period doubling, a fraction of the teeth's axial pitch deep, between its multiples:
# use finer steps for the first multiples; beyond these the force hardly changes with the angle
HELIX_STEPS, HELIX_PITCHES = 16, 4
PROBES = 6  # iterations for a peak of the radius
TOLERANCE = 1e-3  # relative tolerance of its depth
CLOSE = 1e-5  # relative tolerance of a limit
EDGE = 1e-9  # rad, next to an angle where a tooth enters or leaves


def spectral_radius(
    oscillators: Oscillators, cutter: Cutter, cut: Cut, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), intervals: int | None = None,
) -> float:  # fmt: skip
    """Return the largest modulus of the Floquet multipliers over one tooth period: below 1 the cut is stable.

    Uses the first pose, with helix and pitch (uneven pitch: growth over a turn, per tooth), without runout; speed [1/s]
    of the spindle. The method is Gauss collocation, accurate to about 1e-6; with `intervals` it is semi-discretisation,
    for even pitch only. Raises ValueError for invalid values, and for a spindle so slow that a period needs more than
    300 nodes.

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
    """Return the stability limit [m] between axial depths low and high, from Brent's method to a relative tolerance.

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
    """Return an axial depth [m] below which the first pose is stable at every speed: 1 / (2 sup |D| sup |H|).

    It follows from the small-gain theorem: the norm of x minus its delayed value is at most twice the norm of x, so the
    loop gain of tool and cut is below 1. It holds for any helix and pitch, and is below the true limit by a factor of
    about 3 to 30. Raises ValueError for a radial depth beyond the diameter.

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
    for side in (-EDGE, EDGE):
        D = sum(np.linalg.norm(directional_matrix(cutter, phi + side + a, start, end), 2, axis=(1, 2))
                for a in angles)  # fmt: skip
        largest = max(largest, float(np.max(D)))
    P = plane(feed, up)
    zeta = np.minimum(oscillators.damping_ratio[0], np.sqrt(0.5))
    # bound of each axis: its resonance peak
    peak = 1 / (oscillators.k[0] * 2 * zeta * np.sqrt(1 - zeta**2))
    return 1 / (2 * largest * float(peak[(P**2).sum(axis=0) > EDGE].max()))


def proven_depth(
    oscillators: Oscillators, cutter: Cutter, mode: str, radial_depth: float, speed: float, feed: ArrayLike, *,
    up: ArrayLike = (0.0, 0.0, 1.0), deepest: float = DEEPEST,
) -> float:  # fmt: skip
    """Return the axial depth [m], at most `deepest`, up to which the first pose is found stable at a speed [1/s].

    Evaluates the spectral radius from `certain_depth` on, at depths that grow by a fifth or, with a helix, by a 16th of
    the teeth's axial pitch, and in between if the radius peaks near 1. The first limit is found to a relative 1e-5. If
    the spindle is too slow for a depth, the last stable depth counts, at least `certain_depth`. Raises ValueError for
    invalid values.

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
    trials: list[tuple[float, float]] = []
    for depth in _depths(cutter, low, deepest):
        try:
            trials.append((depth, radius(depth)))
            high = _unstable(trials, radius)
        except TooSlowError:  # deeper cuts cannot be proven
            return trials[-1][0] if trials else low
        if high is not None:
            below = [depth for depth, _ in trials if depth < high[0]]
            return crossing(lambda x: np.log(radius(x)), below[-1], high[0], CLOSE)[0] if below else low
    return deepest


def _depths(cutter: Cutter, low: float, deepest: float) -> list[float]:
    """Return the trial depths [m], both ends included."""
    depths = np.geomspace(low, deepest, 2 + int(np.log(deepest / low) / np.log(STEP)))
    lag = cutter.lag(1.0)
    if lag == 0:
        return depths.tolist()
    pitch = 2 * np.pi / cutter.teeth / lag
    fine = pitch / HELIX_STEPS * np.arange(1, HELIX_STEPS * HELIX_PITCHES + 1)
    steps = np.diff(depths)
    # only if a fifth of the depth is more than a step of the helix
    wide = fine[(fine > low) & (fine < deepest) & (steps[np.searchsorted(depths, fine).clip(1, len(steps)) - 1]
                                                   > pitch / HELIX_STEPS)]  # fmt: skip
    return np.union1d(depths, wide).tolist()


def _unstable(trials: list[tuple[float, float]], radius: Callable[[float], float]) -> tuple[float, float] | None:
    """Return an unstable depth and its radius: the last trial, or a peak of the radius around the trial before."""
    if not trials[-1][1] < 1:
        return trials[-1]
    if len(trials) < 3:
        return None
    (a, r0), (_, r1), (b, r2) = trials[-3:]
    # a peak exceeds the middle value by less than the rise on its steeper side
    if not (r1 > r0 and r1 > r2 and 2 * r1 - min(r0, r2) >= 1):
        return None
    peak: Any = scipy.optimize.minimize_scalar(lambda x: -radius(float(x)), bounds=(a, b), method="bounded",
                                options={"xatol": TOLERANCE * a, "maxiter": PROBES})  # fmt: skip
    return (float(peak.x), float(-peak.fun)) if -peak.fun >= 1 else None
