"""The least gain limit of a loop whose plant and delay are known within limits only, and a gain safe for many."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from itertools import product

import numpy as np
import scipy

from ...results import ArgumentError
from .limit import gain_limit
from .loop import DelayedLoop

DRAWS = 1000
MOST_SIDES = 12  # of a box: it has 2 to their power vertices
SEARCHES = 3  # from the worst points
APART = 0.2  # of a side of the box: between the points from which searches begin
NEAR = 1e-9  # relative, of a search
ON_GRID = 1e-9  # of a step: a limit within rounding of a multiple of the step is that multiple


@dataclass(frozen=True, eq=False)
class WorstCase:
    """gain: least limit in the box; point: where. nominal: limit at its middle. limits (n,): of the random points of
    the box, from which no guarantee follows; the worst of all found may lie between vertices.
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
    """The least gain limit over a box of parameters: all vertices, random points, and local searches from the worst.

    Args:
        loop_of: the loop with these parameters.
        box: from and to of each, by name.
        limit_of: gain of a loop whose least is looked for: its limit, or one that keeps margins (`margin_limit`).
        draws: random points, uniform in the box; seed: of their draw.

    It is what this has seen, not a proof. Where a point's loop is unstable at the smallest gains already, its limit is
    0. Raises ArgumentError for an empty box, one of more than twelve sides, limits that are not finite or in the wrong
    order, and what `loop_of` refuses.

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
            raise ArgumentError(f"'{name}' goes from {low:g} to {high:g}; expected finite numbers, rising", "box")
    if draws < 1:
        raise ArgumentError(f"expected at least 1; found {draws}", "draws")
    names, low, high = list(box), np.array([b[0] for b in box.values()]), np.array([b[1] for b in box.values()])

    def limit(share: np.ndarray) -> float:
        values = low + np.clip(share, 0.0, 1.0) * (high - low)
        loop = loop_of(dict(zip(names, values.tolist(), strict=True)))
        try:
            return limit_of(loop)
        except ArgumentError:  # no gain is small enough: what else it refuses, DelayedLoop has refused before
            return 0.0

    shares = np.random.default_rng(seed).random((draws, len(names)))
    drawn = np.array([limit(s) for s in shares])
    corners = np.array(list(product((0.0, 1.0), repeat=len(names))))
    tried = np.concatenate([corners, shares])
    limits = np.concatenate([[limit(s) for s in corners], drawn])
    order = np.argsort(limits, kind="stable")
    best, at = float(limits[order[0]]), tried[order[0]]
    for begin in tried[_apart(tried[order], order)] if best > 0 else ():
        ended = scipy.optimize.minimize(
            limit, begin, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(names),
            options={"fatol": NEAR * min(best, 1e300), "xatol": 1e-6, "adaptive": len(names) > 4},
        )  # fmt: skip
        if float(ended.fun) < best:
            best, at = float(ended.fun), np.clip(ended.x, 0.0, 1.0)
    point = dict(zip(names, (low + at * (high - low)).tolist(), strict=True))
    return WorstCase(best, point, limit(np.full(len(names), 0.5)), drawn)


def _apart(points: np.ndarray, order: np.ndarray) -> list[int]:
    """Which of the points, best first, searches begin from: each further from the ones before than `APART`."""
    chosen: list[int] = []
    for i in range(len(points)):
        if all(np.abs(points[i] - points[j]).max() > APART for j in chosen):
            chosen.append(i)
        if len(chosen) == SEARCHES:
            break
    return order[chosen].tolist()


def recommended_gain(limit: float, step: float) -> float:
    """The greatest multiple of `step` that is not above a gain limit; infinite where nothing limits it.

    Give a limit that holds at the worst point and keeps margins, such as `worst_case(..., limit_of=...)`: below a
    quantile of limits some of the loops are unstable. A limit of 0 says that no gain is safe. Raises ArgumentError for
    a limit below 0 or a step that is not positive.

    >>> gt.control.delayed.recommended_gain(0.0212, step=0.01)
    0.02
    """
    if not limit >= 0:
        raise ArgumentError(f"expected a number, at least 0; found {limit!r}", "limit")
    if not (np.isfinite(step) and step > 0):
        raise ArgumentError(f"must be a number above 0; found {step!r}", "step")
    return float(Decimal(int(np.floor(limit / step + ON_GRID))) * Decimal(repr(step))) if np.isfinite(limit) else np.inf
