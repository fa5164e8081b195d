"""Numbers of a tape as a function of CasADi, of one point or of many, and from a tape back to its expressions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from ..columns.kernel import Batch
from .machine import Interpreted, interpreter, known
from .operations import NONE, Tape


def written(tape: Tape, numbers: Sequence[int], symbols: ca.SX) -> ca.SX:
    """A column with these numbers of the tape, the symbols at its inputs."""
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
    made = ca.SX.zeros(len(level), 1)
    begin = 0
    for (_, op), own in sorted(groups.items()):
        x = [tape.first[k] for k in own]
        if op == ca.OP_INPUT:
            value = symbols[x]
        elif op == ca.OP_CONST:
            value = ca.SX(ca.DM([tape.constants[k] for k in own]))
        elif tape.second[own[0]] == NONE:
            value = ca.SX.unary(op, made[[place[i] for i in x]])
        else:
            y = [place[tape.second[k]] for k in own]
            value = ca.SX.binary(op, made[[place[i] for i in x]], made[y])
        made[begin : begin + len(own)] = value
        place.update(zip(own, range(begin, begin + len(own)), strict=True))
        begin += len(own)
    return made[[place[k] for k in numbers]]


# seconds that CasADi's virtual machine takes for an operation of a large function; how often a solver asks for it
OPERATION, CALLS = 4e-9, 30
# seconds of the virtual machine from which the interpreter is used where it is there, and from which it is built
USED, BUILT = 0.05, 1.0


class TapeFunction:
    """Columns of numbers on a tape, of arguments that are columns too and have the tape's inputs one after the other.

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
        self._maps: dict[int, ca.Function] = {}  # held: a Batch lives no longer than somebody holds it

    @cached_property
    def casadi(self) -> ca.Function:
        """Of one point."""
        column = written(self._tape, [k for numbers in self._outputs for k in numbers], ca.vertcat(*self._arguments))
        ends = np.cumsum([0, *map(len, self._outputs)]).tolist()
        return ca.Function(self.name, self._arguments, ca.vertsplit(column, ends))

    def map(self, points: int) -> ca.Function:
        """Of many points, a column for each. Where it pays and there is a C compiler, by the interpreter: the numbers
        are the same but for round-off, and the function has no derivatives; this object is to be held as long as it is
        in use."""
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
