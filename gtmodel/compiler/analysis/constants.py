"""Constants that are added one after the other are added up once: (x + c) + d becomes x + (c + d).

Squares of offsets along other axes leave such sums behind. One that is far smaller than the rest would be lost in
round-off each time anew, and no self-test would see it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import casadi as ca

from ..rewriting import Instruction, applied, rewritten, walked

_SUMS = (ca.OP_ADD, ca.OP_SUB)
Shifted = tuple[ca.SX, float]  # an expression that nothing else reads, and what is to be added to it


def with_gathered_constants(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """The expressions with fewer sums; each with the sparsity it had, common subexpressions shared before."""
    return rewritten(expressions, lambda read, symbols: walked(read, symbols, _Gathered(read)))


class _Gathered:
    def __init__(self, read: Sequence[Instruction]) -> None:
        self._uses = Counter(k for instruction in read for k in instruction.reads)

    def leaf(self, x: ca.SX) -> Shifted:
        return x, 0.0

    def operation(self, k: int, op: int, given: list[Shifted]) -> Shifted:
        if op == ca.OP_ASSIGN:
            form = given[0]
        else:
            form = self._sum(op, *given) if op in _SUMS else None
            form = form or (applied(op, [self.whole(g) for g in given]), 0.0)
        return form if self._uses[k] == 1 else (self.whole(form), 0.0)

    def whole(self, form: Shifted) -> ca.SX:
        x, c = form
        if c == 0.0:
            return x
        return x + c if c > 0.0 else x - (-c)

    @staticmethod
    def _sum(op: int, first: Shifted, second: Shifted) -> Shifted | None:
        """With a constant among its parts; None without one."""
        (x, c), (y, d) = first, second
        sign = 1.0 if op == ca.OP_ADD else -1.0
        if y.is_constant() and not x.is_constant():
            return x, c + sign * (float(y) + d)
        if x.is_constant() and not y.is_constant() and op == ca.OP_ADD:
            return y, d + (float(x) + c)
        return None
