"""Signs and powers of two taken out of sums and products: fewer operations, the same numbers to the last bit.

Second derivatives of |d|^2 and half coefficients of quadratics leave 2 (a - b) / 2 and -(a - b) behind. IEEE 754
rounds x and +-2^k x alike, so that a factor may pass through sums, products, quotients and squares; only the sign of
a zero may change, and where numbers overflow or turn denormal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca

from ..matrices import difference, product, quotient, total
from ..rewriting import applied, rewritten, walked

Factored = tuple[float, ca.SX]  # +-2^k and what it multiplies


def without_factors(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """The expressions with fewer operations; each with the sparsity it had."""
    return rewritten(expressions, lambda read, symbols: walked(read, symbols, _FORMS))


class _Factors:
    def leaf(self, x: ca.SX) -> Factored:
        return 1.0, x

    def operation(self, k: int, op: int, given: list[Factored]) -> Factored:
        return _operation(op, given)

    def whole(self, form: Factored) -> ca.SX:
        c, x = form
        if c == 1.0:
            return x
        return -x if c == -1.0 else c * x


_FORMS = _Factors()
_whole = _FORMS.whole


def _operation(op: int, given: list[Factored]) -> Factored:
    (c, x), (d, y) = given[0], given[-1]
    if op == ca.OP_NEG:
        return -c, x
    if op == ca.OP_TWICE:
        return 2.0 * c, x
    if op == ca.OP_SQ:
        return c * c, product(x, x)
    if op == ca.OP_FABS:
        return abs(c), ca.fabs(x)
    if op == ca.OP_SQRT and c > 0 and math.frexp(c)[1] % 2 == 1:  # 4^k
        return math.sqrt(c), ca.sqrt(x)
    if op == ca.OP_MUL:
        (c, x), (d, y) = _constant(c, x), _constant(d, y)
        return c * d, product(x, y)
    if op == ca.OP_DIV:
        (c, x), (d, y) = _constant(c, x), _constant(d, y)
        return c / d, quotient(x, y)
    if op in (ca.OP_ADD, ca.OP_SUB):
        d = d if op == ca.OP_ADD else -d
        if c == d:
            return c, total(x, y)
        if c == -d:
            return (c, difference(x, y)) if c > 0 or d != 1.0 else (d, difference(y, x))
        if c < 0 and d < 0:
            return -1.0, total(_whole((-c, x)), _whole((-d, y)))
        return 1.0, _sum(c, x, d, y)
    if op == ca.OP_ASSIGN:
        return c, x
    return 1.0, applied(op, [_whole(g) for g in given])


def _constant(c: float, x: ca.SX) -> Factored:
    """A constant that is a power of two becomes a factor."""
    if x.is_constant():
        value = float(x)
        if value != 0.0 and abs(math.frexp(value)[0]) == 0.5:
            return c * value, ca.SX(1)
    return c, x


def _sum(c: float, x: ca.SX, d: float, y: ca.SX) -> ca.SX:
    """c x + d y with a difference where one is negative."""
    if d < 0:
        return difference(_whole((c, x)), _whole((-d, y)))
    if c < 0:
        return difference(_whole((d, y)), _whole((-c, x)))
    return total(_whole((c, x)), _whole((d, y)))
