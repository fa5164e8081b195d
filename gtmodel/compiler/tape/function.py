"""Numbers of a tape as a function of CasADi, of one point or of many."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from ..columns.batch import Batch
from .expressions import written
from .machine import Interpreted, interpreter, known
from .operations import Tape

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
