"""What a quadratic left behind is used again: the difference that it was made of, and its root as its derivative.

x - (y + z) is (x - y) - z where x - y is there already and z was computed from it: |T - A - q v| = L solved for q
leaves T - (A + q v) beside T - A. Elsewhere the two orders of summation would differ in accuracy: here z carries the
rounding of x - y already, so that nothing is lost. And with q = (d.v - s) / v.v the derivative (d - q v).v, by which
the velocity is divided, is s.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import casadi as ca

from ..rewriting import Instruction, applied, rewritten, walked

LONGEST = 16  # products in a sum


def with_differences(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """The expressions, each with the sparsity it had; common subexpressions must be shared before."""
    return rewritten(expressions, _rewritten)


def _rewritten(read: list[Instruction], symbols: list[ca.SX]) -> list[ca.SX] | None:
    count = 0
    for search in (_better, _derivatives_of):
        replacements = search(read)
        count += len(replacements)
        for k, instruction in replacements.items():
            read[k] = instruction
    return walked(read, symbols, _Plain()) if count else None


class _Plain:
    """Instructions as they are."""

    def leaf(self, x: ca.SX) -> ca.SX:
        return x

    def operation(self, k: int, op: int, given: list[ca.SX]) -> ca.SX:
        return given[0] if op == ca.OP_ASSIGN else applied(op, given)

    def whole(self, form: ca.SX) -> ca.SX:
        return form


def _better(read: list[Instruction]) -> dict[int, Instruction]:
    """(x - y) - z in place of differences x - (y + z) that profit."""
    uses = Counter(k for instruction in read for k in instruction.reads)
    differences = {tuple(i.reads): k for k, i in enumerate(read) if i.op == ca.OP_SUB}
    better: dict[int, Instruction] = {}
    for (x, total), k in differences.items():
        op, terms, *_ = read[total]
        if op != ca.OP_ADD or uses[total] != 1:
            continue
        for y, z in (terms, terms[::-1]):
            difference = differences.get((x, y))
            if difference is not None and difference < z and _depends(read, z, difference):
                better[k] = Instruction(ca.OP_SUB, [difference, z])
                break
    return better


def _depends(read: list[Instruction], k: int, on: int) -> bool:
    """Whether instruction k is computed from the result of another one."""
    seen, left = set[int](), [k]
    while left:
        k = left.pop()
        if k == on:
            return True
        if k > on and k not in seen:
            seen.add(k)
            left += read[k].reads
    return False


def _derivatives_of(read: list[Instruction]) -> dict[int, Instruction]:
    """s or -s in place of sums of (x - q y) y, where q is (sum of x y -+ s) over (sum of y y)."""
    replacements: dict[int, Instruction] = {}
    for k, (op, *_) in enumerate(read):
        if op != ca.OP_ADD:
            continue
        terms = _products(read, k)
        split = [_off_line(read, a, b) or _off_line(read, b, a) for a, b in terms]
        first = split[0] if split else None
        if first is None or any(x is None or x[1] != first[1] for x in split):
            continue
        q_op, given, *_ = read[first[1]]
        if q_op != ca.OP_DIV or read[given[0]].op not in (ca.OP_ADD, ca.OP_SUB):
            continue
        sign, (product, root), *_ = read[given[0]]
        pairs = [(x[0], x[2]) for x in split if x is not None]
        if _sorted(_products(read, product)) == _sorted(pairs) and _sorted(_products(read, given[1])) == _sorted(
            [(y, y) for _, y in pairs]
        ):
            replacements[k] = Instruction(ca.OP_ASSIGN if sign == ca.OP_SUB else ca.OP_NEG, [root])
    return replacements


def _products(read: list[Instruction], k: int) -> list[tuple[int, int]]:
    """The factors of a sum of products; none if it is something else, or longer than vectors are."""
    products, left = list[tuple[int, int]](), [k]
    while left:
        op, given, *_ = read[left.pop()]
        if len(products) == LONGEST:
            return []
        if op == ca.OP_ADD:
            left += given
        elif op in (ca.OP_MUL, ca.OP_SQ):
            products.append((given[0], given[-1]))
        else:
            return []
    return products


def _off_line(read: list[Instruction], r: int, y: int) -> tuple[int, int, int] | None:
    """(x, q, y) if r is x - q y."""
    op, given, *_ = read[r]
    if op != ca.OP_SUB or read[given[1]].op != ca.OP_MUL:
        return None
    a, b = read[given[1]].reads
    return None if y not in (a, b) else (given[0], b if a == y else a, y)


def _sorted(pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    return sorted((min(p), max(p)) for p in pairs)
