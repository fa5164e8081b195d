"""A function on columns of rows by NumPy, block by block, with the numbers of CasADi's virtual machine, and which
functions have one."""

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

# rows of a block: some thirty columns of them stay in a core's second cache, and a call costs less than its numbers
BLOCK = 4096
# rows are computed by multiples of it; and what an elementwise function takes at once
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
    """The memory of one run: a column for each place, and the steps bound to its first rows, by their number."""

    def __init__(self, program: ColumnProgram, rows: int = BLOCK) -> None:
        self._program = program
        self._bound: dict[int, list[Callable[[], Any]]] = {}
        self.columns = np.zeros((program.places, rows))
        for place, value in program.constants:
            self.columns[place] = value

    def run(self, rows: int) -> None:
        """All steps on the first rows, a multiple of TAKEN."""
        steps = self._bound.get(rows)
        if steps is None:
            # one array for each place and constant, which all steps share: they stay in the cache
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
        return partial(_if_else_zero, *operands, target)
    return partial(_UFUNC[step.op], *operands, target)


def _if_else_zero(condition: np.ndarray, value: np.ndarray, target: np.ndarray) -> None:
    target.fill(0.0)
    np.copyto(target, value, where=condition != 0.0)


def _in_doubles(column: np.ndarray) -> np.ndarray:
    """As C reads it: numbers that are doubles, whole doubles apart."""
    column = np.asarray(column, dtype=float)
    return column if column.flags.aligned and not any(s % 8 for s in column.strides) else column.copy()


def _called(op: int, given: Sequence[Any], target: Any) -> Callable[[], Any]:
    """An operation of libm on columns, by CasADi's virtual machine on their memory."""
    buffer: Any
    buffer, run = _elementwise(op, len(given), len(target)).buffer()
    for k, column in enumerate(given):
        buffer.set_arg(k, memoryview(column))
    buffer.set_res(0, memoryview(target))
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
    """Gives rows their status codes, block by block."""

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Rows whose outputs are finite are plainly good where each margin is above the first or below the second, and
        the sum of squares of the entries of all inputs, weighted by the third, at most the fourth."""
        ...

    def codes(
        self, rows: slice, inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray], plainly: bool
    ) -> np.ndarray | None:
        """Of these rows, from their inputs and outputs as columns, margins last; None where all are 0. `plainly`:
        `limits` are kept by all, and inputs and outputs are not needed."""
        ...


class ColumnKernel:
    """A program with its memory; threads may share it."""

    def __init__(self, program: ColumnProgram) -> None:
        self.program = program
        self.machine = Prospect(program)
        self._idle: list[Workspace] = []  # as many as threads have run at the same time

    def run(
        self, columns: Sequence[np.ndarray], judge: Judge | None = None, answers: bool = False
    ) -> tuple[list[np.ndarray], np.ndarray | None]:
        """Inputs (size, n) -> outputs (n, entries) and, with a judge, status codes (n,).

        answers: without the last output, the margins, and NaN where a row has a code.
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
        """Fill the results; the codes of each block of rows."""
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
                if size < whole:  # more of the same, so that nothing odd is computed
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
        """The same. Margins that nobody wants are computed again, for blocks where one may be bad."""
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


# rows of a call from which a kernel is the faster one, and rows in all after which making it has paid: reading an
# instruction costs as much as CasADi's virtual machine takes for it on some thousand rows
FEWEST, PAID = 128, 1024
KEPT = 64  # functions


@dataclass
class _Entry:
    """A function, which is held so that its number stays its own, with the rows seen so far."""

    function: ca.Function
    rows: int = 0
    kernel: ColumnKernel | None = None
    impossible: bool = False


_entries: OrderedDict[int, _Entry] = OrderedDict()


def kernel_of(f: ca.Function, rows: int) -> ColumnKernel | None:
    """The kernel for a call on so many rows; None where CasADi's virtual machine is to take them."""
    if rows < FEWEST:
        return None
    key = f.__hash__()
    entry = _entries.setdefault(key, _Entry(f))
    try:
        _entries.move_to_end(key)
        while len(_entries) > KEPT:
            _entries.popitem(last=False)
    except KeyError:
        pass  # another thread has just taken it away
    entry.rows += rows
    if entry.kernel is None and not entry.impossible and entry.rows >= PAID:
        program = program_of(f)
        entry.impossible = program is None
        entry.kernel = None if program is None else ColumnKernel(program)
    return entry.kernel


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
