"""Error bounds of floating-point operations, computed along the operations (Higham, Accuracy and Stability, 3.3).

For every operation: |computed - exact| <= error carried by the operands + round-off of the operation itself. The sums
of these bounds have positive terms, so their own round-off is far below the factor GROWN.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from .intervals import (
    JUMPS,
    LIBM_ULP,
    OPERATIONS,
    Array,
    Interval,
    exponential,
    hyperbolic_cosine,
    power,
    tangent,
    touches_cut,
)

GROWN = 1.0 + 2.0**-40


@dataclass(frozen=True)
class Arithmetic:
    """Round to nearest. unit: round-off relative to a result. tiny: smallest positive number; largest: largest one.
    folded: relative error of constants in the text that stand for products of exact ones."""

    name: str
    unit: float
    tiny: float
    largest: float
    folded: float = 0.0

    def constant(self, value: float) -> float:
        """Return the error of a constant, which the text of the code rounds to this arithmetic."""
        if self.name == "double":
            return self.folded * abs(value)
        return abs(value - float(np.float32(value))) * GROWN


DOUBLE = Arithmetic("double", 2.0**-53, 2.0**-1074, float(np.finfo(np.float64).max))
FLOAT = Arithmetic("float", 2.0**-24, 2.0**-149, float(np.finfo(np.float32).max))
ARITHMETICS = {a.name: a for a in (DOUBLE, FLOAT)}

# exact in floating point; an overflow is tested apart
_EXACT = JUMPS | {
    ca.OP_ASSIGN, ca.OP_NEG, ca.OP_TWICE, ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX, ca.OP_IF_ELSE_ZERO,
}  # fmt: skip
_ROUNDED = frozenset([ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_SQ, ca.OP_INV, ca.OP_SQRT])


def error(op: int, given: list[Interval], errors: list[Array], result: Interval, arithmetic: Arithmetic) -> Array:
    """Return the error bound (n,) of an operation whose real operands lie in `given` and whose real result in `result`;
    NaN if the computed value may be undefined or overflow."""
    carried = _CARRIED[op](given, errors, result)
    size = result.magnitude + carried
    unit = 0.0 if op in _EXACT else arithmetic.unit * (1.0 if op in _ROUNDED else 2.0 * LIBM_ULP)
    total = (carried + unit * size) * GROWN
    if op not in _EXACT:
        total = total + 2.0 * LIBM_ULP * arithmetic.tiny
    return np.where(size * GROWN <= arithmetic.largest, total, np.nan)


Carried = Callable[[list[Interval], list[Array], Interval], Array]


def _product(x: list[Interval], e: list[Array], _: Interval) -> Array:
    return x[0].magnitude * e[1] + x[1].magnitude * e[0] + e[0] * e[1]


def _quotient(x: list[Interval], e: list[Array], result: Interval) -> Array:
    # a'/b' - a/b = ((a' - a) - (a/b) (b' - b)) / b'; never zero, since b' may be zero even if a is
    return _over(e[0] + np.nextafter(result.magnitude * e[1], np.inf), _reduced(x[1].mignitude, e[1]))


def _inverse(x: list[Interval], e: list[Array], result: Interval) -> Array:
    return _over(result.magnitude * e[0], _reduced(x[0].mignitude, e[0]))


def _reduced(x: Array, e: Array) -> Array:
    """Return a lower bound of x - e."""
    return np.nextafter(x - GROWN * e, -np.inf)


def _over(numerator: Array, denominator: Array) -> Array:
    """Return the quotient of positive numbers; NaN unless the denominator is surely positive."""
    safe = denominator / GROWN
    return np.where(
        numerator == 0, 0.0 * denominator, np.where(safe > 0, numerator / np.where(safe > 0, safe, 1.0), np.nan)
    )


def _root(x: list[Interval], e: list[Array], result: Interval) -> Array:
    # sqrt(a') - sqrt(a) = (a' - a) / (sqrt(a') + sqrt(a)); a' must not be negative
    least = _reduced(x[0].lo, e[0])
    good = _over(e[0], np.sqrt(np.maximum(least, 0.0)) + result.lo)
    return np.where((least >= 0) | (e[0] == 0), good, np.nan)


def _of_arc(x: list[Interval], e: list[Array], _: Interval) -> Array:
    most = (x[0].magnitude + e[0]) * GROWN
    inside = np.sqrt(np.maximum((1.0 - most) * (1.0 + most), 0.0))
    return np.where(e[0] == 0, 0.0, np.where(most < 1.0, _over(e[0], inside), np.nan))


def _of_angle(x: list[Interval], e: list[Array], _: Interval) -> Array:
    y, x_ = (a.widened(b) for a, b in zip(x, e, strict=True))
    near = np.hypot(y.mignitude, x_.mignitude)
    # on the cut the sign of a zero decides, which is no real number: a turn even if the operands are exact
    return np.where(touches_cut(y, x_), 2.0 * np.pi, _over(e[0] + e[1], near / GROWN))


def _across(op: int) -> Carried:
    """The whole range over the widened operands: crude, but true for every operation."""

    def carried(x: list[Interval], e: list[Array], result: Interval) -> Array:
        wide = OPERATIONS[op](*[a.widened(b) for a, b in zip(x, e, strict=True)])
        exact = np.logical_and.reduce(np.broadcast_arrays(*[b == 0 for b in e]))
        return np.where(exact, 0.0, np.maximum(wide.hi - result.lo, result.hi - wide.lo))

    return carried


def _power(x: list[Interval], e: list[Array], result: Interval) -> Array:
    """With an exponent that is exact and a multiple of a half, by the greatest slope of the power."""
    y = x[1].lo
    usable = (e[1] == 0) & (y == x[1].hi) & (2.0 * y == np.round(2.0 * y)) & (np.abs(y) < 1e6)
    slope = np.abs(y) * power(x[0].widened(e[0]), Interval(y - 1.0, y - 1.0)).magnitude
    return np.where(usable, np.where(e[0] == 0, 0.0, e[0] * slope * GROWN), _across(ca.OP_POW)(x, e, result))


def _jump(x: list[Interval], e: list[Array], result: Interval) -> Array:
    # the operands of a jump are widened by their errors before, so the result holds the computed value too
    return result.hi - result.lo


def _choice(x: list[Interval], e: list[Array], result: Interval) -> Array:
    condition = x[0]
    zero, sure = (condition.lo == 0) & (condition.hi == 0), (condition.lo > 0) | (condition.hi < 0)
    return np.where(zero, 0.0, np.where(sure, e[1], x[1].magnitude + e[1]))


def _first(x: list[Interval], e: list[Array], _: Interval) -> Array:
    return e[0]


_CARRIED: dict[int, Carried] = {
    ca.OP_ADD: lambda x, e, _: e[0] + e[1],
    ca.OP_SUB: lambda x, e, _: e[0] + e[1],
    ca.OP_MUL: _product,
    ca.OP_DIV: _quotient,
    ca.OP_INV: _inverse,
    ca.OP_SQ: lambda x, e, _: e[0] * (2.0 * x[0].magnitude + e[0]),
    ca.OP_TWICE: lambda x, e, _: 2.0 * e[0],
    ca.OP_SQRT: _root,
    ca.OP_ASIN: _of_arc,
    ca.OP_ACOS: _of_arc,
    ca.OP_ATAN2: _of_angle,
    # slopes of at most one
    **dict.fromkeys([ca.OP_ASSIGN, ca.OP_NEG, ca.OP_FABS, ca.OP_SIN, ca.OP_COS, ca.OP_ATAN, ca.OP_TANH], _first),
    ca.OP_FMIN: lambda x, e, _: np.maximum(e[0], e[1]),
    ca.OP_FMAX: lambda x, e, _: np.maximum(e[0], e[1]),
    ca.OP_TAN: lambda x, e, _: e[0] * (1.0 + tangent(x[0].widened(e[0])).magnitude ** 2),
    ca.OP_SINH: lambda x, e, _: e[0] * hyperbolic_cosine(x[0].widened(e[0])).magnitude,
    ca.OP_COSH: lambda x, e, _: e[0] * hyperbolic_cosine(x[0].widened(e[0])).magnitude,
    # exp(d) - 1 <= d exp(d); the slope of log is greatest at the left end
    ca.OP_EXP: lambda x, e, result: np.where(
        e[0] == 0, 0.0, result.magnitude * e[0] * exponential(Interval(e[0], e[0])).hi * GROWN
    ),
    ca.OP_LOG: lambda x, e, _: np.where(e[0] == 0, 0.0, _over(e[0], _reduced(x[0].lo, e[0]))),
    **dict.fromkeys([ca.OP_POW, ca.OP_CONSTPOW], _power),
    **dict.fromkeys(JUMPS, _jump),
    ca.OP_IF_ELSE_ZERO: _choice,
}
