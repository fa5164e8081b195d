"""Column kernels: functions on many rows with NumPy, block by block, with the same results as CasADi's virtual machine;
and the choice of functions that get a kernel."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Protocol

import casadi as ca
import numpy as np

from ..tape.machine import AT_ONCE, Interpreted, interpreter
from .machine import MachineCode, Prospect
from .program import LIBM, ColumnProgram, Step, on_columns, program_of

# rows of a block: some thirty columns fit into the L2 cache, and the overhead of a call is small
BLOCK = 4096
# rows are computed in multiples of PIECE; an elementwise function takes TAKEN rows at once
PIECE = 256
TAKEN = 64

_UFUNC: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: np.positive, ca.OP_ADD: np.add, ca.OP_SUB: np.subtract, ca.OP_MUL: np.multiply, ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative, ca.OP_SQ: np.square, ca.OP_SQRT: np.sqrt, ca.OP_FABS: np.absolute, ca.OP_FLOOR: np.floor,
    ca.OP_CEIL: np.ceil, ca.OP_LT: np.less, ca.OP_LE: np.less_equal, ca.OP_EQ: np.equal, ca.OP_NE: np.not_equal,
    ca.OP_NOT: np.logical_not, ca.OP_AND: np.logical_and, ca.OP_OR: np.logical_or,
}  # fmt: skip
_ONE = np.array(1.0)


class Workspace:
    """The memory of one run: a column for each place, and the steps bound to its first rows, by number of rows."""

    def __init__(self, program: ColumnProgram, rows: int = BLOCK) -> None:
        self._program = program
        self._bound: dict[int, list[Callable[[], Any]]] = {}
        self.columns = np.zeros((program.places, rows))
        for place, value in program.constants:
            self.columns[place] = value

    def run(self, rows: int) -> None:
        """Run all steps on the first rows, a multiple of TAKEN."""
        steps = self._bound.get(rows)
        if steps is None:
            # all steps share one array for each place and constant, so that they stay in the cache
            columns, constants = list(self.columns[:, :rows]), dict[tuple[float, float], np.ndarray]()
            steps = self._bound[rows] = [_bound(s, columns, constants) for s in self._program.steps]
        for step in steps:
            step()


def _bound(
    step: Step, columns: Sequence[np.ndarray], constants: dict[tuple[float, float], np.ndarray]
) -> Callable[[], Any]:
    target = columns[step.target]
    if step.op in LIBM:
        given = [np.full(len(target), x) if isinstance(x, float) else columns[x] for x in step.operands]
        return _called(step.op, given, target)
    operands = [
        constants.setdefault((x, math.copysign(1.0, x)), np.array(x)) if isinstance(x, float) else columns[x]
        for x in step.operands
    ]
    if step.op == ca.OP_TWICE:
        return partial(np.add, operands[0], operands[0], target)
    if step.op == ca.OP_INV:
        return partial(np.divide, _ONE, operands[0], target)
    if step.op == ca.OP_IF_ELSE_ZERO:
        return partial(_if_else_zero, *operands, target)  # pyrefly: ignore[bad-argument-count]
    return partial(_UFUNC[step.op], *operands, target)


def _if_else_zero(condition: np.ndarray, value: np.ndarray, target: np.ndarray) -> None:
    target.fill(0.0)
    np.copyto(target, value, where=condition != 0.0)


def _in_doubles(column: np.ndarray) -> np.ndarray:
    """Return a column that C can read: aligned doubles with strides of whole doubles."""
    column = np.asarray(column, dtype=float)
    return column if column.flags.aligned and not any(s % 8 for s in column.strides) else column.copy()


def _called(op: int, given: Sequence[Any], target: Any) -> Callable[[], Any]:
    """Return a libm operation on columns, computed by CasADi's virtual machine in their memory."""
    buffer: Any
    buffer, run = _elementwise(op, len(given), len(target)).buffer()
    for k, column in enumerate(given):
        buffer.set_arg(k, memoryview(column))  # pyrefly: ignore[missing-argument]
    buffer.set_res(0, memoryview(target))  # pyrefly: ignore[missing-argument]
    return partial(_run, run, buffer, given)


def _run(run: Callable[[], Any], *_kept: Any) -> None:
    run()


