"""A function of one point as one of many points: CasADi's virtual machine takes them one after the other, the
interpreter in C and NumPy an operation for many of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np

from ..tape.machine import AT_ONCE, Interpreted, interpreter
from .kernel import TAKEN, Workspace
from .program import ColumnProgram, on_columns, program_of

# seconds that an operation takes the virtual machine at a point; how often a solver asks for a function
OPERATION, CALLS = 7e-9, 30
# Seconds of the virtual machine from which the interpreter is used where it is there: to read an operation takes
# 2.5 us, and a call some 20 us. Seconds that all functions of a process would take from which it is built, which takes
# half of one, once on a machine.
USED, BUILT = 0.01, 1.0
# Points from which NumPy takes the columns where there is no interpreter: an operation costs it 0.4 us for all, twice
# that where a solver has used the cache in between, and to bind it to its columns takes 6 us, which the solver's calls
# are to pay.
MANY = 256


@dataclass
class _Asked:
    """Seconds of the virtual machine that all functions of this process would have taken."""

    seconds: float = 0.0


_asked = _Asked()


def mapped(f: ca.Function, points: int) -> ca.Function:
    """f of many points, matrices with a column for each: the numbers are f's to the last bit.

    What is returned may be a `Batch`: it has no derivatives, and is to be held as long as a function that calls it.

    >>> import casadi as ca
    >>> from gtmodel.compiler.columns.batch import mapped
    >>> x = ca.SX.sym("x", 2)
    >>> product = mapped(ca.Function("f", [x], [x[0] * x[1]]), 400)
    >>> product(ca.repmat(ca.DM([2.0, 3.0]), 1, 400))[-1]
    DM(6)
    """
    program = _interpreted(f, points)
    if program is None and points >= MANY and (columns := program_of(f)) is not None:
        program = _Columns(columns, points)
    return f.map(points) if program is None else Batch(f"{f.name()}_{points}", program, points)


def _interpreted(f: ca.Function, points: int) -> PointProgram | None:
    """By the interpreter in C, where it pays and where it is there."""
    seconds = f.n_instructions() * points * OPERATION * CALLS if on_columns(f) else 0.0
    if seconds < USED or points < AT_ONCE:
        return None
    _asked.seconds += seconds
    library = interpreter(_asked.seconds >= BUILT)
    return None if library is None else Interpreted.of_function(library, f)


class PointProgram(Protocol):
    """What computes many points at once; how many numbers its inputs and its outputs have at each."""

    inputs: list[int]
    outputs: list[int]

    def __call__(self, inputs: Sequence[np.ndarray | None], outputs: Sequence[np.ndarray | None], points: int) -> None:
        """Inputs and outputs of float64, the numbers of one point behind those of another; of inputs None for zeros, of
        outputs None for what is not wanted."""
        ...


class Batch(ca.Callback):
    """A program as a function of CasADi: matrices with a column for each point. It is to be held as long as a function
    that calls it, and has no derivatives."""

    def __init__(self, name: str, program: PointProgram, points: int) -> None:
        super().__init__()
        self._program, self._points = program, points
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._program.inputs)

    def get_n_out(self) -> int:
        return len(self._program.outputs)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._program.inputs[i], self._points)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._program.outputs[i], self._points)

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arg: Sequence[memoryview | None], res: Sequence[memoryview | None]) -> int:
        given, wanted = ([None if m is None else np.frombuffer(m) for m in each] for each in (arg, res))
        self._program(given, wanted, self._points)
        return 0


class _Columns:
    """A program on columns that have memory for so many points; for one thread."""

    def __init__(self, program: ColumnProgram, points: int) -> None:
        self._program = program
        self._work = Workspace(program, -(-points // TAKEN) * TAKEN)
        self.inputs, self.outputs = ([s.stop - s.start for s in each] for each in (program.inputs, program.outputs))

    def __call__(self, inputs: Sequence[np.ndarray | None], outputs: Sequence[np.ndarray | None], points: int) -> None:
        columns = self._work.columns
        for places, given in zip(self._program.inputs, inputs, strict=True):
            if given is None:
                columns[places] = 0.0
            elif given.size:
                columns[places, :points] = given.reshape(points, -1).T
                columns[places, points:] = columns[places, points - 1 : points]  # so that nothing odd is computed
        with np.errstate(all="ignore"):
            self._work.run(columns.shape[1])
        for places, wanted in zip(self._program.outputs, outputs, strict=True):
            if wanted is not None and wanted.size:
                wanted.reshape(points, -1)[:] = columns[places, :points].T
