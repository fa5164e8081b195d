"""Roots in one variable: zeros of continuous functions, and thresholds of conditions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy


def crossing(function: Callable[[float], float], low: float, high: float, rtol: float) -> tuple[float, float]:
    """Bracket a zero of a continuous function by Brent's method, to a relative width of at most `rtol`.

    Returns the largest evaluated number below and the smallest above the zero; both are the same number if the function
    is exactly zero there. Raises ValueError unless the signs at the ends differ.

    >>> from gtmodel.linear.roots import crossing
    >>> below, above = crossing(lambda x: x * x - 2.0, 1.0, 2.0, 1e-3)
    >>> below <= 2.0**0.5 <= above, above - below < 2e-3
    (True, True)
    """
    values: dict[float, float] = {}

    def recorded(x: float) -> float:
        values[x] = function(x)
        return values[x]

    root = scipy.optimize.brentq(recorded, low, high, xtol=np.finfo(float).tiny, rtol=rtol)
    if values[root] == 0:
        return root, root
    side = np.sign(values[low])
    return max(x for x in values if np.sign(values[x]) == side), min(x for x in values if np.sign(values[x]) != side)


def bisected(holds: Callable[[Any], Any], low: Any, high: Any, halvings: int) -> tuple[Any, Any]:
    """Bisect between `low`, where a condition holds, and `high`, where it does not; return the final interval.

    low, high: numbers, or arrays that are bisected entry by entry; `holds` is called with the midpoints and returns a
    truth value for each. If the condition is the sign of a continuous function, `crossing` is faster.

    >>> from gtmodel.linear.roots import bisected
    >>> low, high = bisected(lambda x: x * x < 2.0, 0.0, 2.0, 20)
    >>> bool(low < 2.0**0.5 < high), float(high - low) == 2.0**-19
    (True, True)
    """
    for _ in range(halvings):
        middle = (low + high) / 2
        true = holds(middle)
        low, high = np.where(true, middle, low)[()], np.where(true, high, middle)[()]
    return low, high
