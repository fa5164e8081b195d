"""Emission: rewrites expressions of solved unknowns in terms of a plan's inputs, with fewer operations and the same
values up to round-off."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import casadi as ca

from .matrices import difference, product, quotient, substituted_in_order, total
from .plan import CausalPlan
from .rewriting import Instruction, applied, rewritten, walked

_SUMS = (ca.OP_ADD, ca.OP_SUB)
Shifted = tuple[ca.SX, float]  # an expression that nothing else reads, and a constant to add to it


def with_gathered_constants(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """Return the expressions with fewer sums and the same sparsity; common subexpressions must be shared already."""
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
        """Return a sum with a constant term; None if it has none."""
        (x, c), (y, d) = first, second
        sign = 1.0 if op == ca.OP_ADD else -1.0
        if y.is_constant() and not x.is_constant():
            return x, c + sign * (float(y) + d)
        if x.is_constant() and not y.is_constant() and op == ca.OP_ADD:
            return y, d + (float(x) + c)
        return None


LONGEST = 16  # largest number of products in a sum


def with_differences(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """Return the expressions with fewer operations, by reuse of differences; common subexpressions must be shared."""
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
    """Forms that leave the instructions unchanged."""

    def leaf(self, x: ca.SX) -> ca.SX:
        return x

    def operation(self, k: int, op: int, given: list[ca.SX]) -> ca.SX:
        return given[0] if op == ca.OP_ASSIGN else applied(op, given)

    def whole(self, form: ca.SX) -> ca.SX:
        return form


def _better(read: list[Instruction]) -> dict[int, Instruction]:
    """Replace x - (y + z) by (x - y) - z if x - y is computed anyway."""
    uses = Counter(k for instruction in read for k in instruction.reads)
    differences = {tuple(i.reads): k for k, i in enumerate(read) if i.op == ca.OP_SUB}
    better: dict[int, Instruction] = {}
    for (x, added), k in differences.items():
        op, terms, *_ = read[added]
        if op != ca.OP_ADD or uses[added] != 1:
            continue
        for y, z in (terms, terms[::-1]):
            earlier = differences.get((x, y))
            if earlier is not None and earlier < z and _depends(read, z, earlier):
                better[k] = Instruction(ca.OP_SUB, [earlier, z])
                break
    return better


def _depends(read: list[Instruction], k: int, on: int) -> bool:
    """Return whether instruction k depends on instruction `on`."""
    visited, stack = set[int](), [k]
    while stack:
        k = stack.pop()
        if k == on:
            return True
        if k > on and k not in visited:
            visited.add(k)
            stack += read[k].reads
    return False


def _derivatives_of(read: list[Instruction]) -> dict[int, Instruction]:
    """Replace sums of (x - q y) y by s or -s if q is (sum of x y -+ s) / (sum of y y)."""
    replacements: dict[int, Instruction] = {}
    for k, (op, *_) in enumerate(read):
        if op != ca.OP_ADD:
            continue
        terms = _products(read, k)
        split = [_off_line(read, a, b) or _off_line(read, b, a) for a, b in terms]
        first = split[0] if split else None
        if first is None or any(x is None or x[1] != first[1] for x in split):
            continue
        q_op, reads, *_ = read[first[1]]
        if q_op != ca.OP_DIV or read[reads[0]].op not in (ca.OP_ADD, ca.OP_SUB):
            continue
        sign, (product, root), *_ = read[reads[0]]
        pairs = [(x[0], x[2]) for x in split if x is not None]
        if _sorted(_products(read, product)) == _sorted(pairs) and _sorted(_products(read, reads[1])) == _sorted(
            [(y, y) for _, y in pairs]
        ):
            replacements[k] = Instruction(ca.OP_ASSIGN if sign == ca.OP_SUB else ca.OP_NEG, [root])
    return replacements


def _products(read: list[Instruction], k: int) -> list[tuple[int, int]]:
    """Return the factors of a sum of products; empty if it is something else, or longer than LONGEST."""
    products, stack = list[tuple[int, int]](), [k]
    while stack:
        op, reads, *_ = read[stack.pop()]
        if len(products) == LONGEST:
            return []
        if op == ca.OP_ADD:
            stack += reads
        elif op in (ca.OP_MUL, ca.OP_SQ):
            products.append((reads[0], reads[-1]))
        else:
            return []
    return products


def _off_line(read: list[Instruction], r: int, y: int) -> tuple[int, int, int] | None:
    """Return (x, q, y) if r is x - q y."""
    op, reads, *_ = read[r]
    if op != ca.OP_SUB or read[reads[1]].op != ca.OP_MUL:
        return None
    a, b = read[reads[1]].reads
    return None if y not in (a, b) else (reads[0], b if a == y else a, y)


def _sorted(pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    return sorted((min(p), max(p)) for p in pairs)


Factored = tuple[float, ca.SX]  # a factor +-2^k and an expression


def without_factors(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """Return the expressions with signs and powers of two factored out, with the same sparsity."""
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
    """Turn a constant that is a power of two into a factor."""
    if x.is_constant():
        value = float(x)
        if value != 0.0 and abs(math.frexp(value)[0]) == 0.5:
            return c * value, ca.SX(1)
    return c, x


def _sum(c: float, x: ca.SX, d: float, y: ca.SX) -> ca.SX:
    """Return c x + d y, as a difference if one factor is negative."""
    if d < 0:
        return difference(_whole((c, x)), _whole((-d, y)))
    if c < 0:
        return difference(_whole((d, y)), _whole((-c, x)))
    return total(_whole((c, x)), _whole((d, y)))


def express(plan: CausalPlan, expressions: Sequence[ca.SX], extra: Sequence[tuple[ca.SX, ca.SX]] = ()) -> list[ca.SX]:
    """Rewrite expressions of kept symbols in terms of the plan's inputs, Newton unknowns, parameters and time.

    Parameters are replaced by `plan.parameters`. `extra`: further (symbol, value) pairs, which replace the values that
    the plan computes. The last step eliminates common subexpressions, which SX does not share by itself.
    """
    results = substituted(plan, expressions, extra)
    if not results:
        return []
    shared = ca.cse(with_differences(ca.cse(without_factors(ca.cse(results)))))
    return ca.cse(with_gathered_constants(shared))


def substituted(plan: CausalPlan, expressions: Sequence[ca.SX], extra: Sequence[tuple[ca.SX, ca.SX]]) -> list[ca.SX]:
    """Like `express` without any simplification: fast, for functions that are called a few times."""
    replaced = {s.element_hash() for s, _ in extra}
    roots = [r for b in plan.blocks for r in b.roots]
    pairs = [*extra]
    if plan.flat.parameters:
        pairs.append((plan.flat.p, plan.parameters))
    pairs += [(r.sign, ca.SX(r.value)) for r in roots]
    pairs += [a for b in plan.blocks for a in b.assignments if a[0].element_hash() not in replaced]
    results = list(expressions)
    if pairs:
        symbols, values = [s for s, _ in pairs], [v for _, v in pairs]
        results = substituted_in_order(symbols, values, results, bool(plan.flat.scope.calls))
    return results
