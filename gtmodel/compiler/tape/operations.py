"""A tape: numbered operations without duplicates; expressions are represented by their numbers.

In CasADi, each operation created from Python takes some microseconds, and a pass for common subexpressions takes as
much again. A tape never stores an operation twice, so it needs no such pass.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import casadi as ca

from ...lang.source import ModelError
from ..rewriting import CALLED, Instruction, instructions

NONE = -1  # instead of a missing second operand
_SYMMETRIC = frozenset([ca.OP_ADD, ca.OP_MUL, ca.OP_FMIN, ca.OP_FMAX, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR])
_ORDERED = frozenset([ca.OP_FMIN, ca.OP_FMAX])  # not exchanged: for zeros of different sign the result is the first


class Tape:
    """Operations in order: entry k is `op[k]` applied to the entries `first[k]` and `second[k]`. For an input
    `first[k]` is its place; `constants[k]` is the value of a constant.

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
        """Return the number of an operation, which is added if it is new."""
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
        """Return x * y; zeros and ones are eliminated, and signs are moved in front."""
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
        """Return x + y, as a difference if one is negated."""
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

    def applied(self, op: int, x: int, y: int = NONE, *more: int) -> int:
        """Return the operation with this code. Raises ModelError for a call of a function."""
        if op == ca.OP_CALL:
            raise ModelError(CALLED)
        if op == ca.OP_ADD:
            return self.total(x, y)
        if op == ca.OP_MUL:
            return self.product(x, y)
        if op == ca.OP_NEG:
            return self.negative(x)
        return x if op == ca.OP_ASSIGN else self._written(op, x, y)

    def taken(self, read: Iterable[Instruction], arguments: Sequence[int]) -> list[int]:
        """Append instructions whose arguments are on the tape; return the numbers of their outputs."""
        entries: list[int] = []
        results: dict[int, int] = {}
        for op, reads, place, value in read:
            if op == ca.OP_INPUT:
                entries.append(arguments[place])
            elif op == ca.OP_CONST:
                entries.append(self.constant(value))
            elif op == ca.OP_OUTPUT:
                results[place] = entries[reads[0]]
                entries.append(entries[reads[0]])
            else:
                entries.append(self.applied(op, *[entries[i] for i in reads]))
        return [results[place] for place in sorted(results)]

    def operands(self, k: int) -> tuple[int, ...]:
        if self.op[k] in (ca.OP_INPUT, ca.OP_CONST):
            return ()
        return (self.first[k],) if self.second[k] == NONE else (self.first[k], self.second[k])

    def needed(self, numbers: Iterable[int]) -> list[int]:
        """Return these entries and all that they depend on, in order."""
        visited, stack = set[int](), list(numbers)
        first, second, op = self.first, self.second, self.op
        while stack:
            k = stack.pop()
            if k not in visited:
                visited.add(k)
                if op[k] not in (ca.OP_INPUT, ca.OP_CONST):
                    stack.append(first[k])
                    if second[k] != NONE:
                        stack.append(second[k])
        return sorted(visited)


def read_in(tape: Tape, expression: ca.SX, symbols: ca.SX) -> list[int]:
    """Put the entries of a column on the tape, its symbols at inputs 0, 1, ...; return their numbers."""
    f = ca.Function("f", [symbols], [ca.densify(expression)])
    return tape.taken(instructions(f), [tape.input(k) for k in range(symbols.numel())])


def parted(tape: Tape, numbers: Sequence[int], given: Sequence[int]) -> tuple[list[int], Tape, list[int]]:
    """Split off the parts of these entries that depend only on the inputs `given`.

    Returns the numbers of these parts on this tape, a tape of the rest, which has them as inputs after the places of
    this tape's inputs, and the numbers of the entries on that tape.
    """
    alone = set(given)
    outside: dict[int, int] = {}
    rest = Tape()
    moved_numbers: dict[int, int] = {}
    places = 1 + max((tape.first[k] for k in range(len(tape.op)) if tape.op[k] == ca.OP_INPUT), default=-1)

    def moved(k: int) -> int:
        if k in alone and tape.op[k] not in (ca.OP_CONST, ca.OP_INPUT):
            return rest.input(places + outside.setdefault(k, len(outside)))
        if k not in moved_numbers:
            moved_numbers[k] = rest.constant(tape.constants[k]) if k in tape.constants else rest.input(tape.first[k])
        return moved_numbers[k]

    for k in tape.needed(numbers):
        operands = tape.operands(k)
        if not operands:
            if k in tape.constants:
                alone.add(k)
        elif all(x in alone for x in operands):
            alone.add(k)
        else:
            moved_numbers[k] = rest.applied(tape.op[k], *[moved(x) for x in operands])
    results = [moved(k) for k in numbers]
    return list(outside), rest, results
