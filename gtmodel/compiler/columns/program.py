"""Column programs: the instruction list of a function as steps on columns, with operation, operands and target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

# operations that IEEE 754 defines to the last bit
EXACT = frozenset([
    ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_NEG, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV, ca.OP_SQRT, ca.OP_FABS,
    ca.OP_FLOOR, ca.OP_CEIL, ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR,
    ca.OP_IF_ELSE_ZERO, ca.OP_ASSIGN,
])  # fmt: skip
# operations computed by libm, as in the virtual machine; functions with any other operation get no column program
LIBM = {
    ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan",
    ca.OP_ATAN2: "atan2", ca.OP_SINH: "sinh", ca.OP_COSH: "cosh", ca.OP_TANH: "tanh", ca.OP_EXP: "exp",
    ca.OP_LOG: "log", ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow", ca.OP_FMIN: "fmin", ca.OP_FMAX: "fmax",
    ca.OP_SIGN: "sign",
}  # fmt: skip


class Step(NamedTuple):
    """An operation on places (int) or constants (float), and the place of its result."""

    op: int
    operands: tuple[int | float, ...]
    target: int


@dataclass(frozen=True)
class ColumnProgram:
    """A function on columns.

    Places 0, 1, ... hold the entries of all inputs, then those of all outputs, then intermediate values; a place is
    reused as soon as its value is not needed any more. `constants`: constant outputs.
    """

    inputs: tuple[slice, ...]
    outputs: tuple[slice, ...]
    places: int
    steps: tuple[Step, ...]
    constants: tuple[tuple[int, float], ...]

    @property
    def calls(self) -> int:
        """Number of steps that call libm."""
        return sum(s.op in LIBM for s in self.steps)


def on_columns(f: ca.Function) -> bool:
    """Return whether a function has an instruction list, arguments that are dense single columns, and dense results."""
    if not f.is_a("SXFunction") or f.n_in() == 0:
        return False
    dense = [f.sparsity_in(k).is_dense() and f.size2_in(k) == 1 for k in range(f.n_in())]
    return all(dense) and all(f.sparsity_out(k).is_dense() for k in range(f.n_out()))


def program_of(f: ca.Function) -> ColumnProgram | None:
    """Return the program of a function with dense single-column inputs and dense outputs; None for other functions, and
    for unknown operations."""
    if not on_columns(f):
        return None
    inputs = _slices(0, [f.size1_in(k) for k in range(f.n_in())])
    outputs = _slices(inputs[-1].stop, [f.numel_out(k) for k in range(f.n_out())])
    read = [(f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)) for k in range(f.n_instructions())]
    steps: list[Step] = []
    constants: list[tuple[int, float]] = []
    written: dict[int, int | float] = {}  # of the work vector: a place, a constant or -1 - number of the step
    copies: list[tuple[int, int | float]] = []
    for k, (op, given, put) in enumerate(read):
        if op == ca.OP_INPUT:
            written[put[0]] = inputs[given[0]].start + given[1]
        elif op == ca.OP_CONST:
            written[put[0]] = float(f.instruction_constant(k))
        elif op == ca.OP_OUTPUT:
            copies.append((outputs[put[0]].start + put[1], written[given[0]]))
        elif op == ca.OP_ASSIGN:
            written[put[0]] = written[given[0]]
        elif op in EXACT or op in LIBM:
            steps.append(Step(op, tuple(written[i] for i in given), -len(steps) - 1))
            written[put[0]] = -len(steps)
        else:
            return None
    first = outputs[-1].stop if outputs else inputs[-1].stop
    settled: dict[int | float, int] = {}
    ends: list[Step] = []
    for place, value in copies:
        if isinstance(value, float):
            constants.append((place, value))
        elif value < 0 and value not in settled:
            settled[value] = place  # computed directly in the output
        else:
            ends.append(Step(ca.OP_ASSIGN, (settled.get(value, value),), place))  # pyrefly: ignore[bad-argument-type]
    placed, places = _placed(steps, settled, first)
    return ColumnProgram(inputs, outputs, places, (*placed, *ends), tuple(constants))


def _slices(begin: int, sizes: Sequence[int]) -> tuple[slice, ...]:
    ends = [begin + sum(sizes[: k + 1]) for k in range(len(sizes))]
    return tuple(slice(end - size, end) for end, size in zip(ends, sizes, strict=True))


def _placed(steps: Sequence[Step], settled: dict[int | float, int], first: int) -> tuple[list[Step], int]:
    """Return the steps with places instead of step numbers, reusing places from `first` on, and their number."""
    last: dict[int | float, int] = {}
    for k, step in enumerate(steps):
        for x in step.operands:
            if x.__class__ is int and x < 0:
                last[x] = k
    place: dict[int | float, int] = dict(settled)
    free: list[int] = []
    placed: list[Step] = []
    top = first
    for k, (op, operands, number) in enumerate(steps):
        arguments: list[int | float] = []
        freed: list[int] = []
        for x in operands:
            if x.__class__ is int and x < 0:
                arguments.append(place[x])
                if last[x] == k and x not in settled:
                    freed.append(place[x])
                    last[x] = -1  # free it only once if it is read twice
            else:
                arguments.append(x)
        # an exact operation may overwrite its operands; a call may not
        in_place = op in EXACT and op != ca.OP_IF_ELSE_ZERO
        if in_place:
            free += freed
        if number not in place:
            if not free:
                free.append(top)
                top += 1
            place[number] = free.pop()
        if not in_place:
            free += freed
        placed.append(Step(op, tuple(arguments), place[number]))
    return placed, top
