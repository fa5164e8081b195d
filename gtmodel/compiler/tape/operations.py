"""A tape: operations with numbers, each written once; what is asked of it is worked with as whole numbers.

A CasADi expression costs some microseconds for each operation that Python makes, and a pass over it for common
subexpressions costs as much again. On a tape nothing is written twice, so that no such pass is needed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import casadi as ca

from ..rewriting import Instruction, instructions

NONE = -1  # where an operation has no second operand
_SYMMETRIC = frozenset([ca.OP_ADD, ca.OP_MUL, ca.OP_FMIN, ca.OP_FMAX, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR])
_ORDERED = frozenset([ca.OP_FMIN, ca.OP_FMAX])  # of equal zeros the first counts: not exchanged


class Tape:
    """Operations in order: number k is `op[k]` of the numbers `first[k]` and `second[k]`; of an input `first[k]` is its
    place, of a constant `constants[k]` its value.

    >>> from gtmodel.compiler.tape.operations import Tape
    >>> tape = Tape()
    >>> x, y = tape.input(0), tape.input(1)
    >>> tape.product(x, y) == tape.product(y, x), tape.product(x, tape.constant(1.0)) == x
    (True, True)
    """

    def __init__(self) -> None:
        self.op: list[int] = []
        self.first: list[int] = []
        self.second: list[int] = []
        self.constants: dict[int, float] = {}
        self._numbers: dict[tuple[int, int, int], int] = {}
        self._values: dict[tuple[float, float], int] = {}

    def _written(self, op: int, x: int, y: int = NONE) -> int:
        """As it is."""
        if x > y >= 0 and op in _SYMMETRIC and op not in _ORDERED:
            x, y = y, x
        key = (op, x, y)
        k = self._numbers.get(key)
        if k is None:
            k = self._numbers[key] = len(self.op)
            self.op.append(op)
            self.first.append(x)
            self.second.append(y)
        return k

    def constant(self, value: float) -> int:
        key = (value, math.copysign(1.0, value))
        k = self._values.get(key) if value == value else None
        if k is None:
            k = self._values[key] = len(self.op)
            self.op.append(ca.OP_CONST)
            self.first.append(NONE)
            self.second.append(NONE)
            self.constants[k] = value
        return k

    def input(self, place: int) -> int:
        return self._written(ca.OP_INPUT, place)

    def negative(self, x: int) -> int:
        if self.op[x] == ca.OP_NEG:
            return self.first[x]
        return self.constant(-self.constants[x]) if x in self.constants else self._written(ca.OP_NEG, x)

    def product(self, x: int, y: int) -> int:
        """Zeros and ones vanish, signs go before it."""
        constants = self.constants
        if x in constants:
            x, y = y, x
        if y in constants:
            c = constants[y]
            if x in constants:
                return self.constant(constants[x] * c)
            if c == 0.0:
                return y
            if c == 1.0:
                return x
            if c == -1.0:
                return self.negative(x)
            if c == 2.0:
                return self.total(x, x)
        op = self.op
        signs = (op[x] == ca.OP_NEG, op[y] == ca.OP_NEG)
        x, y = self.first[x] if signs[0] else x, self.first[y] if signs[1] else y
        if op[x] == ca.OP_INV:
            x, y = y, x
        if x == y:
            k = self._written(ca.OP_SQ, x)
        else:
            k = self._written(ca.OP_DIV, x, self.first[y]) if op[y] == ca.OP_INV else self._written(ca.OP_MUL, x, y)
        return k if signs[0] == signs[1] else self.negative(k)

    def total(self, x: int, y: int) -> int:
        """x + y, a difference where one has a sign before it."""
        constants = self.constants
        if x in constants and y in constants:
            return self.constant(constants[x] + constants[y])
        if constants.get(x) == 0.0:
            return y
        if constants.get(y) == 0.0:
            return x
        if self.op[x] == ca.OP_NEG:
            if self.op[y] == ca.OP_NEG:
                return self.negative(self.total(self.first[x], self.first[y]))
            return self.difference(y, self.first[x])
        if self.op[y] == ca.OP_NEG:
            return self.difference(x, self.first[y])
        return self._written(ca.OP_TWICE, x) if x == y else self._written(ca.OP_ADD, x, y)

    def difference(self, x: int, y: int) -> int:
        if x == y:
            return self.constant(0.0)
        return self._written(ca.OP_SUB, x, y)

    def applied(self, op: int, x: int, y: int = NONE) -> int:
        """The operation of that code."""
        if op == ca.OP_ADD:
            return self.total(x, y)
        if op == ca.OP_MUL:
            return self.product(x, y)
        if op == ca.OP_NEG:
            return self.negative(x)
        return x if op == ca.OP_ASSIGN else self._written(op, x, y)

    def taken(self, read: Iterable[Instruction], arguments: Sequence[int]) -> list[int]:
        """What the instructions give of arguments that stand on the tape."""
        made: list[int] = []
        results: dict[int, int] = {}
        for op, reads, place, value in read:
            if op == ca.OP_INPUT:
                made.append(arguments[place])
            elif op == ca.OP_CONST:
                made.append(self.constant(value))
            elif op == ca.OP_OUTPUT:
                results[place] = made[reads[0]]
                made.append(made[reads[0]])
            else:
                made.append(self.applied(op, *[made[i] for i in reads]))
        return [results[place] for place in sorted(results)]

    def operands(self, k: int) -> tuple[int, ...]:
        if self.op[k] in (ca.OP_INPUT, ca.OP_CONST):
            return ()
        return (self.first[k],) if self.second[k] == NONE else (self.first[k], self.second[k])

    def needed(self, numbers: Iterable[int]) -> list[int]:
        """These and all that they are made of, in order."""
        seen, left = set[int](), list(numbers)
        first, second, op = self.first, self.second, self.op
        while left:
            k = left.pop()
            if k not in seen:
                seen.add(k)
                if op[k] not in (ca.OP_INPUT, ca.OP_CONST):
                    left.append(first[k])
                    if second[k] != NONE:
                        left.append(second[k])
        return sorted(seen)


def read_in(tape: Tape, expression: ca.SX, symbols: ca.SX) -> list[int]:
    """The entries of a column, its symbols at places 0, 1, ... of the inputs."""
    f = ca.Function("f", [symbols], [ca.densify(expression)])
    return tape.taken(instructions(f), [tape.input(k) for k in range(symbols.numel())])


def parted(tape: Tape, numbers: Sequence[int], given: Sequence[int]) -> tuple[list[int], Tape, list[int]]:
    """What of these numbers depends on the inputs `given` alone is taken out: its numbers on this tape; a tape of the
    rest, whose first inputs, after the places of this tape's, are what was taken out; and the numbers on that."""
    alone = set(given)
    outside: dict[int, int] = {}
    rest = Tape()
    there: dict[int, int] = {}
    places = 1 + max((tape.first[k] for k in range(len(tape.op)) if tape.op[k] == ca.OP_INPUT), default=-1)

    def moved(k: int) -> int:
        if k in alone and tape.op[k] not in (ca.OP_CONST, ca.OP_INPUT):
            return rest.input(places + outside.setdefault(k, len(outside)))
        if k not in there:
            there[k] = rest.constant(tape.constants[k]) if k in tape.constants else rest.input(tape.first[k])
        return there[k]

    for k in tape.needed(numbers):
        operands = tape.operands(k)
        if not operands:
            if k in tape.constants:
                alone.add(k)
        elif all(x in alone for x in operands):
            alone.add(k)
        else:
            there[k] = rest.applied(tape.op[k], *[moved(x) for x in operands])
    results = [moved(k) for k in numbers]
    return list(outside), rest, results
