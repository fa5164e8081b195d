"""Floquet multipliers of regenerative milling: the delayed equations by Gauss collocation over one period.

Between the angles at which a tooth's tip or upper end enters or leaves, displacements are polynomials on elements
short against the fastest mode that matters; where nothing cuts, motion is exact. Errors fall with the order of the
elements, twice NODES at their ends.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import leggauss

from .cutter import Cutter, immersion, tooth_frequency
from .forces import STRAIGHT, directional_antiderivative, directional_matrix
from .oscillators import Oscillators

NODES = 8  # of each element
CYCLES = 1.2  # of the fastest mode in an element at most: multipliers good to 1e-6
ANGLE = 1.2  # rad of the spindle in an element at most
MOST = 300  # nodes in a period: more are seconds for the eigenvalues at one depth
STIFF = 1000.0  # times the least dynamic stiffness c w in the plane of the cut: a mode beyond it does not matter
TINY = 1e-9  # rad: shorter pieces of a period are none
EVEN = 1e-12  # relative: pitches that differ by less are even


class TooSlowError(ValueError):
    """A period needs more nodes than are taken."""


class EqualDelayTeeth(NamedTuple):
    """Teeth that meet what was left at the same `delay` [rad] of the spindle before: their angles [rad]."""

    delay: float
    angles: np.ndarray


class TimeElement(NamedTuple):
    """From angle `start` to `end` [rad] of the period; number of its nodes' first, -1 where nothing cuts."""

    start: float
    end: float
    first: int


def multipliers(
    oscillators: Oscillators, cutter: Cutter, mode: str, radial_depth: float, depth: float, speed: float, P: np.ndarray
) -> np.ndarray:
    """Floquet multipliers (some,) of the first pose at an axial depth [m] and a speed [1/s], over one tooth period
    with even pitch, else over one turn; P (2, 3): feed and transverse direction, world coordinates.

    Helix and pitch included; teeth out of the cut by runout are not. Raises ValueError for impossible values and for
    a spindle so slow that a period needs more than 300 nodes.
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
                # only teeth in cut: where others stood before, nothing need have cut and no displacement is held
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
    """Angle of the period [rad] and the teeth by delay: one tooth period and one group where the pitch is even."""
    pitch = cutter.pitch
    if np.ptp(pitch) <= EVEN * 2 * np.pi:
        return 2 * np.pi / cutter.teeth, [EqualDelayTeeth(2 * np.pi / cutter.teeth, cutter.angles)]
    return 2 * np.pi, [EqualDelayTeeth(float(p), cutter.angles[i : i + 1]) for i, p in enumerate(pitch)]


def mean_over_helix(cutter: Cutter, at: np.ndarray, lag: float, span: tuple[float, float]) -> np.ndarray:
    """D (..., 2, 2) [N/m2] of a tooth whose tip is at angles (...) [rad], averaged over the depth's lag [rad]."""
    shape, at = at.shape, at.ravel()
    if lag < STRAIGHT:
        return directional_matrix(cutter, at - lag / 2, *span).reshape(*shape, 2, 2)
    ends = directional_antiderivative(cutter, at, span), directional_antiderivative(cutter, at - lag, span)
    return ((ends[0] - ends[1]) / lag).reshape(*shape, 2, 2)


class _Step(NamedTuple):
    """Of an element: over (6, 6) of the free state (x and v/w by axis), exact; free (2 nodes, 6) of displacements at
    the nodes. From the force at the nodes (2 nodes), by direction and node: end (6, ...), K (2 nodes, ...)."""

    over: np.ndarray
    end: np.ndarray
    K: np.ndarray
    free: np.ndarray


def _step(o: Oscillators, length: float, P: np.ndarray) -> _Step:
    m, c, k = o.m[0], o.c[0], o.k[0]
    h, damped = (np.sqrt(k / m) * length)[:, None, None], (c / np.sqrt(k * m))[:, None, None]
    # each mode in its own time: x'' + damped x' + x = F/k
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
    )  # also where nothing cuts
    end = np.einsum("aij,ra->airj", last[..., 2:], P / k)
    K = np.einsum("ra,sa,aij->risj", P, P / k, x[..., 2:])
    free = np.einsum("ra,aij->riaj", P, x[..., :2])
    n = 2 * NODES
    return _Step(over.reshape(6, 6), end.reshape(6, n), K.reshape(n, n), free.reshape(n, 6))


def _elements(
    o: Oscillators, cutter: Cutter, groups: list[EqualDelayTeeth], period: float, span: tuple[float, float],
    depth: float, turning: float, P: np.ndarray,
) -> list[TimeElement]:  # fmt: skip
    """Of one period. Raises ValueError for too many."""
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
                f"at {60 * turning / (2 * np.pi):.4g} rpm a mode at {hertz:.3g} Hz swings "
                f"{hertz * period / turning:.3g} times in a period of the cut, which needs more than {MOST} nodes: "
                "look at the least depth of the stability lobes"
            )
        ends = np.linspace(start, end, number + 1)
        for a, b in pairwise(ends):
            elements.append(TimeElement(a, b, first))
            first += NODES
    return elements


def _stiffness(cutter: Cutter) -> float:
    """Of the cut per depth [N/m2] if all teeth cut, as a scale."""
    return cutter.teeth * float(np.abs(cutter.coefficients.cutting[:2]).sum())


def _fastest(o: Oscillators, P: np.ndarray, added: float) -> float:
    """Frequency [Hz] of the fastest mode that matters, with the cut's stiffness [N/m] `added`."""
    moved = (P**2).sum(axis=0) > TINY
    m, c, k = o.m[0][moved], o.c[0][moved], o.k[0][moved]
    dynamic = c * np.sqrt(k / m)
    matters = dynamic <= STIFF * dynamic.min()
    return float(np.sqrt((k + added) / m)[matters].max()) / (2 * np.pi)


def _delayed(
    at: np.ndarray, elements: list[TimeElement], period: float, before: np.ndarray, now: np.ndarray
) -> np.ndarray:
    """(n, 2, ...) displacement at angles (n,) of this period, or below 0 of the one before."""
    delayed = []
    cutting = [e for e in elements if e.first >= 0]
    starts = np.array([e.start for e in cutting])
    for angle in at:
        past, angle = (before, angle + period) if angle < -TINY else (now, angle)
        e = cutting[max(0, int(np.searchsorted(starts, angle + TINY, side="right")) - 1)]
        weights = _lagrange((angle - e.start) / (e.end - e.start))
        delayed.append(np.tensordot(weights, past[e.first : e.first + NODES], 1))
    return np.array(delayed)


def _lagrange(x: float) -> np.ndarray:
    """(NODES,) weights of the nodes' values at x in 0 .. 1."""
    gap = x - _C
    near = int(np.argmin(np.abs(gap)))
    if abs(gap[near]) < 1e-12:
        return np.eye(NODES)[near]
    weights = _BARYCENTRIC / gap
    return weights / weights.sum()


def _gauss() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes c, weights b and integrals A of the nodes' polynomials from 0 to each node, of the interval 0 .. 1."""
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
