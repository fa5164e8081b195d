"""Across a jump of the inputs: what is not a state goes to the solution that its old one leads to."""

from __future__ import annotations

import numpy as np

from ..results.status import SolveStatus
from .ending import Ended
from .roots import TOUCH
from .systems import System

# roots are looked at in so many steps between the old and the new value of what jumps
STEPS = 64


def after_jump(
    system: System, x: np.ndarray, z: np.ndarray, time: float, before: np.ndarray, after: np.ndarray
) -> np.ndarray:
    """Newton unknowns after the tables' pieces change, followed from the old to the new values.

    Raises Ended where a solution turns back, or a root meets its other one, on the way.
    """
    if np.array_equal(before[1:], after[1:]):
        return z
    if system.roots and not _roots_go_on(system, x, z, time, before, after):
        labels = "; ".join(system.roots.labels[:4])
        raise _lost(time, labels)
    follower = system.follower
    if follower is None:
        return z
    followed = follower.follow(z, follower.place(x, time, before), follower.place(x, time, after))
    if followed is None:
        raise _lost(time, system.reduced.unknowns)
    return followed


def _roots_go_on(
    system: System, x: np.ndarray, z: np.ndarray, time: float, before: np.ndarray, after: np.ndarray
) -> bool:
    """Whether discriminants stay positive on the way; those that follow Newton unknowns are not asked."""
    if z.size:
        return True
    shares = np.linspace(0.0, 1.0, STEPS + 1)
    p = before[:, None] + shares * (after - before)[:, None]
    values = system.roots.values(x, z, time, p)
    a, b, c = values[:-2], values[1:-1], values[2:]
    # a touch between two steps: a minimum whose parabola goes through zero
    curve = a - 2 * b + c
    with np.errstate(divide="ignore", invalid="ignore"):
        lowest = np.where((b <= a) & (b <= c) & (curve > 0), b - (a - c) ** 2 / (8 * curve), b)
    return bool(np.all(values > 0) and np.all((lowest > TOUCH) | (lowest == b)))


def _lost(time: float, names: str) -> Ended:
    return Ended(
        SolveStatus.FAILED,
        f"the motion ends at {time:.6g} s, where an input jumps: {names} cannot be followed from its old to its new "
        "value, because the solution turns back or meets another one on the way; let it jump less far, or ramp it",
    )
