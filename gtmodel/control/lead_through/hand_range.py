"""Stability of lead-through with a person's hand on the handle, over a range of impedances, from eigenvalues."""

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

SEARCHES = 3  # local searches from the worst points
STIFFEST = 1e6  # [N/m], end of the search
ALONG = 40  # hands with other masses and dampings at each stiffness
HALVINGS = 9  # of a step of 30 %: the stiffness limit is accurate to a thousandth


@dataclass(frozen=True, eq=False)
class HandStability:
    """least: damping ratio of the least damped pole over the range; negative if a hand makes the loop unstable.

    worst: the hand with this pole. frequency [Hz]: of this pole, which identifies the mode. stable: whether the loop is
    stable with all tested hands. stiffness_limit: [N/m] up to which the loop is stable with all tested hands that have
    masses and dampings of the range.
    """

    least: float
    worst: Hand
    frequency: float
    stable: bool
    stiffness_limit: float


def hand_matrix(
    hand: Hand, gains: SurfaceGains, servo: ServoChain, turning: TurningGains | None = None, arm: float = 0.0
) -> np.ndarray:
    """Return the matrix (n, n) of the sampled loop of law, servo and hand, along one guided direction.

    turning, arm [m]: if the handle also turns the tool, about a tool centre point at this distance from the grip. The
    states, axis by axis, are the position of the grip, the servo's other states, pending commands, and the guided
    velocity; positions that exert no force on the hand are left out.

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
    force = np.zeros(size)  # of the hand
    for j, (_, _, lever) in enumerate(axes):
        first = j * each
        force[first] -= hand.stiffness * lever
        force[first + 1] -= hand.damping * lever
        force[first : first + n] -= hand.mass * lever * loop.plant.A[1]
        force[first + n + whole] -= hand.mass * lever * loop.plant.B[1]
    for j, (mass, damping, lever) in enumerate(axes):
        first, last = j * each, (j + 1) * each - 1
        z[first : first + n, first : first + n] = a
        z[first : first + n, first + n + whole] += early
        z[first : first + n, last if whole == 0 else first + n + whole - 1] += late
        z[first + n, last] = 1.0
        for age in range(whole):
            z[first + n + age + 1, first + n + age] = 1.0
        z[last, last] = 1.0 - gains.cycle / mass * damping
        z[last] += gains.cycle / mass * lever * force
    positions = np.arange(count) * each
    if count > 1:
        levers = np.array([lever for _, _, lever in axes])
        basis = np.eye(size)
        grip = levers / np.linalg.norm(levers)
        basis[np.ix_(positions, positions)] = np.column_stack([grip, scipy.linalg.null_space([levers])])
        z = basis.T @ z @ basis
    states = np.delete(np.arange(size), positions if hand.stiffness == 0 else positions[1:])
    return z[np.ix_(states, states)]


def least_damped(matrix: np.ndarray) -> tuple[float, float]:
    """Return the damping ratio of the least damped pole of a sampled loop, negative if unstable, and its undamped
    frequency [rad per cycle]."""
    poles = np.linalg.eigvals(matrix)
    continuous = continuous_poles(poles[np.abs(poles) > np.finfo(float).tiny], 1.0)
    ratios = frequency_and_damping(continuous)[1]
    least = int(np.argmin(ratios))
    return float(ratios[least]), float(np.abs(continuous[least]))


def hand_stability(
    gains: SurfaceGains,
    servo: ServoChain,
    hands: HandRange | None = None,
    turning: TurningGains | None = None,
    arm: float = 0.0,
) -> HandStability:
    """Find the least damped pole over a range of hands: all vertices, random hands, local searches from the worst.

    The result is not a proven bound. In contact, directions along a surface behave as in free space, because the hand
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
    least, worst = float(values[order[0]]), shares[order[0]]
    for begin in shares[order[:SEARCHES]]:
        search = scipy.optimize.minimize(
            lambda s: damping(within(s)), begin, method="Nelder-Mead", bounds=[(0.0, 1.0)] * 3
        )
        if float(search.fun) < least:
            least, worst = float(search.fun), search.x

    def stable(stiffness: float) -> bool:
        rows = np.array([within(s) for s in shares[:ALONG]])  # the first are vertices
        rows[:, 2] = stiffness
        return all(damping(x) > 0 for x in rows)

    hand = _hand(within(worst))
    turns = least_damped(hand_matrix(hand, gains, servo, turning, arm))[1]
    return HandStability(least, hand, turns / (2 * np.pi * gains.cycle), least > 0, _last(stable, float(low[2])))


def _last(stable: Callable[[float], bool], low: float) -> float:
    """The greatest stable stiffness from `low` upwards; 0 if `low` is unstable."""
    if not stable(max(low, 1.0)):
        return 0.0
    bottom = max(low, 1.0)
    top = bottom
    while top < STIFFEST and stable(top):
        bottom, top = top, 1.3 * top
    return float(bisected(stable, bottom, top, HALVINGS)[0]) if top < STIFFEST else bottom


def _hand(values: np.ndarray) -> Hand:
    return Hand(*(float(x) for x in values))


def damping_curves(
    gains: SurfaceGains, servo: ServoChain, hands: HandRange, points: int = 60
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return stiffnesses (points,) of a hand, beyond its range, and the least damping ratio of the loop, by mass."""
    stiffness = np.geomspace(50.0, 20.0 * max(hands.stiffness[1], 50.0), points)
    middle = sum(hands.damping) / 2
    return stiffness, {
        f"{m:g} kg, {middle:g} N s/m": np.array(
            [least_damped(hand_matrix(Hand(m, middle, float(k)), gains, servo))[0] for k in stiffness]
        )
        for m in dict.fromkeys(hands.mass)
    }
