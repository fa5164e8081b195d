"""Roots of one variable: where a continuous function crosses zero, and where a truth changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy


def crossing(function: Callable[[float], float], low: float, high: float, rtol: float) -> tuple[float, float]:
    """The last number below and the first above a zero of a continuous function, a part `rtol` of them apart at most,
    by Brent's method: the function was evaluated at both, and both are one number where it is zero there. Raises
    ValueError unless its signs at the ends differ.

    >>> from gtmodel.linear.roots import crossing
    >>> below, above = crossing(lambda x: x * x - 2.0, 1.0, 2.0, 1e-3)
    >>> below <= 2.0**0.5 <= above, above - below < 2e-3
    (True, True)
    """
    tried: dict[float, float] = {}

    def kept(x: float) -> float:
        tried[x] = function(x)
        return tried[x]

    root = scipy.optimize.brentq(kept, low, high, xtol=np.finfo(float).tiny, rtol=rtol)
    if tried[root] == 0:
        return root, root
    side = np.sign(tried[low])
    return max(x for x in tried if np.sign(tried[x]) == side), min(x for x in tried if np.sign(tried[x]) != side)


def bisected(holds: Callable[[Any], Any], low: Any, high: Any, halvings: int) -> tuple[Any, Any]:
    """`low`, where something holds, and `high`, where it does not, after so many halvings of the interval between.

    Numbers, or arrays whose entries are halved on their own: `holds` takes the middles and answers for each. For truths
    that are no sign of a continuous function; else take `crossing`, which is quicker.

    >>> from gtmodel.linear.roots import bisected
    >>> low, high = bisected(lambda x: x * x < 2.0, 0.0, 2.0, 20)
    >>> bool(low < 2.0**0.5 < high), float(high - low) == 2.0**-19
    (True, True)
    """
    for _ in range(halvings):
        middle = (low + high) / 2
        there = holds(middle)
        low, high = np.where(there, middle, low)[()], np.where(there, high, middle)[()]
    return low, high
