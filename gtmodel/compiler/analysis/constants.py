"""Constants that are added one after the other are added up once: (x + c) + d becomes x + (c + d).

Squares of offsets along other axes leave such sums behind. One that is far smaller than the rest would be lost in
round-off each time anew, and no self-test would see it.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from ..rewriting import applied, rewritten, walked

_SUMS = (ca.OP_ADD, ca.OP_SUB)
Shifted = tuple[ca.SX, float]  # an expression that nothing else reads, and what is to be added to it


def with_gathered_constants(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """The expressions with fewer sums; each with the sparsity it had, common subexpressions shared before."""
    return rewritten(expressions, _rewritten)


class _Gathered:
    def __init__(self, f: ca.Function) -> None:
        self._uses = _uses(f)

    def leaf(self, x: ca.SX) -> Shifted:
        return x, 0.0

    def operation(self, k: int, op: int, given: list[Shifted]) -> Shifted:
        found = _operation(op, given)
        return found if self._uses[k] == 1 else (_whole(found), 0.0)

    def whole(self, form: Shifted) -> ca.SX:
        return _whole(form)


def _rewritten(f: ca.Function, symbols: list[ca.SX]) -> list[ca.SX]:
    return walked(f, symbols, _Gathered(f))


def _operation(op: int, given: list[Shifted]) -> Shifted:
    if op in _SUMS:
        (x, c), (y, d) = given
        sign = 1.0 if op == ca.OP_ADD else -1.0
        if y.is_constant() and not x.is_constant():
            return x, c + sign * (float(y) + d)
        if x.is_constant() and not y.is_constant() and op == ca.OP_ADD:
            return y, d + (float(x) + c)
    if op == ca.OP_ASSIGN:
        return given[0]
    return applied(op, [_whole(g) for g in given]), 0.0


def _whole(shifted: Shifted) -> ca.SX:
    x, c = shifted
    if c == 0.0:
        return x
    return x + c if c > 0.0 else x - (-c)


def _uses(f: ca.Function) -> list[int]:
    """How many instructions read what each of them wrote."""
    count, writer = [0] * f.n_instructions(), dict[int, int]()
    for k in range(f.n_instructions()):
        op = f.instruction_id(k)
        if op not in (ca.OP_INPUT, ca.OP_CONST):
            for place in f.instruction_input(k):
                count[writer[place]] += 1
        if op != ca.OP_OUTPUT:
            writer[f.instruction_output(k)[0]] = k
    return count
