"""Whether lead-through stays stable in a person's hand: a declared range of impedances, by eigenvalues."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy

from ...linear.roots import bisected
from ...linear.state_space import continuous_poles, frequency_and_damping
from .gains import Hand, SurfaceGains, TurningGains
from .options import HANDS_BY, HandRange, ServoChain
from .tool_run import force_loop

SEARCHES = 3  # from the worst points
STIFFEST = 1e6  # [N/m], of a hand that is looked for
ALONG = 40  # hands of other masses and dampings at each stiffness
HALVINGS = 9  # of a step of 30 %: the stiffness limit is found to a thousandth


@dataclass(frozen=True, eq=False)
class HandStability:
    """least: damping ratio of the least damped pole over the range; below 0 a hand in the range makes it unstable.

    worst: the hand of it. frequency [Hz]: of that pole, by which its mode is known. stable: whether all hands tried
    are. stiffness_limit: [N/m] up to it all hands with masses and dampings of the range are stable, as far as they were
    tried.
    """

    least: float
    worst: Hand
    frequency: float
    stable: bool
    stiffness_limit: float


def hand_matrix(
    hand: Hand, gains: SurfaceGains, servo: ServoChain, turning: TurningGains | None = None, arm: float = 0.0
) -> np.ndarray:
    """The sampled loop of law, servo and a hand, along one direction in which the hand guides: its matrix (n, n).

    turning, arm [m]: where the handle turns the tool, about a tool centre point that far from the grip. States are
    position of the grip, the servo's others, commands on their way, and the guided velocity, axis by axis; positions
    that the hand does not feel are left out.

    >>> L = gt.control.lead_through
    >>> z = L.hand_matrix(L.Hand(), L.SurfaceGains(), L.ServoChain())
    >>> bool(np.abs(np.linalg.eigvals(z)).max() < 1.0)
    True
    """
    axes = [(gains.mass, gains.damping, 1.0)]
    if turning is not None and turning.by_handle and arm:
        axes.append((turning.inertia, turning.damping, arm))
    loop = force_loop(servo, gains.cycle)
    (whole, _), (a, early, late), n = loop.split, loop.transition, len(loop.plant)
    each, count = n + whole + 2, len(axes)
    size = each * count
    z = np.zeros((size, size))
    felt = np.zeros(size)  # force of the hand
    for j, (_, _, lever) in enumerate(axes):
        at = j * each
        felt[at] -= hand.stiffness * lever
        felt[at + 1] -= hand.damping * lever
        felt[at : at + n] -= hand.mass * lever * loop.plant.A[1]
        felt[at + n + whole] -= hand.mass * lever * loop.plant.B[1]
    for j, (mass, damping, lever) in enumerate(axes):
        at, own = j * each, (j + 1) * each - 1
        z[at : at + n, at : at + n] = a
        z[at : at + n, at + n + whole] += early
        z[at : at + n, own if whole == 0 else at + n + whole - 1] += late
        z[at + n, own] = 1.0
        for age in range(whole):
            z[at + n + age + 1, at + n + age] = 1.0
        z[own, own] = 1.0 - gains.cycle / mass * damping
        z[own] += gains.cycle / mass * lever * felt
    places = np.arange(count) * each
    levers = np.array([lever for _, _, lever in axes])
    basis = np.eye(size)
    grip = levers / np.linalg.norm(levers)
    basis[np.ix_(places, places)] = np.column_stack([grip, scipy.linalg.null_space([levers])])
    kept = np.delete(np.arange(size), places if hand.stiffness == 0 else places[1:])
    return (basis.T @ z @ basis)[np.ix_(kept, kept)]


def least_damped(matrix: np.ndarray) -> tuple[float, float]:
    """Damping ratio of the least damped pole of a sampled loop, below 0 where it is unstable; and how far it turns in a
    cycle [rad], undamped."""
    poles = np.linalg.eigvals(matrix)
    turns = continuous_poles(poles[np.abs(poles) > np.finfo(float).tiny], 1.0)
    ratios = frequency_and_damping(turns)[1]
    at = int(np.argmin(ratios))
    return float(ratios[at]), float(np.abs(turns[at]))


def hand_stability(
    gains: SurfaceGains,
    servo: ServoChain,
    hands: HandRange | None = None,
    turning: TurningGains | None = None,
    arm: float = 0.0,
) -> HandStability:
    """The least damped pole over a range of hands: all vertices, random hands, and local searches from the worst.

    It is what this has seen, not a proof. In contact the directions along a surface are those of free space: the hand
    does not guide along the normal.

    >>> L = gt.control.lead_through
    >>> seen = L.hand_stability(L.SurfaceGains(), L.ServoChain())
    >>> seen.stable, bool(seen.stiffness_limit > 800.0)
    (True, True)
    """
    hands = hands or HandRange()
    low = np.array([getattr(hands, name)[0] for name in HANDS_BY])
    high = np.array([getattr(hands, name)[1] for name in HANDS_BY])
    shares = np.concatenate(
        [np.array(list(product((0.0, 1.0), repeat=3))), np.random.default_rng(hands.seed).random((hands.draws, 3))]
    )

    def damping(values: np.ndarray) -> float:
        return least_damped(hand_matrix(_hand(values), gains, servo, turning, arm))[0]

    def within(share: np.ndarray) -> np.ndarray:
        return low + np.clip(share, 0.0, 1.0) * (high - low)

    values = np.array([damping(within(s)) for s in shares])
    order = np.argsort(values, kind="stable")
    least, at = float(values[order[0]]), shares[order[0]]
    for begin in shares[order[:SEARCHES]]:
        ended = scipy.optimize.minimize(
            lambda s: damping(within(s)), begin, method="Nelder-Mead", bounds=[(0.0, 1.0)] * 3
        )
        if float(ended.fun) < least:
            least, at = float(ended.fun), ended.x

    def holds(stiffness: float) -> bool:
        tried = np.array([within(s) for s in shares[:ALONG]])  # the first are vertices
        tried[:, 2] = stiffness
        return all(damping(x) > 0 for x in tried)

    worst = _hand(within(at))
    turns = least_damped(hand_matrix(worst, gains, servo, turning, arm))[1]
    return HandStability(least, worst, turns / (2 * np.pi * gains.cycle), least > 0, _last(holds, float(low[2])))


def _last(holds: Callable[[float], bool], low: float) -> float:
    """The greatest stiffness from `low` upwards that holds; 0 where the first does not."""
    if not holds(max(low, 1.0)):
        return 0.0
    bottom = max(low, 1.0)
    top = bottom
    while top < STIFFEST and holds(top):
        bottom, top = top, 1.3 * top
    return float(bisected(holds, bottom, top, HALVINGS)[0]) if top < STIFFEST else bottom


def _hand(values: np.ndarray) -> Hand:
    return Hand(*(float(x) for x in values))


def damping_curves(
    gains: SurfaceGains, servo: ServoChain, hands: HandRange, points: int = 60
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Stiffnesses (points,) of a hand up to beyond its range, and the least damping ratio of its loop, by its mass."""
    at = np.geomspace(50.0, 20.0 * max(hands.stiffness[1], 50.0), points)
    middle = sum(hands.damping) / 2
    return at, {
        f"{m:g} kg, {middle:g} N s/m": np.array(
            [least_damped(hand_matrix(Hand(m, middle, float(k)), gains, servo))[0] for k in at]
        )
        for m in dict.fromkeys(hands.mass)
    }
