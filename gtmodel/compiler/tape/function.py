"""Entries of a tape as a CasADi function of one or many points, and as CasADi expressions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from ..columns.kernel import Batch
from .machine import Interpreted, interpreter, known
from .operations import NONE, Tape


def written(tape: Tape, numbers: Sequence[int], symbols: ca.SX) -> ca.SX:
    """Return a column with these entries of the tape as expressions of the symbols at its inputs."""
    if not len(numbers):
        return ca.SX(0, 1)
    groups: dict[tuple[int, int], list[int]] = {}  # by level and operation
    level: dict[int, int] = {}
    for k in tape.needed(numbers):
        op = tape.op[k]
        if op in (ca.OP_INPUT, ca.OP_CONST):
            level[k] = 0
        else:
            y = tape.second[k]
            level[k] = 1 + (level[tape.first[k]] if y == NONE else max(level[tape.first[k]], level[y]))
        groups.setdefault((level[k], op), []).append(k)
    place: dict[int, int] = {}
    entries = ca.SX.zeros(len(level), 1)
    begin = 0
    for (_, op), members in sorted(groups.items()):
        x = [tape.first[k] for k in members]
        if op == ca.OP_INPUT:
            value = symbols[x]
        elif op == ca.OP_CONST:
            value = ca.SX(ca.DM([tape.constants[k] for k in members]))
        elif tape.second[members[0]] == NONE:
            value = ca.SX.unary(op, entries[[place[i] for i in x]])
        else:
            y = [place[tape.second[k]] for k in members]
            value = ca.SX.binary(op, entries[[place[i] for i in x]], entries[y])
        entries[begin : begin + len(members)] = value
        place.update(zip(members, range(begin, begin + len(members)), strict=True))
        begin += len(members)
    return entries[[place[k] for k in numbers]]


# seconds of an operation of a large function in CasADi's virtual machine; typical number of calls by a solver
OPERATION, CALLS = 4e-9, 30
# seconds in the virtual machine from which an existing interpreter is used, and from which it is built
USED, BUILT = 0.05, 1.0


class TapeFunction:
    """Columns of entries of a tape as a function; the arguments are columns that hold the tape's inputs in order.

    >>> import casadi as ca
    >>> from gtmodel.compiler.tape.function import TapeFunction
    >>> from gtmodel.compiler.tape.operations import Tape, read_in
    >>> x, tape = ca.SX.sym("x", 2), Tape()
    >>> product = TapeFunction("f", tape, [x], [read_in(tape, x[0] * x[1], x)])
    >>> product.map(3)(ca.DM([[1, 2, 3], [4, 5, 6]]))
    DM([[4, 10, 18]])
    """

    def __init__(self, name: str, tape: Tape, arguments: Sequence[ca.SX], outputs: Sequence[Sequence[int]]) -> None:
        self.name = name
        self._tape, self._arguments, self._outputs = tape, list(arguments), list(outputs)
        self._maps: dict[int, ca.Function] = {}  # keeps each Batch alive

    @cached_property
    def casadi(self) -> ca.Function:
        """The function at one point."""
        column = written(self._tape, [k for numbers in self._outputs for k in numbers], ca.vertcat(*self._arguments))
        ends = np.cumsum([0, *map(len, self._outputs)]).tolist()
        return ca.Function(self.name, self._arguments, ca.vertsplit(column, ends))

    def map(self, points: int) -> ca.Function:
        """Return the function of many points, with a column per point.

        If it pays and there is a C compiler, the interpreter is used: results are equal up to round-off, the function
        has no derivatives, and this object must be kept alive as long as the function is used.
        """
        if points not in self._maps:
            seconds = len(self._tape.op) * points * OPERATION * CALLS
            library = interpreter(seconds >= BUILT) if seconds >= USED and known(self._tape) else None
            if library is None:
                self._maps[points] = self.casadi.map(points)
            else:
                sizes = [a.numel() for a in self._arguments]
                program = Interpreted.of_tape(library, self._tape, sizes, self._outputs)
                self._maps[points] = Batch(f"{self.name}_{points}", program, points)
        return self._maps[points]