@cache
def _elementwise(op: int, arguments: int, rows: int) -> ca.Function:
    x = [ca.SX.sym("x", TAKEN) for _ in range(arguments)]
    pow_ = ca.OP_POW if op == ca.OP_CONSTPOW else op
    y = ca.SX.unary(op, *x) if arguments == 1 else ca.SX.binary(pow_, *x)
    return ca.Function("elementwise", x, [y]).map(rows // TAKEN)


class Judge(Protocol):
    """Computes the status codes of rows, block by block."""

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """(low, high, weight, most): a row with finite outputs is clearly good if each margin is above `low` or below
        `high`, and the sum of squares of all inputs, weighted with `weight`, is at most `most`."""
        ...

    def codes(
        self, rows: slice, inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray], plainly: bool
    ) -> np.ndarray | None:
        """Return the codes of these rows from their inputs and outputs as columns, margins last; None if all are 0.

        plainly: all rows satisfy `limits`; inputs and outputs are not needed.
        """
        ...


class ColumnKernel:
    """A program with its memory; several threads may share it."""

    def __init__(self, program: ColumnProgram) -> None:
        self.program = program
        self.machine = Prospect(program)
        self._idle: list[Workspace] = []  # one for each thread that ran at the same time

    def run(
        self, columns: Sequence[np.ndarray], judge: Judge | None = None, answers: bool = False
    ) -> tuple[list[np.ndarray], np.ndarray | None]:
        """Evaluate inputs (size, n); return outputs (n, entries) and, with a judge, status codes (n,).

        answers: leave out the last output, the margins, and set rows with a nonzero code to NaN.
        """
        n = columns[0].shape[1]
        sizes = [s.stop - s.start for s in self.program.outputs]
        results = [np.empty((n, size)) for size in (sizes[:-1] if answers else sizes)]
        codes = np.zeros(n, dtype=int) if judge is not None else None
        machine = self.machine.of(n)
        if machine is None:
            blocks = self._by_numpy(columns, results, judge)
        else:
            blocks = self._by_machine(machine, [_in_doubles(c) for c in columns], results, judge)
        for rows, code in blocks:
            if code is None or codes is None:
                continue
            codes[rows] = code
            if answers:
                bad = rows.start + np.flatnonzero(code)
                for result in results:
                    result[bad] = np.nan
        return results, codes

    def _by_numpy(
        self, columns: Sequence[np.ndarray], results: Sequence[np.ndarray], judge: Judge | None
    ) -> Iterator[tuple[slice, np.ndarray | None]]:
        """Fill the results with NumPy; yield the codes of each block of rows."""
        n, program = columns[0].shape[1], self.program
        space = self._idle.pop() if self._idle else Workspace(program)
        work = space.columns
        for begin in range(0, n, BLOCK):
            rows = slice(begin, min(begin + BLOCK, n))
            size = rows.stop - begin
            whole = -(-size // PIECE) * PIECE
            for places, column in zip(program.inputs, columns, strict=True):
                if column.strides[1] == 0:  # the same for all rows
                    if begin == 0:
                        work[places] = column[:, :1]
                    continue
                work[places, :size] = column[:, rows]
                if size < whole:  # repeat the last row as padding
                    work[places, size:whole] = column[:, rows.stop - 1 : rows.stop]
            with np.errstate(all="ignore"):
                space.run(whole)
            for places, result in zip(program.outputs, results, strict=False):
                for k, row in enumerate(work[places, :size]):
                    result[rows, k] = row
            if judge is not None:
                given, got = ([work[s, :size] for s in slices] for slices in (program.inputs, program.outputs))
                yield rows, judge.codes(rows, given, got, False)
        self._idle.append(space)

    def _by_machine(
        self, machine: MachineCode, columns: Sequence[np.ndarray], results: Sequence[np.ndarray], judge: Judge | None
    ) -> Iterator[tuple[slice, np.ndarray | None]]:
        """Fill the results with machine code; margins that are not results are recomputed for possibly bad blocks."""
        n, last = columns[0].shape[1], len(self.program.outputs) - 1
        wanted = [*results, *[None] * (last + 1 - len(results))]
        run = machine.bound(columns, wanted, None if judge is None else judge.limits)
        if judge is None:
            run(0, n)
            return
        for begin in range(0, n, BLOCK):
            rows = slice(begin, min(begin + BLOCK, n))
            if not run(begin, rows.stop):
                yield rows, judge.codes(rows, [], [], True)
                continue
            given, got = [c[:, rows] for c in columns], [r[rows] for r in results]
            if len(results) == last:
                places = self.program.outputs[-1]
                got.append(np.empty((rows.stop - begin, places.stop - places.start)))
                machine.bound(given, [*[None] * last, got[-1]])(0, rows.stop - begin)
            yield rows, judge.codes(rows, given, [g.T for g in got], False)


# rows of a call from which a kernel is faster, and total rows from which creating it pays: reading an instruction
# costs as much as CasADi's virtual machine needs for it on some thousand rows
FEWEST, PAID = 128, 1024
KEPT = 64  # functions


@dataclass
class _Entry:
    """A function, kept alive so that its hash stays unique, with the number of rows evaluated so far."""

    function: ca.Function
    rows: int = 0
    kernel: ColumnKernel | None = None
    impossible: bool = False


_entries: OrderedDict[int, _Entry] = OrderedDict()


def kernel_of(f: ca.Function, rows: int) -> ColumnKernel | None:
    """Return the kernel for a call on this number of rows; None if CasADi's virtual machine should evaluate them."""
    if rows < FEWEST:
        return None
    key = f.__hash__()
    entry = _entries.setdefault(key, _Entry(f))
    try:
        _entries.move_to_end(key)
        while len(_entries) > KEPT:
            _entries.popitem(last=False)
    except KeyError:
        pass  # another thread has just removed it
    entry.rows += rows
    if entry.kernel is None and not entry.impossible and entry.rows >= PAID:
        program = program_of(f)
        entry.impossible = program is None
        entry.kernel = None if program is None else ColumnKernel(program)
    return entry.kernel


# seconds of an operation in the virtual machine at one point; typical number of calls by a solver
OPERATION, CALLS = 7e-9, 30
# Seconds in the virtual machine from which an existing interpreter is used: reading an operation takes 2.5 us, a call
# some 20 us. Seconds of all functions of a process from which the interpreter is built, which takes half a second once
# per machine.
USED, BUILT = 0.01, 1.0
# Points from which NumPy is used if there is no interpreter: an operation takes 0.4 us for all points, twice that if a
# solver has used the cache in between, and binding it to its columns takes 6 us once.
MANY = 256


@dataclass
class _Asked:
    """Seconds that all functions of this process would have taken in the virtual machine."""

    seconds: float = 0.0


_asked = _Asked()


def mapped(f: ca.Function, points: int) -> ca.Function:
    """Return f mapped to many points, with matrices that have a column per point; results equal f's to the last bit.

    The result may be a `Batch`, which has no derivatives and must be kept alive as long as a function that calls it.

    >>> import casadi as ca
    >>> from gtmodel.compiler.columns.kernel import mapped
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
    """Return f for the interpreter in C if that pays and the interpreter is available."""
    seconds = f.n_instructions() * points * OPERATION * CALLS if on_columns(f) else 0.0
    if seconds < USED or points < AT_ONCE:
        return None
    _asked.seconds += seconds
    library = interpreter(_asked.seconds >= BUILT)
    return None if library is None else Interpreted.of_function(library, f)


class PointProgram(Protocol):
    """A program that evaluates many points at once; `inputs` and `outputs`: numbers of entries at each point."""

    inputs: list[int]
    outputs: list[int]

    def __call__(self, inputs: Sequence[np.ndarray | None], outputs: Sequence[np.ndarray | None], points: int) -> None:
        """Evaluate; arrays are float64, one point after another. An input None is zero, an output None is skipped."""
        ...


class Batch(ca.Callback):
    """A program as a CasADi function of matrices with a column per point.

    It has no derivatives and must be kept alive as long as a function that calls it.
    """

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
    """A program on columns with memory for a fixed number of points; for one thread."""

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
                columns[places, points:] = columns[places, points - 1 : points]  # padding
        with np.errstate(all="ignore"):
            self._work.run(columns.shape[1])
        for places, wanted in zip(self._program.outputs, outputs, strict=True):
            if wanted is not None and wanted.size:
                wanted.reshape(points, -1)[:] = columns[places, :points].T
