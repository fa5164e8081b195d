"""The mass whose weight explains the middle levels of friction, by three norms."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import scipy

from ...results import ArgumentError
from ...results.trajectory_errors import Array

Gravity = Literal["most_symmetric", "poses"]  # how the mass is found beside friction by direction
PARALLEL = 1e-6  # patterns closer to parallel than this: the difference of gravity between poses determines no mass
TIE = 1e-9  # of the sum of weights: two sides of a median that weigh the same


class MassByNorm(NamedTuple):
    """Masses [kg] that make the asymmetry middle - m pattern least, by norm.

    `two` is that of the 2-norm, `one` the interval in which the 1-norm is least (both ends equal where it is a point),
    `maximum` that of the maximum norm.
    """

    two: float
    one: tuple[float, float]
    maximum: float


def mass_by_norm(middle: Array, pattern: Array) -> MassByNorm:
    """Masses from the middle levels [N] and the forces that hold one kilogram [N/kg], both (n,) or of any one shape.

    The middle level is the mean of the forces that the lines forwards and backwards reach at velocity zero:
    middle = m pattern + (fc+ - fc-)/2, with the magnitudes fc+ and fc- of Coulomb friction, whose asymmetric part is
    what is left. The 2-norm gives m = middle.pattern / pattern.pattern. Raises ArgumentError for shapes that differ,
    numbers that are not finite, and a pattern of zeros.

    >>> pattern = np.array([-7.9, -0.7, 8.6])
    >>> masses = gt.identify.mass_by_norm(20.0 * pattern + np.array([10.0, 0.0, 0.0]), pattern)
    >>> round(masses.two, 2), round(masses.one[0], 2), round(masses.maximum, 2)  # the 1-norm leaves an outlier alone
    (19.42, 20.0, 19.39)
    """
    c, g = np.asarray(middle, float), np.asarray(pattern, float)
    if c.shape != g.shape:
        raise ArgumentError(f"has the shape {c.shape}; expected {g.shape}, that of the pattern", "middle")
    if not (np.isfinite(c).all() and np.isfinite(g).all()):
        raise ArgumentError("holds a number that is not finite, or the pattern does", "middle")
    if not np.any(g):
        raise ArgumentError("one kilogram loads no cart, so no force determines the mass", "pattern")
    c, g = c.ravel(), g.ravel()
    return MassByNorm(float(c @ g / (g @ g)), _weighted_median(c, g), _minimax(c, g))


def _weighted_median(c: Array, g: Array) -> tuple[float, float]:
    """sum |c - m g| = sum |g| |c/g - m| is least at the median of c/g with weights |g|; an interval at a tie."""
    c, g = c[g != 0], g[g != 0]
    order = np.argsort(c / g)
    at, weight = (c / g)[order], np.abs(g)[order]
    share = np.cumsum(weight) / weight.sum()
    k = int(np.searchsorted(share, 0.5 - TIE))
    return float(at[k]), float(at[k + 1] if abs(share[k] - 0.5) <= TIE else at[k])


def _minimax(c: Array, g: Array) -> float:
    """Least e with -e <= c - m g <= e, as a linear program in (m, e)."""
    ones = np.ones_like(g)
    upper = np.vstack([np.column_stack([-g, -ones]), np.column_stack([g, -ones])])
    optimum = scipy.optimize.linprog([0, 1], A_ub=upper, b_ub=np.concatenate([-c, c]), bounds=[(None, None), (0, None)])
    return float(optimum.x[0])
