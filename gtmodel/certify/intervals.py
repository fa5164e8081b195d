"""Interval arithmetic on NumPy columns, rounded outward: the real result of every operation lies inside.

IEEE double rounds + - * / and sqrt to nearest, so one step of `nextafter` outward encloses the real result. The
functions of libm and NumPy are assumed to be within LIBM_ULP units in the last place, which IEEE does not guarantee.
An interval with NaN as both ends means that the operation may be undefined, so that nothing can be proved from it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

Array = np.ndarray

LIBM_ULP = 4.0
ULP = 2.0**-52  # largest unit in the last place of x, relative to |x|
TINY = 2.0**-1074
# the test whether a maximum of sin lies inside: far above the error of the division by pi up to the largest argument
_PAD, _LARGEST_ANGLE = 1e-9, 1e6


class Interval(NamedTuple):
    """Least and greatest values (n,), one for each box."""

    lo: Array
    hi: Array

    @property
    def magnitude(self) -> Array:
        """The largest absolute value."""
        return np.maximum(np.abs(self.lo), np.abs(self.hi))

    @property
    def mignitude(self) -> Array:
        """The smallest absolute value."""
        return np.where(self.contains(0.0), 0.0, np.minimum(np.abs(self.lo), np.abs(self.hi)))

    def contains(self, x: float) -> Array:
        return (self.lo <= x) & (self.hi >= x)

    def widened(self, error: Array) -> Interval:
        """Return the interval of all x + d, |d| <= error."""
        return outward(self.lo - error, self.hi + error)


def checked(lo: Array, hi: Array) -> Interval:
    """Return the interval, NaN at both ends if one is NaN."""
    bad = np.isnan(lo) | np.isnan(hi)
    return Interval(np.where(bad, np.nan, lo), np.where(bad, np.nan, hi)) if bad.any() else Interval(lo, hi)


def outward(lo: Array, hi: Array) -> Interval:
    """Return the interval with each end moved outward by one number."""
    return checked(np.nextafter(lo, -np.inf), np.nextafter(hi, np.inf))


def hull(a: Interval, b: Interval) -> Interval:
    """Return the smallest interval with both."""
    return checked(np.minimum(a.lo, b.lo), np.maximum(a.hi, b.hi))


def point(x: Array) -> Interval:
    """Return intervals of one number each."""
    return Interval(x, x)


def _undefined(where: Array, x: Interval) -> Interval:
    return Interval(np.where(where, np.nan, x.lo), np.where(where, np.nan, x.hi)) if where.any() else x


def _corners(f: Callable[[Array, Array], Array], x: Interval, y: Interval) -> tuple[Array, Array]:
    values = f(x.lo, y.lo), f(x.lo, y.hi), f(x.hi, y.lo), f(x.hi, y.hi)
    a, b, c, d = values
    return np.minimum(np.minimum(a, b), np.minimum(c, d)), np.maximum(np.maximum(a, b), np.maximum(c, d))


def add(x: Interval, y: Interval) -> Interval:
    return outward(x.lo + y.lo, x.hi + y.hi)


def subtract(x: Interval, y: Interval) -> Interval:
    return outward(x.lo - y.hi, x.hi - y.lo)


def multiply(x: Interval, y: Interval) -> Interval:
    return outward(*_corners(np.multiply, x, y))


def divide(x: Interval, y: Interval) -> Interval:
    """Undefined if the divisor may be zero."""
    y = _undefined(y.contains(0.0), y)
    return outward(*_corners(np.divide, x, y))


def square(x: Interval) -> Interval:
    least, most = x.mignitude, x.magnitude
    result = outward(least * least, most * most)
    return Interval(np.maximum(result.lo, 0.0), result.hi)


def root(x: Interval) -> Interval:
    """Undefined if the argument may be negative."""
    x = _undefined(x.lo < 0, x)
    result = outward(np.sqrt(x.lo), np.sqrt(x.hi))
    return Interval(np.maximum(result.lo, 0.0), result.hi)


def _libm(lo: Array, hi: Array) -> Interval:
    """The interval between two results of libm, widened by its assumed error."""
    e = LIBM_ULP * ULP
    return outward(lo - (e * np.abs(lo) + LIBM_ULP * TINY), hi + (e * np.abs(hi) + LIBM_ULP * TINY))


def _clipped(x: Interval, least: float, most: float) -> Interval:
    return Interval(np.maximum(x.lo, least), np.minimum(x.hi, most))


def _holds_multiple(x: Interval, first: float, period: float) -> Array:
    """Return where first + k period may lie inside, for an integer k."""
    below = np.floor((x.lo - _PAD * (1 + np.abs(x.lo)) - first) / period)
    above = np.floor((x.hi + _PAD * (1 + np.abs(x.hi)) - first) / period)
    return ~(below == above) | ~(x.magnitude <= _LARGEST_ANGLE)


def _wave(f: Callable[[Array], Array], x: Interval, crest: float) -> Interval:
    """sin or cos, with a maximum at `crest`."""
    x = _undefined(~np.isfinite(x.lo) | ~np.isfinite(x.hi), x)
    a, b = f(x.lo), f(x.hi)
    result = _libm(np.minimum(a, b), np.maximum(a, b))
    hi = np.where(_holds_multiple(x, crest, 2 * np.pi), 1.0, result.hi)
    lo = np.where(_holds_multiple(x, crest + np.pi, 2 * np.pi), -1.0, result.lo)
    return checked(
        np.where(np.isnan(a), np.nan, np.maximum(lo, -1.0)), np.where(np.isnan(b), np.nan, np.minimum(hi, 1.0))
    )


def sine(x: Interval) -> Interval:
    return _wave(np.sin, x, np.pi / 2)


def cosine(x: Interval) -> Interval:
    return _wave(np.cos, x, 0.0)


def tangent(x: Interval) -> Interval:
    """Undefined if a pole may lie inside."""
    x = _undefined(_holds_multiple(x, np.pi / 2, np.pi), x)
    return _libm(np.tan(x.lo), np.tan(x.hi))


def arcsine(x: Interval) -> Interval:
    x = _undefined((x.lo < -1.0) | (x.hi > 1.0), x)
    return _libm(np.arcsin(x.lo), np.arcsin(x.hi))


def arccosine(x: Interval) -> Interval:
    x = _undefined((x.lo < -1.0) | (x.hi > 1.0), x)
    result = _libm(np.arccos(x.hi), np.arccos(x.lo))
    return Interval(np.maximum(result.lo, 0.0), result.hi)


def arctangent(x: Interval) -> Interval:
    return _libm(np.arctan(x.lo), np.arctan(x.hi))


def touches_cut(y: Interval, x: Interval) -> Array:
    """Return where atan2(y, x) may be on its branch cut, or at the origin."""
    return ~((x.lo > 0) | (y.lo > 0) | (y.hi < 0))


def arctangent2(y: Interval, x: Interval) -> Interval:
    """atan2(y, x): the extremes of the angle over a box beside the cut are at corners; else every angle."""
    lo, hi = _corners(np.arctan2, y, x)
    result = _libm(lo, hi)
    cut, whole = touches_cut(y, x), np.nextafter(np.pi, np.inf)
    return checked(
        np.where(cut & ~np.isnan(result.lo), -whole, result.lo), np.where(cut & ~np.isnan(result.hi), whole, result.hi)
    )


def exponential(x: Interval) -> Interval:
    result = _libm(np.exp(x.lo), np.exp(x.hi))
    return Interval(np.maximum(result.lo, 0.0), result.hi)


def logarithm(x: Interval) -> Interval:
    x = _undefined(x.lo <= 0, x)
    return _libm(np.log(x.lo), np.log(x.hi))


def hyperbolic_sine(x: Interval) -> Interval:
    return _libm(np.sinh(x.lo), np.sinh(x.hi))


def hyperbolic_cosine(x: Interval) -> Interval:
    result = _libm(np.cosh(x.mignitude), np.cosh(x.magnitude))
    return Interval(np.maximum(result.lo, 1.0), result.hi)


def hyperbolic_tangent(x: Interval) -> Interval:
    return _clipped(_libm(np.tanh(x.lo), np.tanh(x.hi)), -1.0, 1.0)


def power(x: Interval, y: Interval) -> Interval:
    """x^y for positive x, where the extremes are at corners, or for an integer y."""
    lo, hi = _corners(np.power, Interval(np.maximum(x.lo, 0.0), np.maximum(x.hi, 0.0)), y)
    result = _libm(lo, hi)
    fixed = (y.lo == y.hi) & (y.lo == np.round(y.lo))
    ends = np.power(x.lo, y.lo), np.power(x.hi, y.lo)
    even = fixed & (y.lo % 2 == 0)
    low = np.where(even & x.contains(0.0), 0.0, np.minimum(*ends))
    integer = _libm(low, np.maximum(*ends))
    good = fixed & ((y.lo > 0) | ~x.contains(0.0))
    lo, hi = np.where(good, integer.lo, result.lo), np.where(good, integer.hi, result.hi)
    return _undefined(~(good | (x.lo > 0)), checked(lo, hi))


def negative(x: Interval) -> Interval:
    return Interval(-x.hi, -x.lo)


def absolute(x: Interval) -> Interval:
    return checked(np.where(np.isnan(x.lo), np.nan, x.mignitude), x.magnitude)


def least(x: Interval, y: Interval) -> Interval:
    return checked(np.minimum(x.lo, y.lo), np.minimum(x.hi, y.hi))


def greatest(x: Interval, y: Interval) -> Interval:
    return checked(np.maximum(x.lo, y.lo), np.maximum(x.hi, y.hi))


def _monotone(f: Callable[[Array], Array]) -> Callable[[Interval], Interval]:
    return lambda x: Interval(f(x.lo), f(x.hi))


def _judged(yes: Array, no: Array, *used: Interval) -> Interval:
    """1 where certain, 0 where impossible, else both; NaN if an operand is undefined."""
    lo, hi = np.where(yes, 1.0, 0.0), np.where(no, 0.0, 1.0)
    bad = np.logical_or.reduce(np.broadcast_arrays(*[np.isnan(u.lo) for u in used]))
    return Interval(np.where(bad, np.nan, lo), np.where(bad, np.nan, hi))


def _less(x: Interval, y: Interval) -> Interval:
    return _judged(x.hi < y.lo, x.lo >= y.hi, x, y)


def _at_most(x: Interval, y: Interval) -> Interval:
    return _judged(x.hi <= y.lo, x.lo > y.hi, x, y)


def _equal(x: Interval, y: Interval) -> Interval:
    return _judged((x.lo == x.hi) & (y.lo == y.hi) & (x.lo == y.lo), (x.hi < y.lo) | (x.lo > y.hi), x, y)


def _not(x: Interval) -> Interval:
    zero, other = _truth(x)
    return _judged(zero, other, x)


def _truth(x: Interval) -> tuple[Array, Array]:
    """Return where x is surely zero, and where it surely is not."""
    return (x.lo == 0) & (x.hi == 0), (x.lo > 0) | (x.hi < 0)


def _and(x: Interval, y: Interval) -> Interval:
    (x0, x1), (y0, y1) = _truth(x), _truth(y)
    return _judged(x1 & y1, x0 | y0, x, y)


def _or(x: Interval, y: Interval) -> Interval:
    (x0, x1), (y0, y1) = _truth(x), _truth(y)
    return _judged(x1 | y1, x0 & y0, x, y)


def chosen(condition: Interval, x: Interval) -> Interval:
    """x if the condition is not zero, else 0; an undefined x is ignored where the condition is surely zero."""
    zero, other = _truth(condition)
    both = checked(np.minimum(x.lo, 0.0), np.maximum(x.hi, 0.0))
    lo = np.where(zero, 0.0, np.where(other, x.lo, both.lo))
    hi = np.where(zero, 0.0, np.where(other, x.hi, both.hi))
    bad = np.isnan(condition.lo)
    return Interval(np.where(bad, np.nan, lo), np.where(bad, np.nan, hi))


OPERATIONS: dict[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_ADD: add,
    ca.OP_SUB: subtract,
    ca.OP_MUL: multiply,
    ca.OP_DIV: divide,
    ca.OP_NEG: negative,
    ca.OP_SQ: square,
    ca.OP_TWICE: lambda x: Interval(2.0 * x.lo, 2.0 * x.hi),
    ca.OP_INV: lambda x: divide(point(np.ones(1)), x),
    ca.OP_SQRT: root,
    ca.OP_SIN: sine,
    ca.OP_COS: cosine,
    ca.OP_TAN: tangent,
    ca.OP_ASIN: arcsine,
    ca.OP_ACOS: arccosine,
    ca.OP_ATAN: arctangent,
    ca.OP_ATAN2: arctangent2,
    ca.OP_SINH: hyperbolic_sine,
    ca.OP_COSH: hyperbolic_cosine,
    ca.OP_TANH: hyperbolic_tangent,
    ca.OP_EXP: exponential,
    ca.OP_LOG: logarithm,
    ca.OP_POW: power,
    ca.OP_CONSTPOW: power,
    ca.OP_FABS: absolute,
    ca.OP_FMIN: least,
    ca.OP_FMAX: greatest,
    ca.OP_SIGN: _monotone(np.sign),
    ca.OP_FLOOR: _monotone(np.floor),
    ca.OP_CEIL: _monotone(np.ceil),
    ca.OP_LT: _less,
    ca.OP_LE: _at_most,
    ca.OP_EQ: _equal,
    ca.OP_NE: lambda x, y: _not(_equal(x, y)),
    ca.OP_NOT: _not,
    ca.OP_AND: _and,
    ca.OP_OR: _or,
    ca.OP_IF_ELSE_ZERO: chosen,
}  # fmt: skip
# a value jumps: a box across the jump has no mean-value form, and round-off may choose the other side
JUMPS = frozenset(
    [ca.OP_SIGN, ca.OP_FLOOR, ca.OP_CEIL, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR]
)
