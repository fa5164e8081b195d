"""Expressions as instruction lists: reading and rewriting them, and detection of nonsmooth operations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

import casadi as ca

from ..lang.source import ModelError
from .flat import FlatModel
from .matrices import stacked

CALLED = (
    "an expression with an external function (gt.external) cannot be rewritten here, since CasADi cannot write out its "
    "operations; give its value a variable and an equation of its own"
)
LARGEST = 50_000  # operations; a pass over a larger expression would take too long


class Instruction(NamedTuple):
    """An operation with the numbers of the instructions that it reads; `place`: the entry of an input or output."""

    op: int
    reads: Sequence[int] = ()
    place: int = -1
    constant: float = 0.0


# returns the outputs in symbols of the inputs; None leaves the expressions unchanged
Rewrite = Callable[[list[Instruction], list[ca.SX]], list[ca.SX] | None]

Form = TypeVar("Form")  # how a pass represents the result of an instruction


class Forms(Protocol[Form]):
    """The results that a pass creates for instructions; leaves are inputs and constants."""

    def leaf(self, x: ca.SX) -> Form: ...

    def operation(self, k: int, op: int, given: list[Form]) -> Form:
        """Return the form of instruction `k` with operation code `op`."""
        ...

    def whole(self, form: Form) -> ca.SX: ...


def instructions(f: ca.Function) -> list[Instruction]:
    """Return the instructions of a function of one column; their operands are instructions, not work vector entries."""
    latest: dict[int, int] = {}  # instruction that wrote each entry of the work vector last
    result: list[Instruction] = []
    for k in range(f.n_instructions()):
        op, sources, target = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_INPUT:
            result.append(Instruction(op, place=sources[1]))
        elif op == ca.OP_CONST:
            result.append(Instruction(op, constant=float(f.instruction_constant(k))))
        else:
            reads = [latest[i] for i in sources]
            result.append(Instruction(op, reads, target[1]) if op == ca.OP_OUTPUT else Instruction(op, reads))
        if op == ca.OP_CALL:  # one instruction for each value of the called function
            result += [result[-1]] * (len(target) - 1)
            latest |= {t: len(result) - len(target) + n for n, t in enumerate(target)}
        elif op != ca.OP_OUTPUT:
            latest[target[0]] = len(result) - 1
    return result


def of_expression(expression: ca.SX) -> tuple[list[Instruction], list[ca.SX]]:
    """Return the instructions of an expression, and the symbols that are their inputs."""
    symbols = ca.symvar(expression)
    column = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
    return instructions(ca.Function("f", [column], [ca.densify(expression)])), symbols


def walked(read: Sequence[Instruction], symbols: Sequence[ca.SX], forms: Forms[Form]) -> list[ca.SX]:
    """Return the outputs as expressions of the symbols, with the instructions rewritten by `forms`."""
    values: list[Form] = []
    results: dict[int, ca.SX] = {}
    for k, (op, reads, place, constant) in enumerate(read):
        if op == ca.OP_OUTPUT:
            results[place] = forms.whole(values[reads[0]])
            values.append(values[reads[0]])
        elif op in (ca.OP_INPUT, ca.OP_CONST):
            values.append(forms.leaf(symbols[place] if op == ca.OP_INPUT else ca.SX(constant)))
        else:
            values.append(forms.operation(k, op, [values[i] for i in reads]))
    return [results[place] for place in sorted(results)]


def applied(op: int, parts: Sequence[ca.SX]) -> ca.SX:
    """Return the operation with this code applied to expressions. Raises ModelError for a call of a function."""
    if op == ca.OP_CALL:
        raise ModelError(CALLED)
    return ca.SX.unary(op, *parts) if len(parts) == 1 else ca.SX.binary(op, *parts)


def rewritten(expressions: Sequence[ca.SX], rewrite: Rewrite) -> list[ca.SX]:
    """Return the expressions rewritten by `rewrite`, with the same sparsity."""
    numbers: list[Any] = [x for e in expressions for x in e.nonzeros()]
    symbols = ca.symvar(ca.vertcat(*numbers)) if numbers else []
    if not symbols:
        return list(expressions)
    f = ca.Function("f", [ca.vertcat(*symbols)], [ca.vertcat(*numbers)])
    outputs = rewrite(instructions(f), symbols) if f.n_instructions() <= LARGEST and not f.get_function() else None
    if outputs is None:
        return list(expressions)
    results = iter(outputs)
    return [
        ca.SX(e.sparsity(), stacked([next(results) for _ in range(e.nnz())])) if e.nnz() else e for e in expressions
    ]


# operations whose first or second derivative is zero in CasADi wherever it exists
NONSMOOTH = frozenset(
    getattr(ca, f"OP_{name}")
    for name in (
        "SIGN", "FABS", "FLOOR", "CEIL", "FMIN", "FMAX", "FMOD", "REMAINDER", "COPYSIGN",
        "LT", "LE", "EQ", "NE", "NOT", "AND", "OR", "IF_ELSE_ZERO",
    )
)  # fmt: skip


def is_nonsmooth(flat: FlatModel) -> bool:
    """Return whether some equation has such an operation; for most models this avoids further analysis."""
    if "nonsmooth" not in flat.cache:
        column = ca.vertcat(*[e.residual for e in flat.equations]) if flat.equations else ca.SX(0, 1)
        flat.cache["nonsmooth"] = any(i.op in NONSMOOTH for i in of_expression(column)[0])
    return flat.cache["nonsmooth"]


def kinked_in(rows: Sequence[ca.SX], symbols: Sequence[ca.SX], only: frozenset[int] = NONSMOOTH) -> list[set[int]]:
    """Return for each row the positions in `symbols` of those inside an operation of `only`."""
    position = {s.element_hash(): n for n, s in enumerate(symbols)}
    column = ca.vertcat(*rows)
    read, free = of_expression(column)
    inside: list[frozenset[int]] = []  # symbols that an instruction depends on
    within: list[frozenset[int]] = []  # those of them that went through a nonsmooth operation
    by_row: list[set[int]] = [set() for _ in rows]
    nothing: frozenset[int] = frozenset()
    for op, reads, place, _ in read:
        depends, kinked = (nothing.union(*[of[i] for i in reads]) for of in (inside, within))
        if op == ca.OP_INPUT and (n := position.get(free[place].element_hash())) is not None:
            depends = frozenset([n])
        kinked = depends if op in only else kinked
        inside.append(depends)
        within.append(kinked)
        if op == ca.OP_OUTPUT:
            by_row[place] |= kinked
    return by_row
