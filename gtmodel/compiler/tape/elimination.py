"""Derivatives on a tape: the operations between arguments and results are eliminated one by one.

Every operation k satisfies dk = sum of c dx over its operands x with partial derivatives c. Eliminating x replaces dx
by its own sum wherever it is read, until only arguments and results remain: the Jacobian. Any order is correct; forward
and reverse differentiation are two of them (Griewank and Walther 2008, chapter 9). Second derivatives are w dx dy for
every pair of operands in which an operation is nonlinear, weighted with its adjoint.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Sequence
from functools import cache

import casadi as ca

from ..rewriting import Instruction, instructions
from .operations import Tape

Priority = Callable[["_Graph", int], tuple[int, int]]
Entries = dict[tuple[int, int], int]  # (row, column) -> number on the tape


def jacobian(tape: Tape, results: Sequence[int], arguments: Sequence[int]) -> Entries:
    """Return d results / d arguments without structural zeros; arguments are inputs of the tape.

    Operations with one reader or one operand are eliminated first, because they cause no fill-in; then from the end.

    >>> from gtmodel.compiler.tape.elimination import jacobian
    >>> from gtmodel.compiler.tape.operations import Tape
    >>> tape = Tape()
    >>> x, y = tape.input(0), tape.input(1)
    >>> entries = jacobian(tape, [tape.product(x, y)], [x, y])
    >>> entries[0, 0] == y, entries[0, 1] == x
    (True, True)
    """
    graph = _Graph(tape, results, arguments)
    ends = {-1 - row: k for row, k in enumerate(results) if k in graph.readers}
    one = tape.constant(1.0)
    for end, k in ends.items():
        graph.reads[end] = {k: one}
        graph.readers[k].add(end)
    graph.eliminate(lambda g, k: (0 if g.simple(k) else 1, -k))
    column = {k: n for n, k in enumerate(arguments)}
    return {(-1 - end, column[k]): c for end in ends for k, c in graph.reads[end].items() if not _zero(tape, c)}


def gradient(tape: Tape, results: Sequence[int], weights: Sequence[int], arguments: Sequence[int]) -> list[int]:
    """Return d (sum of weights times results) / d arguments."""
    adjoints = _Graph(tape, results, arguments).adjoints(results, weights)
    return [adjoints.get(k, tape.constant(0.0)) for k in arguments]


def hessian(tape: Tape, results: Sequence[int], weights: Sequence[int], arguments: Sequence[int]) -> Entries:
    """Return the upper triangle of the second derivatives of the sum of weights times results.

    >>> from gtmodel.compiler.tape.elimination import hessian
    >>> from gtmodel.compiler.tape.operations import Tape
    >>> tape = Tape()
    >>> x, y, weight = (tape.input(k) for k in range(3))
    >>> hessian(tape, [tape.product(x, y)], [weight], [x, y]) == {(0, 1): weight}
    True
    """
    graph = _Graph(tape, results, arguments)
    graph.bend(graph.adjoints(results, weights))
    graph.eliminate(lambda g, k: (0 if g.simple(k, curved=True) else 1, k))
    column = {k: n for n, k in enumerate(arguments)}
    entries = ((column[k], column[m], w) for k, row in graph.curvature.items() for m, w in row.items())
    return {(r, s): w for r, s, w in entries if r <= s and not _zero(tape, w)}


def _zero(tape: Tape, k: int) -> bool:
    return tape.constants.get(k) == 0.0


class _Graph:
    """Graph of the remaining operations: reads[k][x] = dk/dx; readers[x]: operations that read x; curvature[x][y] =
    curvature[y][x]: second derivatives by remaining operations."""

    def __init__(self, tape: Tape, results: Iterable[int], arguments: Sequence[int]) -> None:
        self.tape = tape
        self.arguments = frozenset(arguments)
        moved: set[int] = set()
        for k in tape.needed(results):
            if k in self.arguments or any(x in moved for x in tape.operands(k)):
                moved.add(k)
        self.order = sorted(moved)
        self.reads: dict[int, dict[int, int]] = {}
        self.readers: dict[int, set[int]] = {k: set() for k in self.order}
        self.curvature: dict[int, dict[int, int]] = {}
        self._second: dict[int, list[tuple[int, int, int]]] = {}
        for k in self.order:
            if k in self.arguments:
                continue
            operands = tape.operands(k)
            first, second = _partials(tape, k)
            own = self.reads[k] = {}
            for x, c in zip(operands, first, strict=True):
                if x in moved:
                    own[x] = tape.total(own[x], c) if x in own else c
                    self.readers[x].add(k)
            pairs = [(i, j) for i in range(len(operands)) for j in range(i, len(operands))]
            self._second[k] = [
                (operands[i], operands[j], w if i == j or operands[i] != operands[j] else _twice(tape, w))
                for (i, j), w in zip(pairs, second, strict=True)
                if operands[i] in moved and operands[j] in moved and not _zero(tape, w)
            ]

    def adjoints(self, results: Sequence[int], weights: Sequence[int]) -> dict[int, int]:
        """Return the derivatives of the weighted sum of the results by each operation."""
        tape, adjoints = self.tape, dict[int, int]()
        for k, weight in zip(results, weights, strict=True):
            if k in self.readers:
                adjoints[k] = tape.total(adjoints[k], weight) if k in adjoints else weight
        for k in reversed(self.order):
            if k in adjoints and k not in self.arguments:
                for x, c in self.reads[k].items():
                    part = tape.product(adjoints[k], c)
                    adjoints[x] = tape.total(adjoints[x], part) if x in adjoints else part
        return adjoints

    def bend(self, adjoints: dict[int, int]) -> None:
        """Add the second derivatives of each operation, times its adjoint, to the curvature."""
        for k, own in self._second.items():
            if k in adjoints:
                for x, y, w in own:
                    self._bent(x, y, self.tape.product(adjoints[k], w))

    def _bent(self, x: int, y: int, w: int) -> None:
        row = self.curvature.setdefault(x, {})
        value = row[y] = self.tape.total(row[y], w) if y in row else w
        if x != y:
            self.curvature.setdefault(y, {})[x] = value

    def simple(self, k: int, curved: bool = False) -> bool:
        """Return whether eliminating k causes no fill-in."""
        if len(self.reads[k]) <= 1:
            return True
        more = len(self.curvature.get(k, ())) if curved else 0
        return len(self.readers[k]) + more <= 1

    def eliminate(self, priority: Priority) -> None:
        """Eliminate all operations except arguments and results, in increasing order of priority."""
        remaining = {k for k in self.order if k not in self.arguments}
        now = {k: priority(self, k) for k in remaining}
        heap = [(p, k) for k, p in now.items()]
        heapq.heapify(heap)
        while heap:
            p, k = heapq.heappop(heap)
            if k not in remaining or now[k] != p:
                continue
            remaining.discard(k)
            for x in self._eliminated(k):
                if x in remaining and (p := priority(self, x)) != now[x]:
                    now[x] = p
                    heapq.heappush(heap, (p, x))

    def _eliminated(self, k: int) -> set[int]:
        """Eliminate operation k; return the operations whose neighbours have changed."""
        tape, reads, readers = self.tape, self.reads, self.readers
        operands, dependents = reads.pop(k), readers.pop(k)
        for reader in dependents:
            row = reads[reader]
            c = row.pop(k)
            for x, d in operands.items():
                part = tape.product(c, d)
                if x in row:
                    row[x] = tape.total(row[x], part)
                else:
                    row[x] = part
                    readers[x].add(reader)
        for x in operands:
            readers[x].discard(k)
        changed = dependents.union(operands)
        bent = self.curvature.pop(k, None)
        if bent:
            twice = bent.pop(k, None)
            if twice is not None:
                items = list(operands.items())
                for n, (x, c) in enumerate(items):
                    part = tape.product(twice, c)
                    for y, d in items[n:]:
                        self._bent(x, y, tape.product(part, d))
            for y, w in bent.items():
                del self.curvature[y][k]
                for x, c in operands.items():
                    part = tape.product(c, w)
                    self._bent(x, y, _twice(tape, part) if x == y else part)
            changed.update(bent)
        return changed


def _twice(tape: Tape, k: int) -> int:
    return tape.product(tape.constant(2.0), k)


def _partials(tape: Tape, k: int) -> tuple[list[int], list[int]]:
    """Return the first derivatives of operation k by its operands, and the second ones: xx, xy, yy for two operands."""
    op, operands = tape.op[k], tape.operands(k)
    zero, one = tape.constant(0.0), tape.constant(1.0)
    if op == ca.OP_ADD:
        return [one, one], [zero] * 3
    if op == ca.OP_SUB:
        return [one, tape.constant(-1.0)], [zero] * 3
    if op == ca.OP_MUL:
        return [operands[1], operands[0]], [zero, one, zero]
    if op == ca.OP_NEG:
        return [tape.constant(-1.0)], [zero]
    if op == ca.OP_TWICE:
        return [tape.constant(2.0)], [zero]
    if op == ca.OP_SQ:
        return [tape.total(operands[0], operands[0])], [tape.constant(2.0)]
    if op == ca.OP_DIV:
        inverse = tape.applied(ca.OP_INV, operands[1])
        by_y = tape.negative(tape.product(k, inverse))
        mixed = tape.negative(tape.product(inverse, inverse))
        return [inverse, by_y], [zero, mixed, tape.negative(_twice(tape, tape.product(by_y, inverse)))]
    results = tape.taken(_pattern(op, len(operands)), operands)
    return results[: len(operands)], results[len(operands) :]


@cache
def _pattern(op: int, count: int) -> list[Instruction]:
    """Return the instructions of CasADi's derivatives of an operation."""
    x = [ca.SX.sym("x") for _ in range(count)]
    value = ca.SX.unary(op, *x) if count == 1 else ca.SX.binary(op, *x)
    first = ca.gradient(value, ca.vertcat(*x))
    second = ca.jacobian(first, ca.vertcat(*x))
    entries = [first[i] for i in range(count)] + [second[i, j] for i in range(count) for j in range(i, count)]
    return instructions(ca.Function("f", [ca.vertcat(*x)], [ca.densify(ca.vertcat(*entries))]))
