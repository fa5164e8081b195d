"""Tail probabilities and quantiles of the F and chi-squared distributions.

All functions take and return arrays or numbers. Student's t and the normal distribution are in `half_width` of
`results/estimate.py`, which computes intervals.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def _special() -> ModuleType:
    import scipy  # here, since the options of kinds import this module; scipy.stats takes as long as all of gtmodel

    return scipy.special


def f_chance(F: ArrayLike, more: ArrayLike, rest: ArrayLike) -> Any:
    """Return the probability that the ratio of two mean squares of equal expectation, with `more` and `rest` degrees
    of freedom, is F or more; NaN for NaN.

    >>> from gtmodel.inference.chance import f_bound, f_chance
    >>> round(float(f_chance(f_bound(0.01, 3, 40), 3, 40)), 9)
    0.01
    """
    return _special().fdtrc(more, rest, np.maximum(F, 0.0))


def f_bound(p: float, more: float, rest: float) -> float:
    """Return the ratio that two mean squares of equal expectation exceed with probability p."""
    return float(1 / _special().fdtri(rest, more, p))


def f_test(before: float, after: float, more: int, rest: float) -> tuple[float, float]:
    """Return F and its p-value for nested fits: `more` additional columns lower the sum of squares from `before` to
    `after`, which has `rest` degrees of freedom; NaN if both are zero. Exact for linear fits with white normal noise.

    >>> from gtmodel.inference.chance import f_test
    >>> F, p = f_test(12.0, 8.0, 2, 20)
    >>> F, round(p, 4)
    (5.0, 0.0173)
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        F = np.divide(before - after, more) / np.divide(after, rest)
    return float(F), float(f_chance(F, more, rest))


def chi_squared_chance(x: ArrayLike, degrees_of_freedom: ArrayLike) -> Any:
    """Return the probability that a sum of squares of normal numbers of variance 1 is x or more."""
    return _special().chdtrc(degrees_of_freedom, x)


def chi_squared_share(x: ArrayLike, degrees_of_freedom: ArrayLike) -> Any:
    """Return the probability that this sum is less than x."""
    return _special().chdtr(degrees_of_freedom, x)


def chi_squared_bound(p: ArrayLike, degrees_of_freedom: ArrayLike) -> Any:
    """Return the sum that is exceeded with probability p."""
    return _special().chdtri(degrees_of_freedom, p)


def chi_squared_ends(level: float, degrees_of_freedom: ArrayLike) -> tuple[Any, Any]:
    """Return both ends of the interval that holds this sum with probability `level`, with equal tails.

    >>> from gtmodel.inference.chance import chi_squared_ends
    >>> [round(float(end), 1) for end in chi_squared_ends(0.95, 100)]
    [74.2, 129.6]
    """
    beyond = (1 - level) / 2
    return chi_squared_bound(1 - beyond, degrees_of_freedom), chi_squared_bound(beyond, degrees_of_freedom)
