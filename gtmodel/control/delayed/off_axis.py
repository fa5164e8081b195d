"""Corrections along a direction between two axes whose plants are known."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ...results import ArgumentError
from .limit import gain_limit
from .loop import DelayedLoop
from .plants import CorrectedPlant, equivalent_plant, side_by_side

POINTS = 100  # limits along y at which the brackets are tested
EDGE = 1e-9  # relative tolerance of the ends of intervals


def off_axis_plant(x: CorrectedPlant, y: CorrectedPlant, angle: float) -> CorrectedPlant:
    """Return the plant at an `angle` [rad] from y towards x: sin^2 G_x + cos^2 G_y, without coupling between the axes.

    >>> stiff, soft = (gt.control.delayed.equivalent_plant(m, 40.0 * m, 1.2e4 * m, 0.004) for m in (4.0, 0.3))
    >>> len(gt.control.delayed.off_axis_plant(stiff, soft, np.pi / 4))  # states
    4
    """
    s, c = float(np.sin(angle)), float(np.cos(angle))
    return side_by_side([x, y], [s, c], [s, c])


def off_axis_limits(x: CorrectedPlant, y: CorrectedPlant, angles: ArrayLike, cycle: float, delay: float) -> np.ndarray:
    """Return gain limits (n,) at `angles` (n,) [rad] from y towards x; see `off_axis_plant` and `DelayedLoop`.

    >>> stiff, soft = (gt.control.delayed.equivalent_plant(m, 40.0 * m, 1.2e4 * m, 0.004) for m in (4.0, 0.3))
    >>> limits = gt.control.delayed.off_axis_limits(stiff, soft, np.deg2rad([0.0, 45.0, 90.0]), 0.004, 0.052)
    >>> (limits / limits[0]).round(2)  # the soft axis dominates: slightly less than 1 / cos^2
    array([ 1.  ,  1.86, 13.33])
    """
    rows = np.asarray(angles, float).reshape(-1).tolist()
    return np.array([gain_limit(DelayedLoop(off_axis_plant(x, y, a), cycle, delay)).gain for a in rows])


def plant_of_limit(frequency: float, damping_ratio: float, limit: float, cycle: float, delay: float) -> CorrectedPlant:
    """Return the oscillator with this natural frequency [Hz] and damping ratio [1] whose gain limit is `limit`.

    The equivalent mass follows from the limit, which is proportional to it. Raises ArgumentError if a number is not
    positive.

    >>> plant = gt.control.delayed.plant_of_limit(17.0, 0.06, limit=0.25, cycle=0.004, delay=0.052)
    >>> loop = gt.control.delayed.DelayedLoop(plant, 0.004, 0.052)
    >>> round(gt.control.delayed.gain_limit(loop).gain, 9)
    0.25
    """
    for name, value in (("frequency", frequency), ("damping_ratio", damping_ratio), ("limit", limit)):
        if not (np.isfinite(value) and value > 0):
            raise ArgumentError(f"must be a number above 0; found {value!r}", name)
    w = 2 * np.pi * frequency
    unit = equivalent_plant(1.0, 2 * damping_ratio * w, w**2, cycle)
    unit_limit = gain_limit(DelayedLoop(unit, cycle, delay)).gain
    if not np.isfinite(unit_limit):
        raise ArgumentError(f"no gain makes a plant of {frequency:g} Hz and this damping unstable", "damping_ratio")
    m = limit / unit_limit
    return equivalent_plant(m, 2 * damping_ratio * w * m, w**2 * m, cycle)


def limits_that_meet(
    plant_of: Callable[[float], CorrectedPlant],
    brackets: Mapping[float, tuple[float, float]],
    x: CorrectedPlant,
    cycle: float,
    delay: float,
    *,
    between: tuple[float, float],
) -> list[tuple[float, float]]:
    """Find the limits along y for which the limits in other directions agree with experiments.

    Args:
        plant_of: returns the plant along y for a given limit, for example by `plant_of_limit`.
        brackets: by angle [rad], the greatest gain observed stable and the least observed unstable.
        x: the plant along x.
        between: range of limits along y to search.

    Returns the intervals in increasing order, empty if no limit agrees with all brackets. Raises ArgumentError if a
    bracket or the range is not positive and increasing.

    >>> D = gt.control.delayed
    >>> x = D.plant_of_limit(17.0, 0.06, 0.25, 0.004, 0.052)
    >>> met = D.limits_that_meet(
    ...     lambda limit: D.plant_of_limit(12.0, 0.06, limit, 0.004, 0.052),
    ...     {np.pi / 4: (0.03, 0.05)}, x, 0.004, 0.052, between=(0.005, 0.1))
    >>> len(met), all(0.01 < low < high < 0.04 for low, high in met)
    (1, True)
    """
    for name, (low, high) in [("between", between), *[("brackets", b) for b in brackets.values()]]:
        if not 0 < low < high < np.inf:
            raise ArgumentError(f"expected a positive, increasing range; found {low:g} to {high:g}", name)
    if not brackets:
        raise ArgumentError("expected one or more angles", "brackets")

    def inside(limit: float) -> float:
        """Positive if all brackets are met."""
        loops = {a: DelayedLoop(off_axis_plant(x, plant_of(limit), a), cycle, delay) for a in brackets}
        ratios = [gain_limit(loops[a]).gain / np.array(b) for a, b in brackets.items()]
        return float(min(min(np.log(r[0]), -np.log(r[1])) for r in ratios))

    grid = np.geomspace(*between, POINTS)
    values = np.array([inside(float(g)) for g in grid])
    met = values > 0
    edges = []
    for i in np.flatnonzero(met[:-1] != met[1:]).tolist():
        edges.append(float(scipy.optimize.brentq(inside, grid[i], grid[i + 1], rtol=EDGE)))
    edges = [*[float(grid[0])] * bool(met[0]), *edges, *[float(grid[-1])] * bool(met[-1])]
    return list(zip(edges[::2], edges[1::2], strict=True))
